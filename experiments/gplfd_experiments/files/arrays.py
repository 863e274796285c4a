"""Arrays of numbers: their type, and interpolation between their rows."""

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]
"""An array of float64; its docstring states shape and unit."""


def interpolated(
    wanted: FloatArray, known: FloatArray, columns: FloatArray
) -> FloatArray:
    """Return columns, (N, d), that are known at N points, at M others, (M, d)."""
    return np.column_stack([np.interp(wanted, known, column) for column in columns.T])
