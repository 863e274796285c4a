"""Columns with names and units, for all kinds of tables, and tables in text files.

Names end with the unit, ``time [ms]``, ``x (cm)``, ``y_mm``, and may follow the name of
what moves, ``hand.position.x``. Other columns are not used.
"""

import csv
import io
import itertools
import math
import re
import textwrap
from array import array
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from datetime import UTC, datetime
from functools import partial
from pathlib import Path
from typing import Final

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

Names = tuple[str, ...]
Columns = Mapping[str, tuple[FloatArray, str | None]]
"""Values, (N,), and unit of columns, by the names of this module."""
POSITION: Final = ("x", "y", "z")
QUATERNION: Final = ("qw", "qx", "qy", "qz")
XYZW: Final = ("qx", "qy", "qz", "qw")
NUMBERED: Final = ("q0", "q1", "q2", "q3")
ROTATION_VECTOR: Final = ("rx", "ry", "rz")
EULER: Final = ("roll", "pitch", "yaw")
MATRIX: Final = tuple(f"r{row}{column}" for row in range(3) for column in range(3))
SIX_NUMBERS: Final = tuple(f"d{place}" for place in range(6))
FORCE: Final = ("fx", "fy", "fz", "mx", "my", "mz")
_FORMS: Final = (QUATERNION, NUMBERED, ROTATION_VECTOR, EULER, MATRIX, SIX_NUMBERS)
"""Columns of each form of an orientation, of which the first in a table is used.
Quaternions with numbers are in the order of `ImportSettings.quaternions`, matrices row
by row, and six numbers are their first two rows."""
ORIENTED: Final = frozenset().union(*_FORMS)
_NAMES: Final[Mapping[Names, str]] = {
    ("t",): "time timestamp time_stamp stamp seconds header_stamp",
    ("secs",): "sec stamp_secs stamp_sec",
    ("nsecs",): "nsec nanosec nanosecs nanoseconds stamp_nsecs stamp_nanosec",
    POSITION: "p* p_* pos_* position_* translation_* location_*",
    QUATERNION: "q_* quat_* quaternion_* orientation_* ori_* orient_* attitude_*",
    NUMBERED: "q_* quat_* quaternion_* orientation_*",
    ROTATION_VECTOR: "rotvec_* rot_* rotation_* axis_angle_* axisangle_*",
    ("rw",): "rot_w rotation_w",
    EULER: "euler_* euler_angle_* euler_angles_* rpy_*",
    MATRIX: "r_* m* m_* rot_* rotation_* mat_* matrix_* rotmat_*",
    SIX_NUMBERS: "rot6d_* rot_6d_* rotation_6d_* d6_* 6d_*",
    FORCE[:3]: "force_*",
    FORCE[3:]: "torque_*",
    ("gripper",): "gripper_position gripper_width",
}
"""Other names of columns; ``*`` stands for a column without its first letter, or for
the axis of roll, pitch and yaw."""
_NAMES_OF_ARRAYS: Final[Mapping[Names, str]] = {
    ("t",): "times time t timestamps",
    POSITION: "positions position pos p xyz",
    QUATERNION: "quaternions_wxyz quat_wxyz q_wxyz",
    XYZW: "quaternions_xyzw quat_xyzw q_xyzw",
    ROTATION_VECTOR: "rotvecs rotvec rotation_vectors rotation_vector "
    "axis_angle axis_angles",
    EULER: "rpy roll_pitch_yaw",
    FORCE: "force forces wrench wrenches",
    ("gripper",): "gripper",
}
"""Names of arrays that have all columns of a quantity."""
_UNITS: Final[Mapping[Names, Mapping[str, float]]] = {
    ("t",): SECONDS,
    POSITION: METRES,
    ROTATION_VECTOR: RADIANS,
    EULER: RADIANS,
    FORCE[:3]: {"n": 1.0},
    FORCE[3:]: {"nm": 1.0, "n m": 1.0, "nmm": 1e-3, "n mm": 1e-3},
}
_ALL_UNITS: Final = frozenset().union(*_UNITS.values())
_AXES: Final = dict(zip(EULER, POSITION, strict=True))
_CANONICAL: Final = {
    alias.replace("*", _AXES.get(column, column[1:] or column)): column
    for columns, names in _NAMES.items()
    for column in columns
    for alias in (column, *names.split())
}
ARRAYS: Final = {
    name: columns
    for columns, names in _NAMES_OF_ARRAYS.items()
    for name in names.split()
}
_TURNING: Final = re.compile(
    r"(?:q|quat|quaternion|orientation|ori|orient|rot|rotation|attitude|mat|matrix|"
    r"matrice|rotmat|rot_mat|rotation_matrix|rotation_matrice|euler|euler_angle|ypr|"
    r"rot_6d|rot6d|rotation_6d)s?(?:_site)?(_wxyz|_xyzw)?"
)
"""Names of arrays of orientations; their shape, or --angles, says in which form."""
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
_READINGS: Final[Mapping[Names, str]] = {
    **dict.fromkeys((MATRIX, SIX_NUMBERS), "rotation matrices row by row"),
    **dict.fromkeys((QUATERNION, XYZW), ""),
    ROTATION_VECTOR: "rotation vectors (Euler angles need --angles euler-xyz)",
}
_ORTHONORMAL: Final = 0.1  # Largest error of R Rᵀ of a rotation matrix R.
_MANY_TURNS: Final = 7.0  # Larger angles [rad] are probably in degrees.
_HALF_TURN: Final = 3.2  # Longer rotation vectors [rad] are probably none.
_FASTEST_TURN: Final = 20.0  # Faster hands [rad/s] are probably recorded in degrees.
_CHORD: Final = 0.05  # Time over which a hand turns for this speed [s].
_MISSING: Final = frozenset(("", "-", "na", "n/a", "#n/a", "null", "none", "nil"))
_MOST_HEADS: Final = 100  # Largest number of lines before the first sample.


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
        name = _CANONICAL.get("_".join(words[start:]))
        # A name alone is that of something only if no other quantity has it.
        clear = start < len(words) - 1 or name in {*QUATERNION, *EULER}
        clear |= name in POSITION and unit in METRES
        owner = " ".join(words[:start])
        clear = not owner or (clear and not _OF_ANOTHER.search(owner))
        if name is not None and clear:
            return name, unit, owner
    return None, None, ""


