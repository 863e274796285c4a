"""Files of demonstrations (.npz) with their units, frame and doors."""

import hashlib
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gplfd_policies.arrays.storage import Members, read_archive, write_archive
from gplfd_policies.demonstrations.demonstration import Demonstration

KIND: Final = "gplfd demonstrations"
VERSION: Final = 2
UNITS: Final = "s, m, rad"
"""Kind, version of the layout and units, as stored in the file."""
FRAME: Final = "task: closed handle, x pull, y up, z = x cross y; relative to 1st pose"
"""Frame of the poses (x, y, z, θu_x, θu_y, θu_z) of demonstrations at doors."""
FIRST_POSE: Final = "the first pose of each demonstration"
"""Frame of motions that are relative to their own first pose."""
OTHER: Final = "one frame of all demonstrations"
"""Frame of motions that keep their start poses."""
FRAMES: Final = (FRAME, FIRST_POSE, OTHER)  # All frames that a file may name.
FILE: Final = "demonstrations.npz"  # Name of the file in a folder of demonstrations.


@dataclass(frozen=True, kw_only=True, slots=True)
class LabelledDemonstrations:
    """Demonstrations and their doors."""

    demonstrations: tuple[Demonstration, ...]
    """Demonstrations in the order of the file."""
    radii: tuple[float | None, ...]
    """Radius of the door of each demonstration [m]; None if unknown."""
    frame: str = FRAME
    """Frame of the poses, one of `FRAMES`."""
    signals: tuple[Mapping[str, NDArray[Any]], ...] = ()
    """Other recorded signals of each demonstration, (N, d) arrays by name; or empty."""

    def __post_init__(self) -> None:
        number = len(self.demonstrations)
        if self.frame not in FRAMES:
            raise ValueError(f"frame is {self.frame!r:.80}, must be one of {FRAMES}")
        signals = self.signals or ({},) * number
        if number == 0 or not number == len(self.radii) == len(signals):
            raise ValueError(
                f"{number} demonstrations, {len(self.radii)} radii and {len(signals)} "
                "signals; give at least one demonstration, a radius (or None) for each "
                "or no radii, and signals of each or none"
            )
        for motion, arrays in zip(self.demonstrations, signals, strict=True):
            for name, array in arrays.items():
                if name in ("times", "poses", "wrenches"):
                    raise ValueError(f"a signal cannot have the name {name!r}")
                if array.ndim != 2 or len(array) != len(motion.times):
                    raise ValueError(
                        f"signal {name!r:.40} has shape {array.shape}, must be "
                        f"({len(motion.times)}, d)"
                    )
        if not all(r is None or 0.0 < r < math.inf for r in self.radii):
            raise ValueError(f"radii are {self.radii}; they must be positive [m]")


def save_demonstrations(
    path: str | Path,
    demonstrations: Sequence[Demonstration],
    radii: Sequence[float | None] | None = None,
    *,
    frame: str = FRAME,
    signals: Sequence[Mapping[str, NDArray[Any]]] = (),
) -> None:
    """Write demonstrations and their doors' radii to a file, complete or absent.

    The arguments are the fields of `LabelledDemonstrations`; radii are None if all are
    unknown. Wrenches are written for demonstrations that have them.
    """
    labelled = LabelledDemonstrations(
        demonstrations=tuple(demonstrations),
        radii=tuple([None] * len(demonstrations) if radii is None else radii),
        frame=frame,
        signals=tuple(signals),
    )
    names = sorted({name for arrays in labelled.signals for name in arrays})
    arrays: dict[str, Any] = {
        "units": np.array(UNITS),
        "frame": np.array(labelled.frame),
        "signals": np.array(names, dtype=str),
        "radii": np.array([math.nan if r is None else r for r in labelled.radii]),
    }
    for number, demonstration in enumerate(labelled.demonstrations):
        arrays[f"times_{number}"] = demonstration.times
        arrays[f"poses_{number}"] = demonstration.poses
        if demonstration.wrenches is not None:
            arrays[f"wrenches_{number}"] = demonstration.wrenches
        for name in names:
            empty = np.zeros((0, 0))
            arrays[f"{name}_{number}"] = labelled.signals[number].get(name, empty)
    write_archive(path, kind=KIND, version=VERSION, arrays=arrays)


def check_frame(frame: str, source: str | Path) -> None:
    """Raise a ValueError if the frame of a set or a skill is not that of a door."""
    if frame not in ("door", FRAME):
        raise ValueError(
            f"{source} cannot open doors: its frame is not a door's but {frame!r}; "
            "import the recordings with gplfd demos import FILES --frame hinge"
        )


def load_demonstrations(path: str | Path) -> LabelledDemonstrations:
    """Read a file that `save_demonstrations` wrote, or that in a folder (`FILE`).

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: The file is damaged or has other content.
    """
    file = demonstrations_file(path)
    if Path(path).is_dir() and not file.exists():
        raise FileNotFoundError(
            f"there is no {FILE} in {path}; gplfd demos import FILES --out SET makes it"
        )
    try:
        return read_archive(file, kind=KIND, version=VERSION, build=_labelled)
    except ValueError as error:
        advice = f"gplfd demos import {path} --out SET makes a set of a recording"
        raise ValueError(f"{error}; {advice}") from error


def demonstrations_file(path: str | Path) -> Path:
    """Return the file of demonstrations for a path to the file or to its folder."""
    path = Path(path)
    return path / FILE if path.is_dir() else path


def hash_of(demonstrations: Sequence[Demonstration]) -> str:
    """Return a hash of demonstrations, rounded (1 µm, 1 µN) to be equal everywhere."""
    digest = hashlib.sha256()
    for motion in demonstrations:
        wrenches = () if motion.wrenches is None else (motion.wrenches,)
        for values in (motion.times, motion.poses, *wrenches):
            digest.update(np.rint(values * 1e6).astype(np.int64).tobytes())
    return digest.hexdigest()[:16]


def _labelled(members: Members) -> LabelledDemonstrations:
    if (units := str(members["units"])) != UNITS:
        raise ValueError(f"units is {units!r:.80}, must be {UNITS!r}")
    radii = np.array(members["radii"], dtype=np.float64, ndmin=1)
    demonstrations, signals = [], []
    for number in range(radii.size):
        try:
            demonstration = Demonstration(
                times=members[f"times_{number}"],
                poses=members[f"poses_{number}"],
                wrenches=members.get(f"wrenches_{number}"),
            )
        except ValueError as error:
            raise ValueError(f"demonstration {number}: {error}") from error
        demonstrations.append(demonstration)
        arrays = {str(name): members[f"{name}_{number}"] for name in members["signals"]}
        signals.append({name: array for name, array in arrays.items() if array.size})
    return LabelledDemonstrations(
        demonstrations=tuple(demonstrations),
        radii=tuple(None if math.isnan(r) else r for r in radii.tolist()),
        frame=str(members["frame"]),
        signals=tuple(signals) if members["signals"].size else (),
    )
