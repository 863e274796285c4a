"""Motions in named arrays, for .npz, .npy and .mat files; reads the first two.

Supported are columns (N,), the `ARRAYS` of tables (N, d), and with ``--columns`` one
array (N, C), or (K, N, C) for K motions; also transposed if the shape is unambiguous.
The arrays of .mat files are in cells and structures, ``demos{2}.pos``; those of one
name are motions of one set.
"""

import contextlib
import re
from collections.abc import Iterable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers.tables import (
    ARRAYS,
    POSITION,
    ROTATION_VECTOR,
    named_columns,
    orientation_form,
    quaternions_of,
    recording,
    renamed,
    understood,
)
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.npz import KIND, load_demonstrations

_Arrays = Mapping[str, FloatArray]

_INDEX: Final = re.compile(r"(\{\d+\}|\(\d+\))")


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read motions from an .npz or .npy file, or a set of demonstrations."""
    if not path.is_dir():
        with path.open("rb") as stream:
            loaded = np.load(stream, allow_pickle=False)
            if isinstance(loaded, np.ndarray):
                return recordings(path.name, {"the array": loaded}, settings)
            arrays = {}
            for name in loaded.files:
                with contextlib.suppress(ValueError):  # NumPy unpickles no objects.
                    arrays[name] = loaded[name]
        if str(arrays.get("format", "")) != KIND:
            return recordings(path.name, arrays, settings)
    return [
        RawRecording(
            name=f"{path.name}[{number}]",
            times=demonstration.times,
            positions=demonstration.poses[:, :3],
            unit="m",
            quaternions=quaternions_of(ROTATION_VECTOR, demonstration.poses[:, 3:]),
            wrenches=demonstration.wrenches,
            forces_on="object",
        )
        for number, demonstration in enumerate(load_demonstrations(path).demonstrations)
    ]


def recordings(
    name: str, arrays: Mapping[str, NDArray[Any]], settings: ImportSettings
) -> list[RawRecording]:
    """Return the motions in the named arrays of a file.

    Raises:
        ValueError: No motion can be found in them.
    """
    numbers = {
        key: np.asarray(array, dtype=np.float64)
        for key, array in arrays.items()
        if array.dtype.kind in "biuf"
    }
    if settings.columns and "=" not in settings.columns[0]:
        return _from_columns(name, numbers, settings)
    motions = _motions(numbers)
    if not motions:
        raise ValueError(
            f"it has no array of positions: it has {_listed(numbers)}. Name one "
            "'positions' (N, 3), with 'times' (N,) and 'quaternions_wxyz' (N, 4); or "
            "say what the columns of one array, or two side by side, are: --body A,B "
            "--columns t,x,y,z,... with - for one to leave out"
        )
    _, keys = chosen(settings.body, _sets(motions), "set of recordings", file=name)
    return [
        _from_names(
            name if len(keys) == 1 else f"{name}: {key}", motions[key], settings
        )
        for key in keys
    ]


def _parted(key: str) -> tuple[str, str, str]:
    """Return the structure of an array, its field in it, and the field's index."""
    where, _, field = key.rpartition(".")
    return where, _INDEX.sub("", field), "".join(_INDEX.findall(field))


def _sets(keys: Iterable[str]) -> dict[str, list[str]]:
    """Return the cells or structures of one name as one set, in order."""
    sets: dict[str, list[str]] = {}
    for key in keys:
        sets.setdefault(_INDEX.sub("", key), []).append(key)
    return sets


def _motions(arrays: _Arrays) -> dict[str, _Arrays]:
    """Return the arrays of every structure that has positions, or of the whole file.

    A structure may contain its motions as cells, ``s.pos{1}`` with ``s.time{1}``, or
    with ``s.time`` for all.
    """

    def has_positions(fields: _Arrays) -> bool:
        return any(
            understood(field)[0] == "x" or ARRAYS.get(field.lower()) == POSITION
            for field in fields
        )

    structures: dict[str, dict[str, dict[str, FloatArray]]] = {}
    for key, array in arrays.items():
        where, field, index = _parted(key)
        if array.size > 1:
            structures.setdefault(where, {}).setdefault(index, {})[field] = array
    motions: dict[str, _Arrays] = {}
    for where, cells in structures.items():
        shared = cells.pop("", {})
        moving = {index: part for index, part in cells.items() if has_positions(part)}
        for index, fields in moving.items():
            motions[f"{where}{index}"] = shared | fields
        if not moving and has_positions(shared):
            # A single cell may contain the times of the only motion.
            single = next(iter(cells.values())) if len(cells) == 1 else {}
            motions[where] = single | shared
    return motions