def listed(names: Iterable[str]) -> str:
    """Return names as a text of limited length, cut between two names."""
    return textwrap.shorten(", ".join(names), 200, placeholder=" …")


def renamed(heads: Sequence[str], columns: Sequence[str]) -> Sequence[str]:
    """Return heads with names of ``--columns``: in their order, or ``NAME=HEAD``."""
    if not any("=" in column for column in columns):
        return columns or heads
    pairs = (column.partition("=") for column in columns)
    names = {head.strip(): name for name, _, head in pairs}
    if unknown := names.keys() - {head.strip() for head in heads}:
        raise ValueError(f"--columns: {listed(unknown)} is none of {listed(heads)}")
    return [names.get(head.strip(), head) for head in heads]


def named_columns(
    heads: Sequence[str], where: str, body: str | None = None
) -> dict[str, tuple[int, str | None]]:
    """Return index and unit of every known column, of one body if several have them.

    ValueError: one is missing or repeated; ``where`` describes the headings.
    """
    if any(re.search(r"[a-z_]3_?3$", head.lower()) for head in heads):
        # Rows and columns of a matrix that are counted from 1.
        place = re.compile(r"(?<=[A-Za-z_])([1-3])_?([1-3])$")
        heads = [place.sub(lambda m: f"{int(m[1] + m[2]) - 11:02}", h) for h in heads]
    wanted = set(re.findall(r"[^\W_]+", (body or "").lower()))
    candidates: dict[str, list[tuple[int, str, int, str | None]]] = {}
    for at, head in enumerate(heads):
        name, unit, owner = understood(head)
        if name is not None:
            # Those of the chosen body, of none, and of bodies rather than of markers.
            chosen = bool(wanted) and wanted <= set(owner.split())
            rank = 0 if chosen else 3 if "marker" in owner else 2 if owner else 1
            candidates.setdefault(name, []).append((rank, owner, at, unit))
    columns: dict[str, tuple[int, str | None]] = {}
    for name, several in candidates.items():
        best = [candidate for candidate in several if candidate[0] == min(several)[0]]
        columns[name] = best[0][2:]
        if len(best) > 1:
            owners = ", ".join(sorted({owner for _, owner, *_ in best} - {""}))
            raise ValueError(
                f"{where} has two columns for {name}; choose by --body: "
                f"{owners or '(none)'}; or name those to leave out '-' with --columns"
            )
    if "rw" in columns:  # A quaternion, and no rotation vector.
        columns |= {f"q{n}": columns.pop(f"r{n}") for n in "wxyz" if f"r{n}" in columns}
    if any(head.strip().lower() == "q4" for head in heads):  # Joints of a robot.
        columns = {name: at for name, at in columns.items() if name not in NUMBERED}
    for whole in (("x", "y"), *_FORMS):
        missing = [name for name in whole if name not in columns]
        if missing and (whole[0] == "x" or len(missing) < len(whole)):
            raise ValueError(
                f"{where} has no column {' and no '.join(missing)}: it has "
                f"{listed(heads)}. Name all in their order, --columns t,x,y,z,... with "
                "- for one to leave out, or some, --columns x=HEAD,y=HEAD"
            )
    return columns


