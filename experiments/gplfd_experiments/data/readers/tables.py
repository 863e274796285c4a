"""Columns with names and units, for all kinds of tables.

Names of columns are case-insensitive, with the unit at the end: ``time [ms]``, ``x
(cm)``, ``y_mm``, ``qw``, ``rx [deg]``. They may follow the name of what moves, as
``hand.position.x`` does. Other columns are not used.
"""

import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from typing import Final, NamedTuple

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import (
    METRES,
    RADIANS,
    SECONDS,
    ImportSettings,
    angles_of,
    likely_time_unit,
)
from gplfd_experiments.files.arrays import FloatArray

Form = tuple[str, ...]
POSITION: Final = ("x", "y", "z")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
NUMBERED: Final = ("q0", "q1", "q2", "q3")
ROTATION_VECTOR: Final = ("rx", "ry", "rz")
EULER: Final = ("roll", "pitch", "yaw")
MATRIX: Final = tuple(f"r{row}{column}" for row in range(3) for column in range(3))
SIX_NUMBERS: Final = tuple(f"d{place}" for place in range(6))
FORCE: Final = ("fx", "fy", "fz", "mx", "my", "mz")
ORIENTATIONS: Final = (
    QUATERNION,
    NUMBERED,
    ROTATION_VECTOR,
    EULER,
    MATRIX,
    SIX_NUMBERS,
)
"""Columns of each form of an orientation that `quaternions_of` converts; the first form
that a table has is used. Quaternions with numbers are in the order of
`ImportSettings.quaternions`, matrices row by row, and six numbers are their first two
rows."""
XYZW: Final = (*QUATERNION[1:], QUATERNION[0])

_NEWTON_METRES: Final = {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "n mm": 1e-3}
_ORTHONORMAL: Final = 0.1  # Largest error of R Rᵀ of a rotation matrix R.


class _Quantity(NamedTuple):
    """What columns of a table or an array can be; names are separated by spaces."""

    columns: Form
    units: Mapping[str, float]
    names: str = ""
    """Other names of the columns; ``*`` stands for the column without its first letter,
    or the axis of roll, pitch and yaw."""
    arrays: str = ""
    """Names of an array that has all columns."""


_QUANTITIES: Final = (
    _Quantity(
        ("t",),
        SECONDS,
        "time timestamp time_stamp stamp seconds header_stamp",
        "times time t timestamps",
    ),
    _Quantity(("secs",), {}, "sec stamp_secs stamp_sec"),
    _Quantity(
        ("nsecs",), {}, "nsec nanosec nanosecs nanoseconds stamp_nsecs stamp_nanosec"
    ),
    _Quantity(
        POSITION,
        METRES,
        "p* p_* pos_* position_* translation_* location_*",
        "positions position pos p xyz",
    ),
    _Quantity(
        QUATERNION,
        {},
        "q_* quat_* quaternion_* orientation_* ori_* orient_* attitude_*",
        "quaternions_wxyz quat_wxyz q_wxyz",
    ),
    _Quantity(XYZW, {}, arrays="quaternions_xyzw quat_xyzw q_xyzw"),
    _Quantity(NUMBERED, {}, "q_* quat_* quaternion_* orientation_*"),
    _Quantity(
        ROTATION_VECTOR,
        RADIANS,
        "rotvec_* rot_* rotation_* axis_angle_* axisangle_*",
        "rotvecs rotvec rotation_vectors rotation_vector axis_angle axis_angles",
    ),
    _Quantity(("rw",), {}, "rot_w rotation_w"),
    _Quantity(
        EULER,
        RADIANS,
        "euler_* euler_angle_* euler_angles_* rpy_*",
        "rpy roll_pitch_yaw",
    ),
    _Quantity(MATRIX, {}, "r_* m* m_* rot_* rotation_* mat_* matrix_* rotmat_*"),
    _Quantity(SIX_NUMBERS, {}, "rot6d_* rot_6d_* rotation_6d_* d6_* 6d_*"),
    _Quantity(FORCE[:3], {"n": 1.0}, "force_*"),
    _Quantity(FORCE[3:], _NEWTON_METRES, "torque_*"),
    _Quantity(FORCE, {}, arrays="force forces wrench wrenches"),
    _Quantity(("gripper",), {}, "gripper_position gripper_width", "gripper"),
)
"""All names that are understood."""