def _from_names(name: str, arrays: _Arrays, settings: ImportSettings) -> RawRecording:
    """Return the motion in arrays with supported names."""
    columns: dict[str, tuple[FloatArray, str | None]] = {}
    unused, order = [], settings.quaternions
    heads = renamed(list(arrays), settings.columns)
    for head, (key, array) in zip(heads, arrays.items(), strict=True):
        short, unit, owner = understood(head)
        names = (short,) if short and not owner else ARRAYS.get(head.lower(), ())
        if not names and (form := orientation_form(head, array.shape, settings)):
            names, order = form, None
        if not names:
            unused.append(key)
            continue
        # There may be fewer columns, of positions without z.
        rows = _as_rows(key, array, len(names))
        for column, values in zip(names, rows.T, strict=False):
            if column in columns:
                raise ValueError(f"it has two arrays for {column}, one is {key!r}")
            columns[column] = (values, unit)
    if not {"x", "y"} <= set(columns):
        raise ValueError(f"{name} has x and no y: it has {_listed(arrays)}")
    lengths = {column: len(values) for column, (values, _) in columns.items()}
    if len(set(lengths.values())) > 1:
        raise ValueError(f"its arrays differ in length: {lengths}")
    untimed = (
        f": its arrays are {_listed(arrays)}. If one of them has the times, name it, "
        "for example --body POSITIONS,TIMES --columns x,y,z,t. Otherwise"
    )
    settings = replace(settings, quaternions=order)
    return recording(name, columns, settings, untimed, unused)


def _as_rows(key: str, array: FloatArray, width: int) -> FloatArray:
    """Return an array as rows of samples; MATLAB has vectors as rows or columns."""
    if width == 1 and _is_vector(array):
        return array.reshape(-1, 1)
    if width == 9 and array.ndim == 3:  # Matrices, of MATLAB along the last axis.
        array = np.moveaxis(array, -1, 0) if array.shape[:2] == (3, 3) else array
        array = array.reshape(len(array), -1)
    # Positions may lack z, and forces their torques.
    allowed = {3: (2, 3), 6: (3, 6)}.get(width, (width,))
    if array.ndim == 2 and array.shape[1] not in allowed and array.shape[0] in allowed:
        array = array.T
    if array.ndim != 2 or array.shape[1] not in allowed:
        raise ValueError(f"{key!r} has shape {array.shape}, must be (N, {width})")
    return array


def _is_vector(array: FloatArray) -> bool:
    return array.size == max(array.shape, default=0)


def _listed(arrays: _Arrays) -> str:
    names = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())
    return f"{names or 'no array of numbers':.400}"


def _from_columns(
    file: str, numbers: _Arrays, settings: ImportSettings
) -> list[RawRecording]:
    """Return the motions in the chosen arrays with the columns of ``--columns``.

    Several arrays, ``--body A,B``, are joined side by side. Times in the same structure
    or file belong to the columns.
    """
    sets = _sets(key for key, array in numbers.items() if 1 <= array.ndim <= 3)
    body, heads, parts = settings.body, settings.columns, [settings.body]
    if body is not None and body not in sets and "," in body:
        parts = [part.strip() for part in body.split(",")]
    else:
        sets = {
            name: keys
            for name, keys in sets.items()
            if not any(_is_vector(numbers[key]) for key in keys)
        }
    groups = [chosen(part, sets, "array of columns", file=file)[1] for part in parts]
    if len({len(group) for group in groups}) > 1:
        raise ValueError(
            f"{body} are of {' and '.join(str(len(g)) for g in groups)} recordings"
        )
    motions = []
    for keys in zip(*groups, strict=True):
        label = file if len(groups[0]) == 1 else f"{file}: {keys[0]}"
        where, _, index = _parted(keys[0])
        times = None
        for key, array in numbers.items():
            structure, field, cell = _parted(key)
            beside = structure == where and cell in ("", index)
            if beside and _is_vector(array) and ARRAYS.get(field.lower()) == ("t",):
                times = array.reshape(-1)
                break
        whole = _side_by_side([numbers[key] for key in keys])
        tables = {label: whole}
        if whole.ndim == 3:
            tables = {f"{label}[{number}]": part for number, part in enumerate(whole)}
        for name, part in tables.items():
            turned = part.shape[1] != len(heads) == part.shape[0]
            table = part.T if turned else part
            if table.shape[1] != len(heads):
                raise ValueError(
                    f"the array has {table.shape[1]} columns, and --columns names "
                    f"{len(heads)}"
                )
            places = named_columns(heads, "--columns")
            columns = {key: (table[:, at], unit) for key, (at, unit) in places.items()}
            if times is not None and len(times) == len(table):
                columns.setdefault("t", (times, None))
            motions.append(recording(name, columns, settings))
    return motions


def _side_by_side(arrays: list[FloatArray]) -> FloatArray:
    """Return the columns of all arrays as one, (N, C) or (K, N, C)."""
    if len(arrays) == 1:
        return arrays[0]
    rows = max(arrays[0].shape) if arrays[0].ndim < 3 else arrays[0].shape[1]
    tables = []
    for array in arrays:
        table = array[:, None] if array.ndim == 1 else array
        tables.append(table.T if table.ndim == 2 and len(table) != rows else table)
    if len({table.shape[:-1] for table in tables}) > 1:
        shapes = ", ".join(str(array.shape) for array in arrays)
        raise ValueError(f"arrays of shapes {shapes} differ in the number of samples")
    return np.concatenate(tables, axis=-1)
