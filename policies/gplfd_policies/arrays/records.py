"""Records that own their arrays, with a short repr; thinned and interpolated curves."""

import reprlib
from dataclasses import fields
from typing import Any

import numpy as np

from gplfd_policies.arrays.shapes import Float, Int


def read_only(array: np.ndarray) -> np.ndarray:
    """Return a read-only copy, for settings that several policies share."""
    copy = np.array(array, dtype=np.float64, order="C")
    copy.setflags(write=False)
    return copy


def own_arrays(record: object, *names: str) -> None:
    """Replace arrays of a frozen dataclass by float64 copies of its own; None stays.

    They are in C order, so that stored files are equal. They can be written, because
    SciPy refuses read-only arrays, of which PyTorch warns; copy before you change one.
    """
    for name in names:
        if (array := getattr(record, name)) is not None:
            array = np.array(array, dtype=np.float64, order="C")
            object.__setattr__(record, name, array)


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


FINEST = 1e-6
"""Finest resolution of poses, scales and standard deviations: 1 µm and 1 µrad."""


def thinned(size: int, most: int) -> Int[np.ndarray, " N"]:
    """Return at most ``most`` of ``size`` indices, evenly spread, with both ends."""
    return np.unique(np.linspace(0, size - 1, most).round().astype(int))


def interpolated(
    wanted: Float[np.ndarray, " N"],
    places: Float[np.ndarray, " M"],
    curves: Float[np.ndarray, "M C"],
) -> Float[np.ndarray, "N C"]:
    """Return curves interpolated at other places; constant beyond the ends."""
    return np.column_stack([np.interp(wanted, places, curve) for curve in curves.T])