def _turned(
    form: Names,
    values: FloatArray,
    unit: str,
    times: FloatArray,
    settings: ImportSettings,
    notes: list[str],
) -> tuple[FloatArray, str]:
    """Return quaternions, and what they were read from; note what is doubtful."""
    sequence, _ = angles_of(settings.angles)
    angles = form in (ROTATION_VECTOR, EULER)
    used = EULER if angles and sequence is not None else form
    if used == NUMBERED:
        used = XYZW if settings.quaternions == "xyzw" else QUATERNION
        if settings.quaternions is None:
            notes.append("q0 is taken as scalar; if q3 is, say --quaternions xyzw")
    if used == EULER and sequence is None:
        notes.append("Euler angles are taken as --angles euler-xyz: is it right?")
    quaternions = quaternions_of(used, values, unit, sequence or "xyz")
    reading = _READINGS.get(used, f"Euler angles, --angles euler-{sequence or 'xyz'}")
    if angles and unit == "rad":
        numbers, problem = np.nan_to_num(values), ""
        largest = float(np.linalg.norm(numbers, axis=1).max())
        if largest > (_HALF_TURN if used == ROTATION_VECTOR else _MANY_TURNS):
            problem = f"as large as {largest:.3g} rad"
        # The speed [rad/s] above which the hand turns a quarter of the time.
        usable = np.isfinite(quaternions).all(axis=1) & np.isfinite(times)
        turned, clock, speed = quaternions[usable], times[usable], 0.0
        if not problem and usable.any() and np.ptp(clock) > 0.0:
            reach = math.ceil(_CHORD * len(clock) / np.ptp(clock))
            steps = clock[reach:] - clock[:-reach]
            overlap = np.abs(np.einsum("ij,ij->i", turned[reach:], turned[:-reach]))
            speeds = (2.0 * np.arccos(np.minimum(overlap, 1.0)))[steps > 0.0]
            speeds /= steps[steps > 0.0]
            speed = float(np.quantile(speeds, 0.75)) if speeds.size else 0.0
        if speed > _FASTEST_TURN:
            problem = f"that turn the hand by {speed:.0f} rad/s"
        if problem:
            column = form[np.ptp(numbers, axis=0).argmax()]
            notes.append(
                f"angles {problem}, mostly {column}: are they degrees? say --angles "
                "deg, or of Euler angles --angles euler-xyz or euler-xyz-deg"
            )
    return quaternions, reading


