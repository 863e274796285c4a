"""Demonstrations in one .npz file with their units, frame and doors inside."""

import hashlib
import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from policies.demonstrations import Demonstration
from policies.storage import Members, read_archive, write_archive

KIND: Final = "gplfd demonstrations"
"""What the file says it holds."""

VERSION: Final = 1
"""Version of the layout below."""

UNITS: Final = "s, m, rad"
"""Units of times, positions and rotation vectors."""

FRAME: Final = "task: closed handle, x pull, y up, z = x cross y; relative to 1st pose"
"""Frame of the poses (x, y, z, θu_x, θu_y, θu_z)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class LabelledDemonstrations:
    """Demonstrations and the doors they were given on.

    Raises:
        ValueError: There is none, another number of radii, or a radius that no door
            has.
    """

    demonstrations: tuple[Demonstration, ...]
    """Demonstrations in the order of the file."""

    radii: tuple[float | None, ...]
    """Radius of each one's door [m]; None when unknown."""

    def __post_init__(self) -> None:
        number = len(self.demonstrations)
        if number == 0 or number != len(self.radii):
            raise ValueError(
                f"{number} demonstrations and {len(self.radii)} radii; give at least "
                "one demonstration, and one radius (or None) for each or no radii"
            )
        for radius in self.radii:
            if radius is not None and not 0.0 < radius < math.inf:
                raise ValueError(
                    f"a door's radius is {radius}; it must be positive [m], or None "
                    "(NaN in a file) where it is unknown"
                )


def save_demonstrations(
    path: str | Path,
    demonstrations: Sequence[Demonstration],
    radii: Sequence[float | None] | None = None,
) -> None:
    """Write demonstrations and their doors' radii, complete or not at all.

    Args:
        path: File to write; an existing one is replaced.
        demonstrations: At least one demonstration, poses in the task frame.
        radii: Radius of each one's door [m]; None where, or altogether when, unknown.
            An unknown radius is stored as NaN.

    Raises:
        ValueError: As `LabelledDemonstrations`.
        OSError: The file cannot be written.
    """
    given = LabelledDemonstrations(
        demonstrations=tuple(demonstrations),
        radii=tuple([None] * len(demonstrations) if radii is None else radii),
    )
    arrays: dict[str, Any] = {
        "units": np.array(UNITS),
        "frame": np.array(FRAME),
        "radii": np.array([math.nan if r is None else r for r in given.radii]),
    }
    for number, demonstration in enumerate(given.demonstrations):
        arrays[f"times_{number}"] = demonstration.times
        arrays[f"poses_{number}"] = demonstration.poses
    write_archive(path, kind=KIND, version=VERSION, arrays=arrays)


def load_demonstrations(path: str | Path) -> LabelledDemonstrations:
    """Read what `save_demonstrations` wrote.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is cut, holds something else, has another version, units
            or frame, or an invalid demonstration.
    """
    return read_archive(path, kind=KIND, version=VERSION, build=_labelled)


def hash_of(demonstrations: Sequence[Demonstration]) -> str:
    """Return a hash of demonstrations, to a micrometre and a microradian.

    Coarse enough to be the same on machines whose last bits differ.
    """
    digest = hashlib.sha256()
    for one in demonstrations:
        for values in (one.times, one.poses):
            digest.update(np.rint(values * 1e6).astype(np.int64).tobytes())
    return digest.hexdigest()[:16]


def _labelled(members: Members) -> LabelledDemonstrations:
    for name, expected in (("units", UNITS), ("frame", FRAME)):
        found = str(members(name))
        if found != expected:
            raise ValueError(f"{name} is {found!r:.80}, must be {expected!r}")
    radii = _numbers(members, "radii")
    if radii.ndim != 1:
        raise ValueError(f"radii has shape {radii.shape}, must be a list of numbers")
    return LabelledDemonstrations(
        demonstrations=tuple(
            _demonstration(members, number) for number in range(radii.size)
        ),
        radii=tuple(None if math.isnan(r) else float(r) for r in radii),
    )


def _demonstration(members: Members, number: int) -> Demonstration:
    times = _numbers(members, f"times_{number}")
    poses = _numbers(members, f"poses_{number}")
    try:
        return Demonstration(times=times, poses=poses)
    except ValueError as error:
        raise ValueError(f"demonstration {number}: {error}") from error


def _numbers(members: Members, name: str) -> NDArray[Any]:
    array = members(name)
    if array.dtype.kind not in "iuf":
        raise ValueError(f"{name} holds {array.dtype}, must hold numbers")
    return array