ARRAYS: Final = {
    name: kind.columns for kind in _QUANTITIES for name in kind.arrays.split()
}
_ORIENTED: Final = re.compile(
    r"(?:q|quat|quaternion|orientation|ori|orient|rot|rotation|attitude|mat|matrix|"
    r"matrice|rotmat|rot_mat|rotation_matrix|rotation_matrice|euler|euler_angle|ypr|"
    r"rot_6d|rot6d|rotation_6d)s?(?:_site)?(_wxyz|_xyzw)?"
)
"""Names of arrays of orientations; their shape, or --angles, says in which form."""
_UNITS: Final = {kind.columns: kind.units for kind in _QUANTITIES}
_AXES: Final = dict(zip(EULER, POSITION, strict=True))
_CANONICAL: Final = {
    alias.replace("*", _AXES.get(column, column[1:] or column)): column
    for kind in _QUANTITIES
    for column in kind.columns
    for alias in (column, *kind.names.split())
}
_ALL_UNITS: Final = frozenset().union(*_UNITS.values())
UNIT_WORDS: Final = dict(
    re.findall(
        r"(\w+):(\w+)",
        "seconds:s sec:s milliseconds:ms meters:m metres:m centimeters:cm inches:in "
        "millimeters:mm millimetres:mm degrees:deg radians:rad",
    )
)
_BRACKETED: Final = re.compile(r"(.*?)[\s_]*[\[(]\s*([^\])]*?)\s*[\])]")
_OF_ANOTHER: Final = re.compile(
    r"\b(vel\w*|speed|twist|acc\w*|rate|target|goal|desired|cmd|command\w*|std|cov\w*|"
    r"error|linear|angular)\b"
)
"""Words before a name that make it another quantity."""
_MANY_TURNS: Final = 7.0
"""Larger angles [rad] are probably in degrees."""

Columns = Mapping[str, tuple[FloatArray, str | None]]
"""Values, (N,), and unit of columns, by the names of this module."""


def understood(head: str) -> tuple[str | None, str | None, str]:
    """Return name and unit of a column, None if not known, and whose column it is."""
    text = re.sub(r"(?<=[a-z])(?=[A-Z])", "_", head.strip()).lower()
    unit = "ns" if text == "%time" else None  # Of rostopic echo -p.
    if match := _BRACKETED.fullmatch(text):
        text, unit = match[1], UNIT_WORDS.get(match[2], match[2])
        if unit not in _ALL_UNITS:
            return None, None, ""
    words = re.findall(r"[^\W_]+", text)
    if unit is None and len(words) > 1 and "_".join(words) not in _CANONICAL:
        last = UNIT_WORDS.get(words[-1], words[-1])
        unit = last if last in _ALL_UNITS - {"n"} else None
        words = words[:-1] if unit else words
    for start in range(len(words)):
        rest = words[start:]
        name = _CANONICAL.get("_".join(rest))
        # A name alone is that of something only if no other quantity has it.
        clear = len(rest) > 1 or name in {*QUATERNION, *EULER}
        clear = clear and not _OF_ANOTHER.search(" ".join(words[:start]))
        if name is not None and (start == 0 or clear):
            return name, unit, " ".join(words[:start])
    return None, None, ""


def listed(names: Iterable[str]) -> str:
    """Return names as a text of limited length, cut between two names."""
    return textwrap.shorten(", ".join(names), 200, placeholder=" …")


