"""Arrays by name: what .npz, .npy and .mat files have in common, and the first two.

Understood are the columns of `readers.tables` as arrays (N,), the arrays of `GROUPS`
(N, d), a set of `gplfd_policies.demonstrations.npz`, and with ``--columns`` one array
(N, C) of columns, or (K, N, C) for K recordings. Samples may also stand in columns, as
MATLAB has them, where the shape leaves no doubt. An array of a .mat file is named by
where it stands, ``demos{2}.pos``: cells and structures of one name are recordings of
one set.
"""

import itertools
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, TypeVar

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.readers.selection import Selection, chosen
from gplfd_experiments.data.readers.tables import (
    FORCE,
    NAMES,
    POSITION,
    ROTATION_VECTOR,
    named_columns,
    quaternions_of,
    recording,
    understood,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.storage import array_of, read_arrays
from gplfd_policies.demonstrations.npz import KIND, load_demonstrations

_Any = TypeVar("_Any")

GROUPS: Final[Mapping[str, tuple[tuple[str, ...], tuple[str, ...]]]] = {
    "times": (("times", "time", "t", "timestamps"), ("t",)),
    "positions": (("positions", "position", "pos", "p", "xyz"), POSITION),
    "rotvecs": (("rotvecs", "rotvec", "rotation_vectors"), ROTATION_VECTOR),
    "wxyz": (("quaternions_wxyz", "quat_wxyz", "q_wxyz"), ("qw", "qx", "qy", "qz")),
    "xyzw": (("quaternions_xyzw", "quat_xyzw", "q_xyzw"), ("qx", "qy", "qz", "qw")),
    "quaternions": (("quaternions", "quaternion", "quat", "q"), ()),
    "force": (("force", "forces", "wrench", "wrenches"), FORCE),
    "gripper": (("gripper",), ("gripper",)),
}
"""Arrays that are understood: their names, and the columns that they hold."""

_INDEX: Final = re.compile(r"(\{\d+\}|\(\d+\))")
_ORDERS: Final = {"wxyz": GROUPS["wxyz"][1], "xyzw": GROUPS["xyzw"][1]}


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read recordings from an .npz or .npy file.

    Raises:
        ValueError: The file is damaged or holds no motion.
    """
    if path.is_dir():
        return _own(path)
    if path.suffix.lower() == ".npy":
        arrays = {"the array": array_of(path.read_bytes(), path.name)}
        return recordings(path.name, arrays, selection)
    arrays = read_arrays(path)
    if str(arrays.get("format", "")) == KIND:
        return _own(path)
    return recordings(path.name, arrays, selection)


def recordings(
    name: str, arrays: Mapping[str, NDArray[Any]], selection: Selection
) -> list[RawRecording]:
    """Return the recordings that named arrays hold.

    Args:
        name: Of the file.
        arrays: By name, of any kind and shape.
        selection: The array to take, its columns, the order of quaternions.

    Raises:
        ValueError: No motion can be found in them.
    """
    numbers = {
        key: np.asarray(array, dtype=np.float64)
        for key, array in arrays.items()
        if np.asarray(array).dtype.kind in "biuf"
    }
    if selection.columns:
        return [
            _from_table(f"{label}{suffix}", one, times, selection)
            for label, table, times in _tables(name, numbers, selection)
            for suffix, one in _each(table)
        ]
    motions = _motions(numbers)
    if not motions:
        raise ValueError(
            f"it has no array of positions: it has {_listed(numbers)}. Name one "
            "'positions' (N, 3), with 'times' (N,) and 'quaternions_wxyz' (N, 4); or "
            "say what the columns of an array are, --body NAME --columns t,x,y,z,... "
            "with - for one to leave out; --body A,B takes two arrays side by side"
        )
    _, group = chosen(selection.body, _sets(motions), "set of recordings", file=name)
    return [
        _from_arrays(label, one, selection) for label, one in _labelled(name, group)
    ]


def _sets(named: Mapping[str, _Any]) -> dict[str, dict[str, _Any]]:
    """Return what stands in cells or structures of one name as one set, in order."""
    sets: dict[str, dict[str, _Any]] = {}
    for key, one in named.items():
        sets.setdefault(_INDEX.sub("", key), {})[key] = one
    return sets


def _labelled(file: str, group: Mapping[str, _Any]) -> Iterator[tuple[str, _Any]]:
    """Yield the members of a set with names for them."""
    for key, one in group.items():
        yield (file if len(group) == 1 else f"{file}: {key}"), one


def _motions(arrays: Mapping[str, FloatArray]) -> dict[str, dict[str, FloatArray]]:
    """Return the arrays of every structure that has positions, or of the whole file.

    A structure may keep its recordings as cells, ``s.pos{1}`` with ``s.time{1}``, or
    with ``s.time`` for all.
    """
    found: dict[str, dict[str, dict[str, FloatArray]]] = {}
    for key, array in arrays.items():
        where, field, index = _parted(key)
        if array.size > 1:
            found.setdefault(where, {}).setdefault(index, {})[field] = array
    motions = {}
    for where, cells in found.items():
        shared = cells.pop("", {})
        own = {index: fields for index, fields in cells.items() if _has_motion(fields)}
        if own:
            for index, fields in own.items():
                motions[f"{where}{index}"] = shared | fields
        elif _has_motion(shared):
            # A single cell may hold the times of the only recording.
            single = next(iter(cells.values())) if len(cells) == 1 else {}
            motions[where] = single | shared
    return motions


def _parted(key: str) -> tuple[str, str, str]:
    """Return the structure of an array, its field in it, and the field's index."""
    where, _, field = key.rpartition(".")
    return where, _INDEX.sub("", field), "".join(_INDEX.findall(field))


def _has_motion(fields: Mapping[str, FloatArray]) -> bool:
    return any(
        understood(field)[0] == "x" or field.lower() in GROUPS["positions"][0]
        for field in fields
    )


def _tables(
    name: str, numbers: Mapping[str, FloatArray], selection: Selection
) -> Iterator[tuple[str, FloatArray, FloatArray | None]]:
    """Yield label, columns, and times of every recording in the chosen arrays.

    Several arrays, ``--body A,B``, are put side by side. Times that stand beside the
    columns, in the same structure or file, are theirs.
    """
    sets = _sets({key: a for key, a in numbers.items() if 1 <= a.ndim <= 3})
    body, parts = selection.body, [selection.body]
    if body is not None and body not in sets and "," in body:
        parts = [part.strip() for part in body.split(",")]
    else:
        sets = {
            key: s for key, s in sets.items() if all(_is_table(a) for a in s.values())
        }
    groups = [chosen(one, sets, "array of columns", file=name)[1] for one in parts]
    if len({len(group) for group in groups}) > 1:
        raise ValueError(
            f"{body} are of {' and '.join(str(len(one)) for one in groups)} recordings"
        )
    for keys in zip(*groups, strict=True):
        label = name if len(groups[0]) == 1 else f"{name}: {keys[0]}"
        yield (
            label,
            _side_by_side([numbers[key] for key in keys]),
            _times_beside(keys[0], numbers),
        )


def _is_table(array: FloatArray) -> bool:
    return array.ndim == 3 or (array.ndim == 2 and min(array.shape) > 1)


def _side_by_side(arrays: Sequence[FloatArray]) -> FloatArray:
    """Return the columns of all arrays as one, (N, C) or (K, N, C)."""
    if len(arrays) == 1:
        return arrays[0]
    rows = max(arrays[0].shape) if arrays[0].ndim < 3 else arrays[0].shape[1]
    tables = []
    for array in arrays:
        table = array[:, None] if array.ndim == 1 else array
        if table.ndim == 2 and len(table) != rows:
            table = table.T
        tables.append(table)
    if len({table.shape[:-1] for table in tables}) > 1:
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise ValueError(f"arrays of shapes {shapes} have not the same samples")
    return np.concatenate(tables, axis=-1)


def _times_beside(key: str, numbers: Mapping[str, FloatArray]) -> FloatArray | None:
    """Return the times in the structure of an array, or None."""
    where, _, index = _parted(key)
    for name, array in numbers.items():
        there, field, own = _parted(name)
        beside = there == where and own in ("", index)
        is_vector = array.size == max(array.shape, default=0)
        if beside and is_vector and field.lower() in GROUPS["times"][0]:
            return array.reshape(-1)
    return None


def _each(table: FloatArray) -> Iterator[tuple[str, FloatArray]]:
    if table.ndim == 2:
        yield "", table
    else:
        for number, one in enumerate(table):
            yield f"[{number}]", one


def _from_table(
    name: str, table: FloatArray, times: FloatArray | None, selection: Selection
) -> RawRecording:
    heads = selection.columns
    if table.shape[1] != len(heads) == table.shape[0]:
        table = table.T
    if table.shape[1] != len(heads):
        raise ValueError(
            f"the array has {table.shape[1]} columns, and --columns names {len(heads)}"
        )
    found = named_columns(heads, "--columns")
    columns = {column: table[:, place] for column, (place, _) in found.items()}
    units = {column: unit for column, (_, unit) in found.items()}
    if times is not None and "t" not in columns and len(times) == len(table):
        columns["t"] = times
    return recording(name, columns, units, selection)


def _from_arrays(
    name: str, arrays: Mapping[str, FloatArray], selection: Selection
) -> RawRecording:
    columns: dict[str, FloatArray] = {}
    units: dict[str, str | None] = {}
    for key, array in arrays.items():
        short, unit = understood(key)
        names = (short,) if short in NAMES else _group(name, key, selection)
        if not names:
            continue
        table = _as_table(name, key, array, len(names))
        for column, values in zip(names, table.T, strict=False):
            if column in columns:
                raise ValueError(f"it has two arrays for {column}, one is {key!r}")
            columns[column] = values
            units[column] = unit
    if not {"x", "y"} <= set(columns):
        raise ValueError(f"{name} has x and no y: it has {_listed(arrays)}")
    rows = {column: len(values) for column, values in columns.items()}
    if len(set(rows.values())) > 1:
        raise ValueError(f"its arrays differ in length: {rows}")
    untimed = (
        f": its arrays are {_listed(arrays)}. If one of them has the times, name it, "
        "for example --body POSITIONS,TIMES --columns x,y,z,t. Otherwise"
    )
    return recording(name, columns, units, selection, untimed)


def _group(name: str, key: str, selection: Selection) -> tuple[str, ...]:
    """Return the columns of an array, none if it is not understood."""
    for group, (keys, columns) in GROUPS.items():
        if key.lower() not in keys:
            continue
        if group != "quaternions":
            return columns
        if selection.quaternions is None:
            raise ValueError(
                f"it does not say where the scalar part of {key!r} stands: say "
                "--quaternions wxyz or --quaternions xyzw"
            )
        return _ORDERS[selection.quaternions]
    return ()


def _as_table(name: str, key: str, array: FloatArray, width: int) -> FloatArray:
    """Return an array as rows of samples; MATLAB has vectors as rows or columns."""
    if width == 1 and array.size == max(array.shape, default=0):
        return array.reshape(-1, 1)
    allowed = range({3: 2, 6: 3}.get(width, width), width + 1)
    if array.ndim == 2 and array.shape[1] not in allowed and array.shape[0] in allowed:
        array = array.T
    if array.ndim != 2 or array.shape[1] not in allowed:
        raise ValueError(f"{key!r} has shape {array.shape}, must be (N, {width})")
    return array


def _listed(arrays: Mapping[str, FloatArray]) -> str:
    shown = [
        f"{key} {array.shape}" for key, array in itertools.islice(arrays.items(), 12)
    ]
    if len(arrays) > len(shown):
        shown.append(f"{len(arrays) - len(shown)} more")
    return ", ".join(shown) or "no array of numbers"


def _own(path: Path) -> list[RawRecording]:
    """Read a set that this program wrote."""
    return [
        RawRecording(
            name=f"{path.name}[{number}]",
            times=one.times,
            positions=one.poses[:, :3],
            unit="m",
            quaternions=quaternions_of(one.poses[:, 3:]),
        )
        for number, one in enumerate(load_demonstrations(path).demonstrations)
    ]
