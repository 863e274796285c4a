"""MATLAB files, versions 4 to 7.2: arrays of numbers, also in cells and structures.

*MAT-File Format*, The MathWorks, describes them. This module replaces
`scipy.io.loadmat`, which trusts files: deeply nested cells in 1 MB end the process with
a segmentation fault, and 184 bytes that claim 2³⁰ cells fill the memory.
"""

import io
import math
import struct
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final, NamedTuple

import numpy as np
import scipy.io
from numpy.typing import NDArray

from gplfd_experiments.data.raw import RawRecording, Selection
from gplfd_experiments.data.readers.arrays import recordings
from gplfd_policies.arrays.storage import DecodingBudget, inflated

_HEADER: Final = 128
_MOST_ARRAYS: Final = 100_000
_DEEPEST: Final = 8  # Cells in structures in cells.
_MATRIX, _COMPRESSED = 14, 15
_TYPES: Final = {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"} | {
    7: "f4",
    9: "f8",
    12: "i8",
    13: "u8",
}  # NumPy's names of the types of data elements.
_CELL, _STRUCTURE, _OPAQUE = 1, 2, 17  # Classes of arrays, besides the numeric ones.
_NUMERIC: Final = range(6, 16)
_COMPLEX: Final = 0x800


class _Element(NamedTuple):
    kind: int
    data: memoryview


_MISSING: Final = _Element(0, memoryview(b""))


def read(path: Path, selection: Selection) -> list[RawRecording]:
    """Read motions from arrays, with the same rules as for an .npz file.

    Texts, objects and sparse matrices are left out.
    """
    with path.open("rb") as stream:
        first = stream.read(10)
    if first == b"MATLAB 7.3":
        raise ValueError("it is of version 7.3; save it again: save(..., '-v7')")
    budget = DecodingBudget(path.stat().st_size)
    # Version 4 begins with a small number of four bytes instead of text; it has no
    # cells.
    if 0 not in first[:4]:
        return recordings(path.name, read_arrays(path, budget), selection)
    # In memory, because SciPy allocates the claimed size of an array before it reads a
    # file.
    file: Any = io.BytesIO(path.read_bytes())
    listed = scipy.io.whosmat(file)
    for name, shape, _ in listed:
        budget.claim(8 * math.prod(shape), f"{name!r:.40}")
    names = [name for name, _, _ in listed]
    content = scipy.io.loadmat(file, variable_names=names)
    return recordings(path.name, {name: content[name] for name in names}, selection)


def read_arrays(path: Path, budget: DecodingBudget) -> dict[str, NDArray[Any]]:
    """Return every array of numbers in a file of version 5 to 7.2.

    The names are those of MATLAB: ``pos``, ``data{3}``, ``demos{2}.pos``, ``s(4).t``;
    the index of a single structure is omitted. Unpacked bytes are claimed from the
    budget.
    """
    arrays: dict[str, NDArray[Any]] = {}
    content = memoryview(path.read_bytes())
    order = {b"IM": "<", b"MI": ">"}.get(bytes(content[_HEADER - 2 : _HEADER]))
    if order is None:
        raise ValueError("its first 128 bytes are not those of a MATLAB file")
    for outer in _elements(content[_HEADER:], order):
        element = outer
        if outer.kind == _COMPRESSED:
            data = inflated(bytes(outer.data), budget, "an element")
            (element,) = _elements(memoryview(data), order)
        if element.kind == _MATRIX:
            for name, array in _arrays(element.data, "", order, 0):
                budget.claim(8 * array.size, f"{name!r:.40}")
                if len(arrays) >= _MOST_ARRAYS:
                    raise ValueError(f"it has more than {_MOST_ARRAYS:,} arrays")
                arrays[name] = array
    return arrays


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """Yield the elements of a sequence."""
    place = 0
    while place < len(data):
        if place + 8 > len(data):
            raise ValueError("an element is cut off")
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:
            # Up to four bytes are in the tag itself.
            kind, size, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            end = start + size + (0 if kind == _COMPRESSED else -size % 8)
        if start + size > min(end, len(data)):
            raise ValueError("an element is cut off")
        yield _Element(kind, data[start : start + size])
        place = end


def _arrays(
    data: memoryview, name: str, order: str, depth: int
) -> Iterator[tuple[str, NDArray[Any]]]:
    """Yield name and numbers of an array, or of all arrays in a cell or structure."""
    if not len(data):
        return
    if depth > _DEEPEST:
        raise ValueError("cells and structures are nested too deeply")
    parts = _elements(data, order)
    flags = int(_header_numbers(next(parts, _MISSING), order)[0])
    kind = flags & 0xFF
    if kind == _OPAQUE:
        return  # An object of a class, without a shape.
    shape = tuple(_header_numbers(next(parts, _MISSING), order))
    if min(shape) < 0:
        raise ValueError(f"{name:.40} claims the shape {shape!s:.40}")
    own = str(bytes(next(parts, _MISSING).data), "latin-1")
    name = name or own
    if kind == _CELL:
        for number, part in enumerate(parts, start=1):
            yield from _arrays(part.data, f"{name}{{{number}}}", order, depth + 1)
    elif kind == _STRUCTURE:
        # The fields of the first structure, then those of the second, and so on.
        (width,) = _header_numbers(next(parts, _MISSING), order)
        names = bytes(next(parts, _MISSING).data)
        fields = [
            str(names[start : start + width], "latin-1").split("\0")[0]
            for start in range(0, len(names), max(width, 1))
        ]
        for place, part in enumerate(parts):
            number, field = divmod(place, max(len(fields), 1))
            index = f"({number + 1})" if math.prod(shape) > 1 else ""
            inner = f"{name}{index}.{fields[field]}"
            yield from _arrays(part.data, inner, order, depth + 1)
    elif name and kind in _NUMERIC and not flags & _COMPLEX:
        element = next(parts, _MISSING)
        if element.kind not in _TYPES:
            raise ValueError(f"{name:.40} has numbers of unknown kind {element.kind}")
        dtype = np.dtype(order + _TYPES[element.kind])
        if math.prod(shape) * dtype.itemsize != len(element.data):
            raise ValueError(f"{name:.40} does not have as many numbers as it claims")
        yield name, np.frombuffer(element.data, dtype).reshape(shape, order="F")


def _header_numbers(element: _Element, order: str) -> list[int]:
    """Return the numbers of a part that describes an array."""
    if element.kind not in _TYPES:
        raise ValueError(f"a part is of unknown kind {element.kind}")
    numbers = np.frombuffer(element.data, dtype=order + _TYPES[element.kind])
    if not 0 < len(numbers) <= 32:
        raise ValueError("a part is cut off")
    return [int(number) for number in numbers]
