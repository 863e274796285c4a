"""Resolution of poses, subsampling of curves, and interpolation."""

import numpy as np

from gplfd_policies.arrays.shapes import Float, Int

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
