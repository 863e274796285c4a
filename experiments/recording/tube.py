"""The band of ±1.96 σ of a policy along its path, as a closed triangle mesh."""

from __future__ import annotations

from typing import Final

import numpy as np
from numpy.typing import NDArray

FloatArray = NDArray[np.float64]

QUANTILE: Final = 1.96
"""Half-width of all bands in standard deviations: the normal quantile of the central
95 % of one output. With few demonstrations, whose spread is itself an estimate, and
for several outputs at once, such a band holds less than 95 %."""

N_RINGS: Final = 48
"""Cross-sections along the path."""

N_SIDES: Final = 16
"""Corners of a cross-section."""

_UP: Final = np.array([0.0, 1.0, 0.0])
_SLOW: Final = 0.15
"""Share of the path's largest speed below which its direction is not trusted."""
_THINNEST: Final = 0.002
"""Half-width [m] below which a tube would not be seen."""


def tube_vertices(mean: FloatArray, std: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Corners of the tube around a path, in the task frame.

    Each cross-section is the ellipse across the path, with half axes of 1.96 standard
    deviations in the horizontal and in the vertical direction; the variance along the
    path has no place in it.

    Args:
        mean: Positions along the path (M, 3) [m], M >= 2.
        std: Standard deviations per axis (M, 3) [m].

    Returns:
        Vertex positions and unit normals, both (`N_RINGS` * `N_SIDES`, 3).
    """
    rows = np.linspace(0.0, len(mean) - 1.0, N_RINGS)
    centre, sigma = _at_rows(mean, rows), _at_rows(std, rows)
    side, upward = _across(centre)
    half_width = np.maximum(
        QUANTILE * np.sqrt(np.sum((side * sigma) ** 2, axis=1)), _THINNEST
    )
    half_height = np.maximum(
        QUANTILE * np.sqrt(np.sum((upward * sigma) ** 2, axis=1)), _THINNEST
    )
    angle = np.linspace(0.0, 2.0 * np.pi, N_SIDES, endpoint=False)[:, None]
    # (rings, sides, 3)
    a, b = side[:, None, :], upward[:, None, :]
    width, height = half_width[:, None, None], half_height[:, None, None]
    vertices = centre[:, None, :] + width * np.cos(angle) * a
    vertices = vertices + height * np.sin(angle) * b
    # Normals of the ellipse; the slope along the path changes the shading little.
    normals = np.cos(angle) * a / width + np.sin(angle) * b / height
    normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    return vertices.reshape(-1, 3), normals.reshape(-1, 3)


def tube_triangles() -> NDArray[np.uint32]:
    """Corners of every triangle, the same for all tubes, (n, 3)."""
    ring, side = np.meshgrid(np.arange(N_RINGS - 1), np.arange(N_SIDES), indexing="ij")
    here = ring * N_SIDES + side
    beside = ring * N_SIDES + (side + 1) % N_SIDES
    first = np.stack([here, here + N_SIDES, beside], axis=-1)
    second = np.stack([beside, here + N_SIDES, beside + N_SIDES], axis=-1)
    return np.concatenate([first, second]).reshape(-1, 3).astype(np.uint32)


def _across(centre: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Unit vectors across the path: horizontal (M, 3) and the third one (M, 3)."""
    tangent = np.gradient(centre, axis=0)
    speed = np.linalg.norm(tangent, axis=1)
    fast = np.flatnonzero(speed > _SLOW * speed.max())
    if fast.size == 0:
        tangent = np.broadcast_to([1.0, 0.0, 0.0], centre.shape)
    else:
        # Where the path hardly advances its direction is noise: take the nearest one.
        rows = np.arange(len(centre))
        nearest = fast[np.argmin(np.abs(rows[:, None] - fast), axis=1)]
        tangent = tangent[nearest] / speed[nearest, None]
    side = np.cross(tangent, _UP)
    length = np.linalg.norm(side, axis=1, keepdims=True)
    # A path straight upwards has every horizontal direction across it.
    side = np.where(length > 1e-6, side / np.maximum(length, 1e-6), [0.0, 0.0, 1.0])
    return side, np.cross(side, tangent)


def _at_rows(values: FloatArray, rows: FloatArray) -> FloatArray:
    indices = np.arange(len(values), dtype=np.float64)
    return np.stack([np.interp(rows, indices, column) for column in values.T], axis=1)