def recording(
    name: str, columns: Columns, settings: ImportSettings, unused: Iterable[str] = ()
) -> RawRecording:
    """Return the motion in columns; raise ValueError if a unit does not fit them."""
    notes: list[str] = []
    no_quantity = ("", "-", "frame", "index")
    unused = [head for head in unused if head.strip().lower() not in no_quantity]

    def quantity(
        names: Names, wanted: str | None = None, what: str = ""
    ) -> tuple[FloatArray, str | None]:
        """Return values, (N, d), zero if absent, and the unit in which they are."""
        units = {columns[name][1] for name in names if name in columns} - {None}
        allowed = _UNITS.get(names, {})
        if len(units) > 1 or units - set(allowed):
            several = " and ".join(sorted(map(str, units)))
            raise ValueError(
                f"{name}: {', '.join(names)} are in {several}; they must share one "
                f"unit of {', '.join(allowed)}"
            )
        stated = next(iter(units), None)
        if wanted is not None and stated not in (None, wanted):
            notes.append(f"{what} read in {wanted}, although the file states {stated}")
        absent = np.zeros(len(columns["x"][0])), None
        values = [columns.get(column, absent)[0] for column in names]
        return np.column_stack(values), wanted or stated

    form = next((whole for whole in _FORMS if whole[0] in columns), None)
    turning = form in (ROTATION_VECTOR, EULER)
    for option, has_effect in (
        ("angles", turning),
        ("quaternions", form == NUMBERED),
        ("time_unit", not columns.keys().isdisjoint(("t", "secs"))),
    ):
        if getattr(settings, option) is not None and not has_effect:
            notes.append(f"--{option.replace('_', '-')} has no effect on its columns")
    turns, wrenches, times, reading = None, None, None, ""
    if "secs" in columns and "t" not in columns:
        seconds = columns["secs"][0] - np.nanmin(columns["secs"][0])
        nanoseconds = columns.get("nsecs", (np.zeros(len(seconds)), None))[0]
        columns = {**columns, "t": (seconds + 1e-9 * nanoseconds, "s")}
    if "t" in columns:
        stamps, unit = quantity(("t",), settings.time_unit, "times")
        times, unit = stamps[:, 0], unit or "s"
        steps = np.diff(np.sort(times[np.isfinite(times)]))
        # Stamps that repeat are coarser than the samples are apart.
        later = steps > 0.0
        step = float(np.median(steps[later]) * later.mean()) if later.any() else 0.0
        likely = likely_time_unit(step)
        contradicted = settings.time_unit is None or columns["t"][1] not in (None, unit)
        if contradicted and likely not in (None, unit):
            notes.append(
                f"there is a sample every {step:.3g} {unit}: are times in {likely}? "
                f"say --time-unit {likely}, or --time-unit {unit} if they are not"
            )
        times = times * SECONDS[unit]
    if form is not None:
        _, unit = angles_of(settings.angles)
        values, unit = quantity(form, unit if turning else None, "angles")
        clock, rate = times, settings.recorded_rate
        if clock is None or rate is not None:
            clock = np.arange(len(values)) / (rate or 1.0)
        turns, reading = _turned(form, values, unit or "rad", clock, settings, notes)
    measured = columns.keys() & set(FORCE)
    if set(FORCE[:3]) <= measured:
        (forces, _), (moments, unit) = quantity(FORCE[:3]), quantity(FORCE[3:])
        wrenches = np.hstack([forces, _UNITS[FORCE[3:]][unit or "nm"] * moments])
        if not set(FORCE[3:]) <= measured:
            notes.append("forces without moments: taken as zero about the sensor")
    else:
        unused += sorted(measured)  # Such as those of a magnetometer.
    unused += sorted(ORIENTED & columns.keys() - set(form or ()))
    if unused:
        notes.append(f"columns {listed(unused)} are not used")
    positions, unit = quantity(POSITION)
    signals = {"gripper": quantity(("gripper",))[0]} if "gripper" in columns else {}
    motion = RawRecording(name, positions, unit, times, turns, reading, wrenches)
    return replace(motion, signals=signals, notes=tuple(notes))


