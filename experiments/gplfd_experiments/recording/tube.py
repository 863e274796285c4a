"""The band of ±1.96 σ of a policy along its path, as a closed triangle mesh."""

import functools
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gplfd_experiments.files.arrays import FloatArray

Float32Array = NDArray[np.float32]
"""As exact as the viewer draws."""

QUANTILE: Final = 1.96
"""Half-width of all bands in standard deviations: the normal quantile of the central
95 % of one output. With few demonstrations, whose spread is itself an estimate, and
for several outputs together, such a band contains less than 95 %."""

N_RINGS, N_SIDES = 32, 12
"""Cross-sections along the path, and corners of each."""

# Share of the path's largest speed below which its direction is not used.
_SLOW: Final = 0.15
_THINNEST: Final = 0.002  # Half-width [m] below which a tube would not be seen.


def tube_vertices(
    mean: FloatArray, std: FloatArray
) -> tuple[Float32Array, Float32Array]:
    """Corners and unit normals of tubes, both (..., `N_RINGS` * `N_SIDES`, 3).

    Each cross-section is the ellipse across the path ``mean`` (..., M, 3) [m], with
    half axes of 1.96 ``std`` in the horizontal and in the vertical direction. The
    variance along the path is not shown.
    """
    # Path and σ at the rings, interpolated, both (..., rings, 3).
    rows = np.linspace(0.0, mean.shape[-2] - 1.0, N_RINGS)
    before = np.minimum(rows.astype(np.intp), mean.shape[-2] - 2)
    share = (rows - before)[:, None]
    centre, sigma = (
        (1.0 - share) * values[..., before, :] + share * values[..., before + 1, :]
        for values in (mean, std)
    )
    # Where a path hardly advances, its direction is noise; use the nearest reliable
    # one.
    tangent = np.gradient(centre, axis=-2)
    speed = _length(tangent)
    slow = speed <= _SLOW * speed.max(axis=-2, keepdims=True)
    rings = np.arange(N_RINGS)
    distance = np.abs(rings[:, None] - rings)
    distance = distance + np.where(slow, N_RINGS, 0).swapaxes(-1, -2)
    nearest = np.argmin(distance, axis=-1)[..., None]
    tangent = np.take_along_axis(tangent / np.maximum(speed, 1e-300), nearest, axis=-2)
    # A constant path gets an arbitrary direction.
    tangent = np.where(speed.max(axis=-2, keepdims=True) > 0.0, tangent, [1.0, 0, 0])
    # Across the path: horizontally, the tangent times the upward unit vector (0, 1, 0),
    # which for a vertical path is any horizontal direction; and the third direction.
    side = tangent[..., [2, 1, 0]] * [-1.0, 0.0, 1.0]
    length = _length(side)
    side = np.where(length > 1e-6, side / np.maximum(length, 1e-6), [0.0, 0.0, 1.0])
    upward = np.cross(side, tangent)

    half_width = np.maximum(QUANTILE * _length(side * sigma), _THINNEST)
    half_height = np.maximum(QUANTILE * _length(upward * sigma), _THINNEST)
    angle = np.linspace(0.0, 2.0 * np.pi, N_SIDES, endpoint=False)[:, None]
    cosine, sine = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)

    def around(a: FloatArray, b: FloatArray) -> Float32Array:
        # (..., rings, sides, 3)
        a32, b32 = a.astype(np.float32), b.astype(np.float32)
        return cosine * a32[..., None, :] + sine * b32[..., None, :]

    vertices = around(half_width * side, half_height * upward)
    vertices += centre[..., None, :].astype(np.float32)
    # Normals of the ellipse; the slope along the path changes the shading little.
    normals = around(side / half_width, upward / half_height)
    normals /= _length(normals)
    shape = (*mean.shape[:-2], N_RINGS * N_SIDES, 3)
    return vertices.reshape(shape), normals.reshape(shape)


@functools.cache
def tube_triangles() -> NDArray[np.uint32]:
    """Corners of every triangle, the same for all tubes, (n, 3)."""
    ring, side = np.meshgrid(np.arange(N_RINGS - 1), np.arange(N_SIDES), indexing="ij")
    here = ring * N_SIDES + side
    beside = ring * N_SIDES + (side + 1) % N_SIDES
    first = np.stack([here, here + N_SIDES, beside], axis=-1)
    second = np.stack([beside, here + N_SIDES, beside + N_SIDES], axis=-1)
    return np.concatenate([first, second]).reshape(-1, 3).astype(np.uint32)


def _length(vectors: NDArray[Any]) -> NDArray[Any]:
    """Lengths of vectors (..., 3), kept as (..., 1)."""
    length: NDArray[Any] = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return length[..., None]
