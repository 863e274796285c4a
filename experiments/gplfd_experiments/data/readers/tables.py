"""Columns with names and units, for all kinds of tables.

Names of columns are case-insensitive, with the unit at the end: ``time [ms]``, ``x
(cm)``, ``y_mm``, ``qw``, ``rx [deg]``. Other columns are not used.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import (
    METRES,
    RADIANS,
    SECONDS,
    RawRecording,
    Selection,
    likely_time_unit,
)
from gplfd_experiments.files.arrays import FloatArray

_NAMES: Final[Mapping[str, tuple[str, ...]]] = {
    "t": ("time", "timestamp", "stamp", "seconds"),
    **{
        axis: (f"p{axis}", f"pos_{axis}", f"position_{axis}", f"position.{axis}")
        for axis in "xyz"
    },
    **{
        f"q{part}": tuple(
            f"{whole}{part}"
            for whole in ("q_", "quat_", "quaternion_", "orientation_", "orientation.")
        )
        for part in "wxyz"
    },
    **{f"r{axis}": (f"rotvec_{axis}", f"rot_{axis}") for axis in "xyz"},
    **{f"f{axis}": (f"force_{axis}", f"force.{axis}") for axis in "xyz"},
    **{f"m{axis}": (f"torque_{axis}", f"torque.{axis}") for axis in "xyz"},
    "gripper": ("gripper_position", "gripper_width"),
}
"""Known columns, each with alternative names."""

POSITION: Final = ("x", "y", "z")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR: Final = ("rx", "ry", "rz")
FORCE: Final = ("fx", "fy", "fz", "mx", "my", "mz")
_NEWTONS: Final = {"n": 1.0}
_NEWTON_METRES: Final = {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "n mm": 1e-3}

_MANY_TURNS: Final = 7.0
"""A longer rotation vector [rad] is probably in degrees."""

Columns = Mapping[str, tuple[FloatArray, str | None]]
"""Values, (N,), and unit of columns, by the names of this module."""

_CANONICAL: Final = {
    other: name for name, others in _NAMES.items() for other in (name, *others)
}
_UNITS: Final = frozenset((*METRES, *SECONDS, *RADIANS, *_NEWTONS, *_NEWTON_METRES))
_BRACKETED: Final = re.compile(r"(.*?)[\s_]*[\[(]\s*([^\])]*?)\s*[\])]")
_SUFFIXED: Final = re.compile(r"(.+)_(cm|mm|m|in|s|ms|us|ns|rad|deg)")


def understood(head: str) -> tuple[str | None, str | None]:
    """Return the name of a column and its unit, None if they are not known."""
    text = head.strip().lower().replace(" ", "_") if "[" not in head else head.lower()
    for pattern in (_BRACKETED, _SUFFIXED):
        match = pattern.fullmatch(text.strip())
        if match and match[2] in _UNITS and match[1].strip() in _CANONICAL:
            return _CANONICAL[match[1].strip()], match[2]
    return _CANONICAL.get(text.strip()), None


def named_columns(
    heads: Sequence[str], where: str
) -> dict[str, tuple[int, str | None]]:
    """Return index and unit of every known column.

    Raises:
        ValueError: x or y is missing, a quaternion or a rotation vector is incomplete,
            or a column is repeated; ``where`` describes the headings.
    """
    found: dict[str, tuple[int, str | None]] = {}
    for place, head in enumerate(heads):
        name, unit = understood(head)
        if name in found:
            raise ValueError(
                f"{where} has two columns for {name}; name those to leave out '-' "
                "with --columns"
            )
        if name is not None:
            found[name] = (place, unit)
    for whole in (("x", "y"), QUATERNION, ROTATION_VECTOR):
        missing = [name for name in whole if name not in found]
        if missing and (whole[0] == "x" or len(missing) < len(whole)):
            raise ValueError(
                f"{where} has no column {' and no '.join(missing)}: it has "
                f"{', '.join(heads)!s:.200}. Name the columns in their order, for "
                "example --columns t,x,y,z,qx,qy,qz,qw with - for one to leave out; "
                "joint positions are not a hand pose"
            )
    return found


def recording(
    name: str, columns: Columns, selection: Selection, untimed: str = ""
) -> RawRecording:
    """Return the motion in columns with the names of this module.

    Raises:
        ValueError: A unit does not fit the quantity, or the units of x, y and z differ.
    """

    def unit(names: Sequence[str], known: Mapping[str, float]) -> str | None:
        units = (columns[one][1] for one in names if one in columns)
        said = {one for one in units if one is not None}
        if len(said) > 1 or said - set(known):
            raise ValueError(
                f"{name}: {', '.join(names)} are in {' and '.join(sorted(said))}; they "
                f"must share one unit of {', '.join(known)}"
            )
        return next(iter(said), None)

    def stacked(names: Sequence[str]) -> FloatArray:
        absent = np.zeros(len(columns["x"][0])), None
        return np.column_stack([columns.get(column, absent)[0] for column in names])

    quaternions, wrenches, notes, signals = None, None, [], {}
    if "qw" in columns:
        quaternions = stacked(QUATERNION)
    elif "rx" in columns:
        angles = unit(ROTATION_VECTOR, RADIANS) or selection.angles
        rotvecs = stacked(ROTATION_VECTOR)
        quaternions = quaternions_of(rotvecs * RADIANS[angles])
        longest = float(np.nanmax(np.linalg.norm(rotvecs, axis=1), initial=0.0))
        if angles == "rad" and longest > _MANY_TURNS:
            notes.append(
                f"rotation vectors as long as {longest:.3g} rad are many turns: are "
                "they degrees? say --angles deg"
            )
    times = None
    if "t" in columns:
        times = columns["t"][0]
        said = unit(("t",), SECONDS) or "s"
        steps = np.diff(np.sort(times[np.isfinite(times)]))
        step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        likely = likely_time_unit(step)
        if selection.time_unit is None and likely not in (None, said):
            notes.append(
                f"there is a sample every {step:.3g} {said}: are times in {likely}? "
                f"say --time-unit {likely}, or --time-unit {said} if they are not"
            )
        times = times * SECONDS[selection.time_unit or said]
    forces, moments = FORCE[:3], FORCE[3:]
    if given := columns.keys() & set(FORCE):
        if given not in (set(forces), set(FORCE)):
            raise ValueError(
                f"{name} has {', '.join(sorted(given))} of a force and a moment; they "
                "need fx, fy, fz, and mx, my, mz or none of these"
            )
        unit(forces, _NEWTONS)
        newton_metres = _NEWTON_METRES[unit(moments, _NEWTON_METRES) or "nm"]
        if given == set(forces):
            notes.append("forces without moments: taken as zero about the sensor")
        wrenches = np.hstack([stacked(forces), newton_metres * stacked(moments)])
    if "gripper" in columns:
        signals["gripper"] = stacked(["gripper"])
    return RawRecording(
        name=name,
        positions=stacked(POSITION),
        unit=unit(POSITION, METRES),
        times=times,
        quaternions=quaternions,
        wrenches=wrenches,
        signals=signals,
        untimed="" if "t" in columns else untimed,
        notes=tuple(notes),
    )


def quaternions_of(rotvecs: FloatArray) -> FloatArray:
    """Return quaternions, scalar first, (N, 4), of rotation vectors [rad], (N, 3).

    Rows with a NaN are NaN.
    """
    return Rotation.from_rotvec(np.array(rotvecs)).as_quat(scalar_first=True)
