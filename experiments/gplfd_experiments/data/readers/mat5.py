"""Numbers in MATLAB's files of versions 5 to 7.2, in cells and structures, too.

A file is a sequence of elements, each with a kind and a size; arrays, cells and
structures are elements that hold others. Read as documented in *MAT-File Format*, The
MathWorks. Nothing is taken at its word: what is read lies inside the file, and unpacks
to no more than was allowed.
"""

import math
import struct
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray

from gplfd_policies.arrays.storage import DecodingBudget, inflated

_HEADER: Final = 128
_MOST_ARRAYS: Final = 100_000
_DEEPEST: Final = 8
"""Cells in structures in cells."""
_MATRIX: Final = 14
_COMPRESSED: Final = 15
_TYPES: Final[Mapping[int, str]] = MappingProxyType(
    {1: "i1", 2: "u1", 3: "i2", 4: "u2", 5: "i4", 6: "u4"}
    | {7: "f4", 9: "f8", 12: "i8", 13: "u8"}
)
"""NumPy's names of what a data element holds."""
_CELL: Final = 1
_STRUCTURE: Final = 2
_NUMERIC: Final = range(6, 16)
_OPAQUE: Final = 17
_COMPLEX: Final = 0x800


class _Element(NamedTuple):
    kind: int
    data: memoryview


class _Content:
    """What was found in a file so far."""

    def __init__(self, order: str, budget: DecodingBudget) -> None:
        self.order = order
        self._budget = budget
        self.arrays: dict[str, NDArray[Any]] = {}

    def add(self, name: str, shape: tuple[int, ...], element: _Element) -> None:
        """Keep the numbers of an array."""
        if element.kind not in _TYPES:
            raise ValueError(f"{name:.40} has numbers of unknown kind {element.kind}")
        kind = np.dtype(self.order + _TYPES[element.kind])
        self._budget.claim(8 * math.prod(shape), f"{name!r:.40}")
        if len(self.arrays) >= _MOST_ARRAYS:
            raise ValueError(f"it has more than {_MOST_ARRAYS:,} arrays")
        if math.prod(shape) * kind.itemsize != len(element.data):
            raise ValueError(f"{name:.40} has not as many numbers as it claims")
        numbers = np.frombuffer(element.data, dtype=kind)
        self.arrays[name] = numbers.reshape(shape, order="F")


def read_arrays(path: Path, budget: DecodingBudget) -> dict[str, NDArray[Any]]:
    """Return every array of numbers in a file, by where it stands.

    The names are those of MATLAB: ``pos``, ``data{3}``, ``demos{2}.pos``, ``s(4).t``;
    the index of a structure that is the only one is left out.

    Args:
        path: The file.
        budget: What the unpacked elements, and the numbers in them, are claimed from.

    Raises:
        ValueError: It is damaged, or unpacks to more.
    """
    with path.open("rb") as stream:
        header = stream.read(_HEADER)
        marks = {b"IM": "<", b"MI": ">"}
        if len(header) < _HEADER or header[-2:] not in marks:
            raise ValueError("its first 128 bytes are not those of a MATLAB file")
        content = _Content(marks[header[-2:]], budget)
        while tag := stream.read(8):
            if len(tag) < 8:
                raise ValueError("it is cut off")
            kind, size = struct.unpack(f"{content.order}II", tag)
            if size > path.stat().st_size:
                raise ValueError(f"an element claims {size:,} bytes")
            data = stream.read(size)
            if len(data) < size:
                raise ValueError("it is cut off")
            if kind == _COMPRESSED:
                data = inflated(data, budget, "an element")
                (element,) = _elements(memoryview(data), content.order)
            else:
                element = _Element(kind, memoryview(data))
            if element.kind == _MATRIX:
                _visit(element.data, "", content, 0)
    return content.arrays


def _elements(data: memoryview, order: str) -> Iterator[_Element]:
    """Yield the elements that stand in a row."""
    place = 0
    while place < len(data):
        if place + 8 > len(data):
            raise ValueError("an element is cut off")
        kind, size = struct.unpack_from(f"{order}II", data, place)
        if kind >> 16:
            # Up to four bytes stand in the tag itself.
            kind, size, start, end = kind & 0xFFFF, kind >> 16, place + 4, place + 8
        else:
            start = place + 8
            end = start + size + -size % 8
        if start + size > min(end, len(data)):
            raise ValueError("an element is cut off")
        yield _Element(kind, data[start : start + size])
        place = end


def _visit(data: memoryview, name: str, content: _Content, depth: int) -> None:
    """Keep the numbers of an array, or of all that stand in a cell or structure."""
    if not len(data):
        return
    if depth > _DEEPEST:
        raise ValueError("cells and structures stand in each other too deeply")
    parts = _elements(data, content.order)
    flags = _numbers(next(parts), content.order)
    kind = int(flags[0]) & 0xFF
    if kind == _OPAQUE:
        return  # an object of a class, without a shape
    shape = tuple(_numbers(next(parts), content.order).tolist())
    if not shape or min(shape) < 0:
        raise ValueError(f"{name:.40} claims the shape {shape!s:.40}")
    own = str(bytes(next(parts).data), "latin-1")
    name = name or own
    if kind == _CELL:
        for number, part in enumerate(parts, start=1):
            _visit(part.data, f"{name}{{{number}}}", content, depth + 1)
    elif kind == _STRUCTURE:
        _visit_fields(parts, name, math.prod(shape), content, depth)
    elif name and kind in _NUMERIC and not int(flags[0]) & _COMPLEX:
        content.add(name, shape, next(parts))


def _visit_fields(
    parts: Iterator[_Element], name: str, size: int, content: _Content, depth: int
) -> None:
    """Visit every field of every structure of an array of them."""
    (width,) = _numbers(next(parts), content.order).tolist()
    names = bytes(next(parts).data)
    fields = [
        str(names[start : start + width], "latin-1").split("\0")[0]
        for start in range(0, len(names), max(width, 1))
    ]
    for place, part in enumerate(parts):
        number, field = divmod(place, max(len(fields), 1))
        index = f"({number + 1})" if size > 1 else ""
        _visit(part.data, f"{name}{index}.{fields[field]}", content, depth + 1)


def _numbers(element: _Element, order: str) -> NDArray[Any]:
    """Return the numbers of a part that says how an array is made."""
    if element.kind not in _TYPES:
        raise ValueError(f"a part is of unknown kind {element.kind}")
    numbers = np.frombuffer(element.data, dtype=order + _TYPES[element.kind])
    if not 0 < len(numbers) <= 32:
        raise ValueError("a part is cut off")
    return numbers
