"""Resolution of poses, and fewer samples of a curve."""

import numpy as np

from gplfd_policies.arrays.shapes import Int

FINEST = 1e-6
"""Finest resolution of poses, scales and standard deviations: 1 µm and 1 µrad."""


def thinned(size: int, most: int) -> Int[np.ndarray, " N"]:
    """Return at most ``most`` of ``size`` indices, evenly spread, with both ends."""
    return np.unique(np.linspace(0, size - 1, most).round().astype(int))
