"""Paths of rotations: continuous rotation vectors, and conversion of quaternions.

A rotation has many rotation vectors, ``(θ + 2πk) u`` for every integer k, and two unit
quaternions, q and -q. A recording may switch between them from sample to sample; a
regression needs one continuous path.
"""

from math import sqrt
from typing import Literal

import numpy as np
import numpy.typing as npt

Array = npt.NDArray[np.float64]

# Below this angle [rad] the axis of a rotation is rounding error.
_IDENTITY_ANGLE = 1e-9
# Tolerance of the norm: two decimals per component give norms within 0.01 of one.
_QUATERNION_NORM_TOLERANCE = 0.05


def unwrap_rotvecs(rotvecs: npt.ArrayLike) -> Array:
    """Make a path of rotation vectors (N, 3) [rad] continuous.

    The first vector is kept; each later one is replaced by the equivalent ``(θ + 2πk)
    u`` nearest to its predecessor. The path then passes π without a jump, and also 2π
    if the axis is the same on both sides.

    The exponential map is singular at angles 2π, 4π, ...: a path that passes there
    while its axis changes has no continuous rotation vectors at all. Express rotations
    relative to the first one (`gplfd_env.spatial.se3.relative_poses`) to stay far from
    it. Raises a ValueError for another shape or an entry that is not finite.
    """
    rotvecs = checked_rows(rotvecs, 3, "rotvecs")
    angles = np.sqrt(np.einsum("ij,ij->i", rotvecs, rotvecs))
    angle, previous = angles[1:], angles[:-1]
    overlap = np.einsum("ij,ij->i", rotvecs[1:], rotvecs[:-1])
    # A vector is kept if the predecessor's projection is less than π away (here times
    # the angle); at the identity, which has no axis, if the predecessor itself is.
    kept = np.abs(overlap - angle**2) < np.pi * angle
    kept = np.where(angle < _IDENTITY_ANGLE, previous < np.pi, kept)
    unwrapped = rotvecs.copy()
    if not kept.all():
        # After the first jump, each vector depends on the one before it: a loop.
        jump = int(np.argmin(kept)) + 1
        path = rotvecs[jump - 1 :].tolist()
        for index in range(1, len(path)):
            path[index] = _nearest_equivalent(path[index], path[index - 1])
        unwrapped[jump:] = path[1:]
    return unwrapped


def _nearest_equivalent(rotvec: list[float], target: list[float]) -> list[float]:
    """Return the rotation vector equivalent to `rotvec` that is nearest to `target`."""
    # Plain floats: the loop over the path cannot be vectorised, and arithmetic on
    # 3-vectors is some ten times faster without NumPy's call overhead.
    x, y, z = rotvec
    angle = sqrt(x * x + y * y + z * z)
    if angle < _IDENTITY_ANGLE:
        # Any axis describes the identity; the one of the target continues the path.
        a, b, c = target
        length = sqrt(a * a + b * b + c * c)
        turns = round(length / (2 * np.pi))
        if turns == 0:
            return rotvec
        along = (x * a + y * b + z * c) / length
        scale = (2 * np.pi * turns + along) / length
        return [a * scale, b * scale, c * scale]
    # The equivalents lie on one line, 2π apart: project the target on it.
    projection = (x * target[0] + y * target[1] + z * target[2]) / angle
    turns = round((projection - angle) / (2 * np.pi))
    scale = 1.0 + 2 * np.pi * turns / angle
    return [x * scale, y * scale, z * scale]


def rotvecs_from_quaternions(
    quaternions: npt.ArrayLike, order: Literal["wxyz", "xyzw"] = "wxyz"
) -> Array:
    """Convert a path of quaternions (N, 4) to continuous rotation vectors [rad].

    Neither the sign (q and -q are the same rotation) nor the norm matters. `order`
    is the position of the scalar part w. Raises a ValueError for another shape or
    order, an entry that is not finite, or a norm further than 0.05 from one.
    """
    if order not in ("wxyz", "xyzw"):
        raise ValueError(f"order must be 'wxyz' (w first) or 'xyzw', got {order!r}")
    quaternions = checked_rows(quaternions, 4, "quaternions")
    norms = np.linalg.norm(quaternions, axis=1)
    far = np.flatnonzero(np.abs(norms - 1.0) > _QUATERNION_NORM_TOLERANCE)
    if far.size:
        raise ValueError(
            f"quaternions[{far[0]}] has norm {norms[far[0]]:.4g}, but rotations have "
            f"norm 1 (tolerance {_QUATERNION_NORM_TOLERANCE}); check that the four "
            f"columns are the quaternion in the order given by order={order!r}"
        )
    if order == "xyzw":
        quaternions = np.roll(quaternions, 1, axis=1)
    return unwrap_rotvecs(rotvec_from_quaternion(quaternions[:, 0], quaternions[:, 1:]))


def rotvec_from_quaternion(w: Array, vec: Array) -> Array:
    """Return least rotation vectors (..., 3) of quaternions w (...), vec (..., 3)."""
    length = np.sqrt(np.add.reduce(vec * vec, axis=-1))
    angle = 2.0 * np.arctan2(length, np.abs(w))
    # angle / length tends to 2 at the identity.
    ratio = np.full_like(length, 2.0)
    np.divide(angle, length, out=ratio, where=length > 1e-150)
    rotvec: Array = vec * (np.where(w < 0, -1.0, 1.0) * ratio)[..., None]
    return rotvec


def checked_rows(values: npt.ArrayLike, width: int, name: str) -> Array:
    """Return a path (N, width) as float64; raise a ValueError if it is not finite."""
    array = np.asarray(values, dtype=np.float64)
    if array.ndim != 2 or array.shape[1] != width:
        raise ValueError(f"{name} must have shape (N, {width}), got {array.shape}")
    if not np.isfinite(array).all():
        bad = np.flatnonzero(~np.isfinite(array).all(axis=1))
        raise ValueError(f"{name}[{bad[0]}] = {array[bad[0]]} is not finite; repair it")
    return array
