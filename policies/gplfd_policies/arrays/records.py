"""Immutable records: read-only arrays with a short repr."""

import reprlib
from dataclasses import fields
from typing import Any

import numpy as np


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a read-only float64 copy in C order, so that stored files are equal."""
    copy = np.array(array, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy


def freeze(record: object, *names: str) -> None:
    """Replace arrays of a frozen dataclass by read-only float64 copies."""
    for name in names:
        object.__setattr__(record, name, read_only(getattr(record, name)))


class _Shapes(reprlib.Repr):
    """Abbreviates long arrays to their shape and long tuples to their beginning."""

    def repr_ndarray(self, array: np.ndarray, level: int) -> str:
        return repr(array) if array.size <= 6 else f"array{array.shape}"


_SHAPES = _Shapes()
_SHAPES.maxother, _SHAPES.maxtuple = 200, 2


def short_repr(record: Any) -> str:
    """Return ``Name(field=value, ...)``, with only the shape of long arrays."""
    entries = (
        f"{field.name}={_SHAPES.repr(getattr(record, field.name))}"
        for field in fields(record)
        if field.repr
    )
    return f"{type(record).__name__}({', '.join(entries)})"