def array_columns(name: str, shape: tuple[int, ...], settings: ImportSettings) -> Names:
    """Return the columns of an array of a shape, none if its name is not understood.

    Raises ValueError for orientations whose form neither name nor settings say.
    """
    name = "_".join(re.findall(r"[^\W_]+", name.lower()))
    match = _TURNING.fullmatch(name)
    if name in ARRAYS or match is None:
        return ARRAYS.get(name, ())
    width = next((width for width in (9, 4, 6, 3) if width in shape), 0)
    order = (match[1] or "").strip("_") or settings.quaternions or ""
    sequence, _ = angles_of(settings.angles)
    axes = "zyx" if "ypr" in name else sequence or "xyz" * ("euler" in name)
    if width == 9 or (3, 3) in (shape[-2:], shape[:2]):
        return MATRIX
    if width == 4 and order:
        return XYZW if order == "xyzw" else QUATERNION
    if width == 6:
        return SIX_NUMBERS
    if width == 3 and axes:
        by_axis = tuple(EULER["xyz".index(axis)] for axis in axes.lower())
        return by_axis if len(set(by_axis)) == 3 else EULER
    if not width:
        return ()
    raise ValueError(
        f"the form of the orientations {name!r} {shape} is unknown: give --quaternions "
        "wxyz or --quaternions xyzw for the place of the scalar part, --angles "
        "euler-xyz for Euler angles, or name the array rotvec for rotation vectors"
    )


def quaternions_of(
    form: Names, values: FloatArray, angles: str = "rad", sequence: str = "xyz"
) -> FloatArray:
    """Return orientations (N, C) of a form as quaternions, scalar first, (N, 4).

    Angles have a unit of `RADIANS`, Euler angles a sequence of SciPy. Roll, pitch and
    yaw are about x, y and z, or in the order of a sequence that repeats an axis. What
    is not known is NaN. Raises ValueError if a matrix is no rotation.
    """
    if form in (QUATERNION, XYZW):
        return values if form == QUATERNION else values[:, [3, 0, 1, 2]]
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
    quaternions[usable] = Rotation.from_matrix(rows[usable]).as_quat(scalar_first=True)
    return quaternions


