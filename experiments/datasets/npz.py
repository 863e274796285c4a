"""Demonstrations in one .npz file with their units, frame and doors inside."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np

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
    """Demonstrations and the doors they were given on."""

    demonstrations: tuple[Demonstration, ...]
    """Demonstrations in the order of the file."""

    radii: tuple[float | None, ...]
    """Radius of each one's door [m]; None when unknown."""


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
        ValueError: No demonstration, or another number of radii.
        OSError: The file cannot be written.
    """
    if radii is None:
        radii = [None] * len(demonstrations)
    if len(demonstrations) == 0 or len(demonstrations) != len(radii):
        raise ValueError(
            f"{len(demonstrations)} demonstrations and {len(radii)} radii; give at "
            "least one demonstration, and one radius (or None) for each or no radii"
        )
    arrays: dict[str, Any] = {
        "units": np.array(UNITS),
        "frame": np.array(FRAME),
        "radii": np.array([math.nan if r is None else r for r in radii]),
    }
    for number, demonstration in enumerate(demonstrations):
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


def _labelled(members: Members) -> LabelledDemonstrations:
    for name, expected in (("units", UNITS), ("frame", FRAME)):
        found = str(members(name))
        if found != expected:
            raise ValueError(f"{name} is {found!r:.80}, must be {expected!r}")
    radii = members("radii")
    if radii.ndim != 1 or radii.size == 0:
        raise ValueError(
            f"radii has shape {radii.shape}, must be one number for each of at least "
            "one demonstration"
        )
    if not (np.isnan(radii) | (np.isfinite(radii) & (radii > 0.0))).all():
        raise ValueError(f"radii must be positive [m], or NaN where unknown: {radii}")
    return LabelledDemonstrations(
        demonstrations=tuple(
            _demonstration(members, number) for number in range(radii.size)
        ),
        radii=tuple(None if math.isnan(r) else float(r) for r in radii),
    )


def _demonstration(members: Members, number: int) -> Demonstration:
    times, poses = members(f"times_{number}"), members(f"poses_{number}")
    try:
        return Demonstration(times=times, poses=poses)
    except ValueError as error:
        raise ValueError(f"demonstration {number}: {error}") from error