def renamed(heads: Sequence[str], columns: Sequence[str]) -> Sequence[str]:
    """Return the heads of a table with the names of ``--columns``.

    These are names in the order of the columns, or ``NAME=HEAD`` for some of them.
    """
    if not any("=" in column for column in columns):
        return columns or heads
    names = {
        head.strip(): name for name, _, head in (c.partition("=") for c in columns)
    }
    if unknown := names.keys() - {head.strip() for head in heads}:
        raise ValueError(
            f"--columns names {listed(sorted(unknown))}, and the columns are "
            f"{listed(heads)}"
        )
    return [names.get(head.strip(), head) for head in heads]


def named_columns(
    heads: Sequence[str], where: str, body: str | None = None
) -> dict[str, tuple[int, str | None]]:
    """Return index and unit of every known column, of one body if several have them.

    Raises:
        ValueError: x or y is missing, an orientation is incomplete, or a column is
            repeated; ``where`` describes the headings.
    """
    if any(re.search(r"[a-z_]3_?3$", head.lower()) for head in heads):
        # Rows and columns of a matrix that are counted from 1.
        one_based = re.compile(r"(?<=[A-Za-z_])([1-3])_?([1-3])$")
        heads = [
            one_based.sub(lambda m: f"{int(m[1]) - 1}{int(m[2]) - 1}", head)
            for head in heads
        ]
    wanted = set(re.findall(r"[^\W_]+", (body or "").lower()))
    candidates: dict[str, list[tuple[int, str, int, str | None]]] = {}
    for place, head in enumerate(heads):
        name, unit, owner = understood(head)
        if name is not None:
            # Those of the chosen body, of none, and of bodies rather than of markers.
            chosen = bool(wanted) and wanted <= set(owner.split())
            rank = 0 if chosen else 3 if "marker" in owner else 2 if owner else 1
            candidates.setdefault(name, []).append((rank, owner, place, unit))
    columns: dict[str, tuple[int, str | None]] = {}
    for name, several in candidates.items():
        least = min(rank for rank, *_ in several)
        (_, owner, place, unit), *others = (one for one in several if one[0] == least)
        if others:
            owners = sorted({owner, *(other[1] for other in others)} - {""})
            choice = f"choose with --body: {', '.join(owners)}; or " if owners else ""
            raise ValueError(
                f"{where} has two columns for {name}; {choice}name those to leave out "
                "'-' with --columns"
            )
        columns[name] = (place, unit)
    if "rw" in columns:  # A quaternion, and no rotation vector.
        for letter in "wxyz":
            if f"r{letter}" in columns:
                columns[f"q{letter}"] = columns.pop(f"r{letter}")
    if any(head.strip().lower() == "q4" for head in heads):  # Joints of a robot.
        columns = {name: at for name, at in columns.items() if name not in NUMBERED}
    for whole in (("x", "y"), *ORIENTATIONS):
        missing = [name for name in whole if name not in columns]
        if missing and (whole[0] == "x" or len(missing) < len(whole)):
            raise ValueError(
                f"{where} has no column {' and no '.join(missing)}: it has "
                f"{listed(heads)}. Name the columns in their order, for example "
                "--columns t,x,y,z,qx,qy,qz,qw with - for one to leave out, or some of "
                "them, --columns x=HEAD,y=HEAD; joint positions are not a hand pose"
            )
    return columns


