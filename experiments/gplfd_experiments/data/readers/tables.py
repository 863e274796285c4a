"""Columns with names and units, for all kinds of tables.

Names of columns are case-insensitive, with the unit at the end: ``time [ms]``, ``x
(cm)``, ``y_mm``, ``qw``, ``rx [deg]``. Other columns are not used.
"""

import re
from collections.abc import Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import (
    METRES,
    RADIANS,
    SECONDS,
    ImportSettings,
    likely_time_unit,
)
from gplfd_experiments.files.arrays import FloatArray

POSITION: Final = ("x", "y", "z")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
ROTATION_VECTOR: Final = ("rx", "ry", "rz")
FORCE: Final = ("fx", "fy", "fz", "mx", "my", "mz")
ORIENTATIONS: Final = (QUATERNION, ROTATION_VECTOR)
"""Columns of each form of an orientation that `quaternions_of` converts; the first form
that a table has is used."""
XYZW: Final = (*QUATERNION[1:], QUATERNION[0])

_NEWTON_METRES: Final = {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "n mm": 1e-3}


class _Quantity(NamedTuple):
    """What columns of a table or an array can be; names are separated by spaces."""

    columns: tuple[str, ...]
    units: Mapping[str, float]
    names: str = ""
    """Other names of the columns; ``*`` stands for the last letter of the column."""
    arrays: str = ""
    """Names of an array that has all columns."""


_QUANTITIES: Final = (
    _Quantity(
        ("t",), SECONDS, "time timestamp stamp seconds", "times time t timestamps"
    ),
    _Quantity(
        POSITION,
        METRES,
        "p* pos_* position_* position.*",
        "positions position pos p xyz",
    ),
    _Quantity(
        QUATERNION,
        {},
        "q_* quat_* quaternion_* orientation_* orientation.*",
        "quaternions_wxyz quat_wxyz q_wxyz",
    ),
    _Quantity(XYZW, {}, arrays="quaternions_xyzw quat_xyzw q_xyzw"),
    _Quantity(
        ROTATION_VECTOR, RADIANS, "rotvec_* rot_*", "rotvecs rotvec rotation_vectors"
    ),
    _Quantity(FORCE[:3], {"n": 1.0}, "force_* force.*"),
    _Quantity(FORCE[3:], _NEWTON_METRES, "torque_* torque.*"),
    _Quantity(FORCE, {}, arrays="force forces wrench wrenches"),
    _Quantity(("gripper",), {}, "gripper_position gripper_width", "gripper"),
)
"""All names that are understood."""

ARRAYS: Final = {
    name: kind.columns for kind in _QUANTITIES for name in kind.arrays.split()
}
_UNITS: Final = {kind.columns: kind.units for kind in _QUANTITIES}
_CANONICAL: Final = {
    alias.replace("*", column[-1]): column
    for kind in _QUANTITIES
    for column in kind.columns
    for alias in (column, *kind.names.split())
}
_ALL_UNITS: Final = frozenset().union(*_UNITS.values())
_BRACKETED: Final = re.compile(r"(.*?)[\s_]*[\[(]\s*([^\])]*?)\s*[\])]")
_SUFFIXED: Final = re.compile(r"(.+)_(cm|mm|m|in|s|ms|us|ns|rad|deg)")
_MANY_TURNS: Final = 7.0
"""A longer rotation vector [rad] is probably in degrees."""

Columns = Mapping[str, tuple[FloatArray, str | None]]
"""Values, (N,), and unit of columns, by the names of this module."""


def understood(head: str) -> tuple[str | None, str | None]:
    """Return the name of a column and its unit, None if they are not known."""
    text = head.strip().lower().replace(" ", "_") if "[" not in head else head.lower()
    for pattern in (_BRACKETED, _SUFFIXED):
        match = pattern.fullmatch(text.strip())
        if match and match[2] in _ALL_UNITS and match[1].strip() in _CANONICAL:
            return _CANONICAL[match[1].strip()], match[2]
    return _CANONICAL.get(text.strip()), None


