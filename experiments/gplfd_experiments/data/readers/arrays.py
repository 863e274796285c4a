"""Motions in arrays (.npz, .npy, .mat up to 7.2), also transposed.

Columns (N,), those of `tables` (N, d), or ``--columns`` of (N, C) or (K, N, C).
"""

import contextlib
import re
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import numpy as np
import scipy.io

from gplfd_experiments.data.raw import RawRecording, chosen
from gplfd_experiments.data.readers import own_sets
from gplfd_experiments.data.readers.tables import (
    ARRAYS,
    POSITION,
    array_columns,
    named_columns,
    recording,
    renamed,
    understood,
)
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.demonstrations.npz import KIND

_Arrays = Mapping[str, FloatArray]
_INDEX: Final = re.compile(r"(\{\d+\}|\(\d+\))")


def read(path: Path, settings: ImportSettings) -> list[RawRecording]:
    """Read the motions in a file of arrays, or its set of demonstrations."""
    arrays: dict[str, Any] = {}
    with path.open("rb") as stream:
        if path.suffix.lower() == ".mat":
            if stream.read(10) == b"MATLAB 7.3":
                raise ValueError(
                    "it is of version 7.3; save it again: save(..., '-v7')"
                )
            for variable, value in scipy.io.loadmat(path, appendmat=False).items():
                arrays.update(_in_cells(value, variable))
        elif isinstance(loaded := np.load(stream, allow_pickle=False), np.ndarray):
            arrays["the array"] = loaded
        else:
            for name in loaded.files:
                with contextlib.suppress(ValueError):  # NumPy unpickles no objects.
                    arrays[name] = loaded[name]
    if str(arrays.get("format", "")) == KIND:
        return own_sets.read(path, settings)
    numbers = {
        key: np.asarray(array, dtype=np.float64)
        for key, array in arrays.items()
        if array.dtype.kind in "biuf"
    }
    if settings.columns and "=" not in settings.columns[0]:
        return _from_columns(path.name, numbers, settings)
    motions = _motions(numbers, settings)
    if not motions:
        raise ValueError(
            f"it has no array of positions: it has {_shapes(numbers)}. Name one, "
            "--columns positions=NAME,quat_wxyz=NAME,..., or the columns of one in "
            "their order, --columns t,x,y,z,... with - for one to leave out"
        )
    sets = _sets(motions)
    _, keys = chosen(settings.body, sets, "set of recordings", file=path.name)
    return [
        from_names(_label(path.name, key, keys), motions[key], settings) for key in keys
    ]


def _in_cells(value: Any, name: str) -> Iterator[tuple[str, Any]]:
    """Yield name and array, also of those in cells, a{3}, and structures, s(4).t."""
    if not isinstance(value, np.ndarray):
        return
    if not value.dtype.hasobject:
        yield name, value
        return
    for number, part in enumerate(value.ravel(order="F"), start=1):
        index = f"({number})" if value.size > 1 else ""
        for field in value.dtype.names or ():
            yield from _in_cells(part[field], f"{name}{index}.{field}")
        if value.dtype.names is None:
            yield from _in_cells(part, f"{name}{{{number}}}")


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


def _motions(arrays: _Arrays, settings: ImportSettings) -> dict[str, _Arrays]:
    """Return the arrays of every structure that has positions, or of the whole file."""
    # A structure may contain its motions as cells, s.pos{1} with s.time{1}, or with
    # s.time for all. A single cell may contain the times of the only motion.
    parts = {key: _parted(key) for key, array in arrays.items() if array.size > 1}
    fields = renamed([field for _, field, _ in parts.values()], settings.columns)
    names = dict(zip(parts, fields, strict=True))
    motions: dict[str, _Arrays] = {}
    for key, (where, _, index) in parts.items():
        name = names[key]
        if understood(name)[0] == "x" or ARRAYS.get(name.lower()) == POSITION:
            cells = {cell for other, _, cell in parts.values() if other == where} - {""}
            beside = {"", index} | (cells if len(cells) == 1 else set())
            motions[where + index] = {
                names[other]: arrays[other]
                for other, (structure, _, cell) in parts.items()
                if structure == where and cell in beside
            }
    return motions


def from_names(name: str, arrays: _Arrays, settings: ImportSettings) -> RawRecording:
    """Return the motion in arrays with supported names, see `array_columns`."""
    heads, values, unused = list[str](), list[FloatArray](), list[str]()
    for key, array in arrays.items():
        short, _, owner = understood(key)
        names: tuple[str, ...] = (key,)
        if short is None or owner:
            names = array_columns(key, array.shape, settings)
            if "qw" in names and key.lower() not in ARRAYS:
                settings = replace(settings, quaternions=None)  # It had its effect.
        if names:
            # There may be fewer columns, of positions without z.
            rows = _as_rows(key, array, len(names))
            values += list(rows.T)
            heads += names[: rows.shape[1]]
        else:
            unused.append(key)
    if len({len(column) for column in values}) > 1:
        raise ValueError(f"its arrays differ in length: {_shapes(arrays)}")
    places = named_columns(heads, name)
    columns = {column: (values[at], unit) for column, (at, unit) in places.items()}
    return recording(name, columns, settings, unused)


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


def _label(file: str, key: str, keys: list[str]) -> str:
    """Return the name of one of the motions in a file."""
    return file if len(keys) == 1 else f"{file}: {key}"


def _is_vector(array: FloatArray) -> bool:
    return array.size == max(array.shape, default=0)


def _shapes(arrays: _Arrays) -> str:
    names = ", ".join(f"{key} {array.shape}" for key, array in arrays.items())
    return f"{names or 'no array of numbers':.400}"


def _from_columns(
    file: str, numbers: _Arrays, settings: ImportSettings
) -> list[RawRecording]:
    """Return the motions in an array of ``--columns``, with the times beside it."""
    vectors = {key for key, array in numbers.items() if _is_vector(array)}
    sets = _sets(key for key, array in numbers.items() if array.ndim in (2, 3))
    sets = {name: keys for name, keys in sets.items() if vectors.isdisjoint(keys)}
    _, keys = chosen(settings.body, sets, "array of columns", file=file)
    places, width = named_columns(settings.columns, "--columns"), len(settings.columns)
    motions = []
    for key in keys:
        label, (where, _, index) = _label(file, key, keys), _parted(key)
        tables = {label: numbers[key]}
        if numbers[key].ndim == 3:
            tables = {f"{label}[{n}]": part for n, part in enumerate(numbers[key])}
        times = np.empty(0)
        for other, array in numbers.items():
            structure, field, cell = _parted(other)
            beside = structure == where and cell in ("", index) and _is_vector(array)
            if beside and ARRAYS.get(field.lower()) == ("t",):
                times = array.reshape(-1)
        for name, table in tables.items():
            rows = table if table.shape[1] == width else table.T
            if rows.shape[1] != width:
                raise ValueError(
                    f"{key!r} has shape {table.shape}, and --columns names {width} "
                    "columns"
                )
            columns = {head: (rows[:, at], unit) for head, (at, unit) in places.items()}
            if len(times) == len(rows):
                columns.setdefault("t", (times, None))
            motions.append(recording(name, columns, settings))
    return motions