def recording(
    name: str,
    columns: Columns,
    settings: ImportSettings,
    untimed: str = "",
    unused: Iterable[str] = (),
) -> RawRecording:
    """Return the motion in columns with the names of this module.

    Raises:
        ValueError: A unit does not fit the quantity, or the units of x, y and z differ.
    """
    notes: list[str] = []
    unused = [head for head in unused if head.strip() not in ("", "-")]

    def unit_of(names: Form) -> str | None:
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

    def overridden(option: str, wanted: str | None, stated: str | None) -> None:
        if wanted is not None and stated not in (None, wanted):
            notes.append(
                f"{option} read in {wanted}, although the file states {stated}"
            )

    quaternions, wrenches, times, reading = None, None, None, ""
    form = next((whole for whole in ORIENTATIONS if whole[0] in columns), None)
    sequence, unit = angles_of(settings.angles)
    if form is not None:
        values, numbered = stacked(form), form == NUMBERED
        if numbered:
            form = XYZW if settings.quaternions == "xyzw" else QUATERNION
        if numbered and settings.quaternions is None:
            notes.append(
                "q0 is taken as the scalar part; say --quaternions xyzw if it is q3"
            )
        if form == ROTATION_VECTOR and sequence is not None:
            stated, form = unit_of(form), EULER
        else:
            stated = unit_of(form) if form in _UNITS else None
        angles = unit or stated or "rad"
        quaternions = quaternions_of(form, values, angles, sequence or "xyz")
        if form in (MATRIX, SIX_NUMBERS):
            reading = "rotation matrices row by row"
        if form in (ROTATION_VECTOR, EULER):
            overridden("angles", unit, stated)
            sizes = np.linalg.norm(values, axis=1)
            if form == EULER:
                sizes = np.abs(values).max(axis=1)
                reading = f"Euler angles, --angles euler-{sequence or 'xyz'}"
            else:
                reading = "rotation vectors (Euler angles need --angles euler-xyz)"
            if form == EULER and sequence is None:
                notes.append(
                    "Euler angles are taken as about fixed x, y and z; if this is "
                    "wrong, say --angles euler-ZYX, or in another order"
                )
            longest = RADIANS[angles] * float(np.nanmax(sizes, initial=0.0))
            if angles == "rad" and longest > _MANY_TURNS:
                notes.append(
                    f"angles as large as {longest:.3g} rad are many turns: are they "
                    "degrees? say --angles deg"
                )
            elif form == ROTATION_VECTOR and longest > 3.2:
                notes.append(
                    f"rotation vectors as long as {longest:.3g} rad are more than half "
                    "a turn: are they Euler angles? say --angles euler-xyz"
                )
    if settings.angles is not None and "ngle" not in reading:
        notes.append("--angles has no effect: it has no angles")
    if settings.quaternions is not None and "q0" not in columns:
        notes.append("--quaternions has no effect: names give the order, if any")
    if "secs" in columns and "t" not in columns:
        seconds = columns["secs"][0] - np.nanmin(columns["secs"][0])
        nanoseconds = columns.get("nsecs", (np.zeros(len(seconds)), None))[0]
        columns = {**columns, "t": (seconds + 1e-9 * nanoseconds, "s")}
    if "t" in columns:
        times, stated = columns["t"][0], unit_of(("t",))
        overridden("times", settings.time_unit, stated)
        read_as = settings.time_unit or stated or "s"
        steps = np.diff(np.sort(times[np.isfinite(times)]))
        step = float(np.median(steps[steps > 0.0])) if (steps > 0.0).any() else 0.0
        likely = likely_time_unit(step)
        contradicted = settings.time_unit is None or stated not in (None, read_as)
        if contradicted and likely not in (None, read_as):
            notes.append(
                f"there is a sample every {step:.3g} {read_as}: are times in {likely}? "
                f"say --time-unit {likely}, or --time-unit {read_as} if they are not"
            )
        times = times * SECONDS[read_as]
    elif settings.time_unit is not None:
        notes.append("--time-unit has no effect: it has no time stamps")
    present = columns.keys() & set(FORCE)
    if present and present <= set(FORCE[3:]):
        unused += sorted(present)  # Such as those of a magnetometer.
    elif present:
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
    if unused:
        notes.append(f"columns {listed(unused)} are not used")
    return RawRecording(
        name=name,
        positions=stacked(POSITION),
        unit=unit_of(POSITION),
        times=times,
        quaternions=quaternions,
        reading=reading,
        wrenches=wrenches,
        signals={"gripper": stacked(["gripper"])} if "gripper" in columns else {},
        untimed="" if "t" in columns else untimed,
        notes=tuple(notes),
    )