def text_of(path: Path) -> str:
    """Return the text of a file in Unicode, by its first bytes, or in Latin-1."""
    content, encoding = path.read_bytes(), "utf-8-sig"
    if content[:2] in (b"\xff\xfe", b"\xfe\xff"):
        encoding = "utf-16"
    elif b"\0" in content[:2]:
        encoding = "utf-16-be" if content[:1] == b"\0" else "utf-16-le"
    try:
        return content.decode(encoding)
    except UnicodeDecodeError:
        return content.decode("latin-1")


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motion in a table of a text file; errors contain the line number.

    Columns are separated by comma, semicolon, bar, tab or spaces. Unless commas
    separate columns, numbers may have decimal commas. Lines of names are joined, as of
    Motive and Vicon, and a line of units may follow them.
    """
    # Every line that is neither empty nor a comment, with its number.
    lines = [
        (number, line.strip("\r\n"))
        for number, line in enumerate(io.StringIO(text_of(path), newline=""), start=1)
        if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        raise ValueError("it is empty")
    if separated := re.fullmatch(r"sep=(.+)", lines[0][1].strip(" \"'")):
        lines.pop(0)
        delimiter = separated[1].replace("\\t", "\t")
    else:
        text = lines[:_MOST_HEADS][-1][1]
        marks = [*(mark for mark in "\t;|," if mark in text), " "]
        delimiter = marks[0]
        for mark in reversed(marks):
            if all(_number(cell, mark) is not None for cell in _cells(text, mark)):
                delimiter = mark
    top = [_cells(text, delimiter) for _, text in lines[:_MOST_HEADS]]
    heads, first = _heads(top, settings, delimiter)
    where = "--columns" if settings.columns else "the header"
    places = named_columns(heads, where, settings.body)
    values = array("d")
    for number, text in lines[first:]:
        cells = _cells(text, delimiter)
        if len(cells) < len(heads) or any(cells[len(heads) :]):
            named = f"{len(heads)} are named: {listed(heads)}"
            raise ValueError(f"line {number} has {len(cells)} columns, and {named}")
        for name, (place, _) in places.items():
            value = _number(cells[place], delimiter)
            if value is None:
                raise ValueError(
                    f"line {number}, column {place + 1} ({name}): {cells[place]!r:.40} "
                    "is no number"
                )
            values.append(value)
    table = np.frombuffer(values).reshape(-1, len(places)).T
    columns = {
        name: (numbers, unit)
        for numbers, (name, (_, unit)) in zip(table, places.items(), strict=True)
    }
    if top[0][0] == "Format Version":  # What Motive states in its first line.
        stated = dict(zip(top[0][::2], top[0][1::2], strict=False))
        length = UNIT_WORDS.get(stated.get("Length Units", "").lower())
        for name in columns.keys() & set(POSITION):
            columns[name] = (columns[name][0], columns[name][1] or length)
        if settings.angles is None and "rx" in columns:
            euler = f"euler-{stated.get('Rotation Type', 'XYZ')}-deg"
            settings = replace(settings, angles=euler)
    used = {place for place, _ in places.values()}
    unused = [head for place, head in enumerate(heads) if place not in used]
    motion = recording(path.name, columns, settings, unused)
    if settings.body and not any(understood(head)[2] for head in heads):
        note = "--body has no effect: the names of its columns are of no body"
        motion = replace(motion, notes=(*motion.notes, note))
    return [motion]


def _heads(
    rows: list[list[str]], settings: ImportSettings, delimiter: str
) -> tuple[Sequence[str], int]:
    """Return the names of the columns, and the index of the row of the first sample."""
    columns = settings.columns
    in_order = columns if not any("=" in column for column in columns) else ()
    used = [at for at, head in enumerate(in_order) if understood(head)[0]]
    wanted = {column.partition("=")[2] for column in columns}
    last = 0
    for index, cells in enumerate(rows):
        numeric = [_number(cell, delimiter) is not None for cell in cells]
        names = [understood(cell)[0] for cell in cells]
        if in_order:
            if len(cells) >= len(in_order) and all(numeric[at] for at in used):
                return in_order, index
        elif len(cells) > 1 and cells[0] and all(numeric):
            if index == 0:
                raise ValueError(
                    f"its {len(cells)} columns have no names; give them in their "
                    "order, --columns t,x,y,z,..., with - for one to leave out"
                )
            last = index - 1
            break
        elif {"x", "y"} <= set(names) or (wanted and wanted <= set(cells)):
            heads = cells
            if len(set(names) - {None}) < len(names) - names.count(None):
                # The names of bodies and of quantities are in the lines above.
                filled = partial(itertools.accumulate, func=lambda a, b: b or a)
                lines = [row for row in rows[:index] if len(row) == len(cells)]
                above = [list(filled(line)) for line in lines]
                joined = map(" ".join, zip(*above, cells, strict=True))
                heads = [
                    cell if name == "t" else words.strip()
                    for cell, name, words in zip(cells, names, joined, strict=True)
                ]
            below = [cell.lower() for cell in rows[min(index + 1, len(rows) - 1)]]
            units = [UNIT_WORDS.get(cell, cell) for cell in below]
            if set(units) - {"", "-"} and set(units) <= _ALL_UNITS | {"", "-"}:
                pairs = zip(heads, units, strict=True)
                heads = [f"{h} [{u}]" if u in _ALL_UNITS else h for h, u in pairs]
                return renamed(heads, columns), index + 2
            return renamed(heads, columns), index + 1
    return renamed(rows[last], columns), min(last + 1, len(rows) - 1)


def _cells(text: str, delimiter: str) -> list[str]:
    if delimiter == " ":
        return text.split()
    return [cell.strip() for cell in next(csv.reader([text], delimiter=delimiter))]


def _number(cell: str, delimiter: str) -> float | None:
    """Return a number, seconds of a date or clock, NaN if missing, None of a text."""
    if cell.lower() in _MISSING:
        return float("nan")
    try:
        if ":" in cell:
            moment = datetime.fromisoformat("1970-01-01T" * ("-" not in cell) + cell)
            return moment.replace(tzinfo=moment.tzinfo or UTC).timestamp()
        return float(cell if delimiter == "," else cell.replace(",", "."))
    except ValueError:
        return None