def named_columns(
    heads: Sequence[str], where: str
) -> dict[str, tuple[int, str | None]]:
    """Return index and unit of every known column.

    Raises:
        ValueError: x or y is missing, an orientation is incomplete, or a column is
            repeated; ``where`` describes the headings.
    """
    columns: dict[str, tuple[int, str | None]] = {}
    for place, head in enumerate(heads):
        name, unit = understood(head)
        if name in columns:
            raise ValueError(
                f"{where} has two columns for {name}; name those to leave out '-' "
                "with --columns"
            )
        if name is not None:
            columns[name] = (place, unit)
    for whole in (("x", "y"), *ORIENTATIONS):
        missing = [name for name in whole if name not in columns]
        if missing and (whole[0] == "x" or len(missing) < len(whole)):
            raise ValueError(
                f"{where} has no column {' and no '.join(missing)}: it has "
                f"{', '.join(heads)!s:.200}. Name the columns in their order, for "
                "example --columns t,x,y,z,qx,qy,qz,qw with - for one to leave out; "
                "joint positions are not a hand pose"
            )
    return columns


def recording(
    name: str, columns: Columns, settings: ImportSettings, untimed: str = ""
) -> RawRecording:
    """Return the motion in columns with the names of this module.

    Raises:
        ValueError: A unit does not fit the quantity, or the units of x, y and z differ.
    """
    notes: list[str] = []

    def unit_of(names: tuple[str, ...]) -> str | None:
        units = {columns[name][1] for name in names if name in columns} - {None}
        known = _UNITS[names]
        if len(units) > 1 or units - set(known):
            listed = " and ".join(sorted(map(str, units)))
            raise ValueError(
                f"{name}: {', '.join(names)} are in {listed}; they must share one unit "
                f"of {', '.join(known)}"
            )
        return next(iter(units), None)

    def stacked(names: Sequence[str]) -> FloatArray:
        absent = np.zeros(len(columns["x"][0])), None
        return np.column_stack([columns.get(column, absent)[0] for column in names])

    quaternions, wrenches, times = None, None, None
    if form := next((whole for whole in ORIENTATIONS if whole[0] in columns), None):
        angles = unit_of(form) or settings.angles
        values = stacked(form)
        quaternions = quaternions_of(form, values, angles)
        longest = float(np.nanmax(np.linalg.norm(values, axis=1), initial=0.0))
        if form == ROTATION_VECTOR and angles == "rad" and longest > _MANY_TURNS:
            notes.append(
                f"rotation vectors as long as {longest:.3g} rad are many turns: are "
                "they degrees? say --angles deg"
            )
    if "t" in columns:
        times, stated = columns["t"][0], unit_of(("t",)) or "s"
        steps = np.diff(np.sort(times[np.isfinite(times)]))
        step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        likely = likely_time_unit(step)
        if settings.time_unit is None and likely not in (None, stated):
            notes.append(
                f"there is a sample every {step:.3g} {stated}: are times in {likely}? "
                f"say --time-unit {likely}, or --time-unit {stated} if they are not"
            )
        times = times * SECONDS[settings.time_unit or stated]
    if present := columns.keys() & set(FORCE):
        if present not in (set(FORCE[:3]), set(FORCE)):
            raise ValueError(
                f"{name} has {', '.join(sorted(present))} of a force and a moment; "
                "they need fx, fy, fz, and mx, my, mz or none of these"
            )
        unit_of(FORCE[:3])
        newton_metres = _NEWTON_METRES[unit_of(FORCE[3:]) or "nm"]
        if "mx" not in present:
            notes.append("forces without moments: taken as zero about the sensor")
        wrenches = np.hstack([stacked(FORCE[:3]), newton_metres * stacked(FORCE[3:])])
    return RawRecording(
        name=name,
        positions=stacked(POSITION),
        unit=unit_of(POSITION),
        times=times,
        quaternions=quaternions,
        wrenches=wrenches,
        signals={"gripper": stacked(["gripper"])} if "gripper" in columns else {},
        untimed="" if "t" in columns else untimed,
        notes=tuple(notes),
    )


def quaternions_of(
    form: tuple[str, ...], values: FloatArray, angles: str = "rad"
) -> FloatArray:
    """Return orientations as quaternions, scalar first, (N, 4); NaN where not known.

    Args:
        form: One of `ORIENTATIONS`.
        values: The columns of this form, (N, C).
        angles: Unit of angles among them, one of `RADIANS`.
    """
    if form == QUATERNION:
        return values
    return Rotation.from_rotvec(values * RADIANS[angles]).as_quat(scalar_first=True)