def orientation_form(
    name: str, shape: tuple[int, ...], settings: ImportSettings, order: str = ""
) -> Form | None:
    """Return the form of an array of orientations, None if its name is of none.

    Args:
        name: Name of the array, without that of what moves.
        shape: Its shape, (N, C), (C, N) or (N, 3, 3).
        settings: Say the order of quaternions and the form of angles.
        order: Order of quaternions that the kind of file has, if known.

    Raises:
        ValueError: Its form is neither known nor given.
    """
    name = "_".join(re.findall(r"[^\W_]+", name.lower()))
    if ARRAYS.get(name) in ORIENTATIONS or ARRAYS.get(name) == XYZW:
        return ARRAYS[name]
    match = _ORIENTED.fullmatch(name)
    if match is None:
        return None
    sequence, _ = angles_of(settings.angles)
    if shape[-2:] == (3, 3) or shape[:2] == (3, 3) or 9 in shape:
        return MATRIX
    if 4 in shape:
        order = (match[1] or "").strip("_") or order or settings.quaternions or ""
        if not order:
            raise ValueError(
                f"the place of the scalar part of {name!r} is unknown: give "
                "--quaternions wxyz or --quaternions xyzw"
            )
        return XYZW if order == "xyzw" else QUATERNION
    if 6 in shape:
        return SIX_NUMBERS
    if 3 in shape and "ypr" in name:
        return EULER[::-1]
    if 3 in shape and (sequence is not None or "euler" in name):
        by_axis = dict(zip("xyz", EULER, strict=True))
        letters = (sequence or "xyz").lower()
        return tuple(by_axis[a] for a in letters) if len(set(letters)) == 3 else EULER
    if 3 not in shape:
        return None
    raise ValueError(
        f"the form of the orientations {name!r} {shape} is unknown: give --angles "
        "euler-xyz for Euler angles, or name the array rotvec for rotation vectors"
    )


def quaternions_of(
    form: Form, values: FloatArray, angles: str = "rad", sequence: str = "xyz"
) -> FloatArray:
    """Return orientations as quaternions, scalar first, (N, 4); NaN where not known.

    Args:
        form: One of `ORIENTATIONS`, in any order.
        values: The columns of this form, (N, C).
        angles: Unit of angles among them, one of `RADIANS`.
        sequence: Axes of Euler angles as in SciPy, in capitals if they turn with the
            body. Roll, pitch and yaw are about x, y and z, or in the order of a
            sequence that repeats an axis.

    Raises:
        ValueError: A matrix is no rotation.
    """
    for whole in ORIENTATIONS:
        if set(form) == set(whole):
            values = values[:, [form.index(name) for name in whole]]
            form = whole
    if form in (QUATERNION, NUMBERED):
        return values
    if form == ROTATION_VECTOR:
        rotations = Rotation.from_rotvec(values * RADIANS[angles])
        return rotations.as_quat(scalar_first=True)
    if form == EULER:
        axes = ["xyz".index(axis) for axis in sequence.lower()]
        ordered = values[:, axes] if len(set(axes)) == 3 else values
        rotations = Rotation.from_euler(sequence, ordered * RADIANS[angles])
        return rotations.as_quat(scalar_first=True)
    rows = values.reshape(len(values), -1, 3)
    usable = np.isfinite(values).all(axis=1) & values.any(axis=1)
    error = np.abs(rows @ rows.transpose(0, 2, 1) - np.eye(rows.shape[1]))[usable]
    if error.max(initial=0.0) > _ORTHONORMAL:
        raise ValueError(
            f"rotation matrices are {error.max():.2g} off orthonormal; are these all "
            "of their columns?"
        )
    if form == SIX_NUMBERS:
        third = np.cross(rows[:, 0], rows[:, 1])[:, None]
        rows = np.concatenate([rows, third], axis=1)
    quaternions = np.full((len(values), 4), np.nan)
    turned = Rotation.from_matrix(rows[usable])
    quaternions[usable] = turned.as_quat(scalar_first=True)
    return quaternions
