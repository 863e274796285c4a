"""Rigid-body poses: rotation vectors, their distances and their composition.

A pose is ``(x, y, z, θu_x, θu_y, θu_z)``: a position [m] and a rotation vector, the
unit axis u times the angle θ [rad]. A rotation has many rotation vectors,
``(θ + 2πk) u`` for every integer k. This module computes the *canonical* one (θ ≤ π,
unique); `gplfd_env.spatial.rotation_paths` computes *unwrapped* ones, which are
continuous along a path, as needed for regression. Equation numbers refer to Arduengo et
al., *Gaussian-Process-based Robot Learning from Demonstration*, arXiv:2002.09979.
"""

from math import sqrt

import numpy as np
import numpy.typing as npt
from numpy.typing import ArrayLike

from gplfd_env.spatial.rotation_paths import (
    Array,
    checked_rows,
    rotvec_from_quaternion,
    unwrap_rotvecs,
)

# Angles and axis components closer than this to π or 0 count as equal to it.
_ROUNDING = 1e-12


def canonical_rotvec(rotvec: npt.ArrayLike) -> Array:
    """Return the unique rotation vector (..., 3) of a rotation, Eqs. (8) and (9).

    Its angle lies in [0, π]. At π, u and -u are the same rotation; the axis is chosen
    whose first non-zero component in the order z, y, x is positive. Do not use the
    result for regression: it jumps from +π to -π along a path; see
    `gplfd_env.spatial.rotation_paths.unwrap_rotvecs`.
    """
    rotvec = np.asarray(rotvec, dtype=np.float64)
    angle = np.linalg.norm(rotvec, axis=-1, keepdims=True)
    turns = np.round(angle / (2 * np.pi))
    reduced = angle - 2 * np.pi * turns  # in [-π, π]
    scale = np.divide(reduced, angle, out=np.ones_like(angle), where=angle > 0)
    canonical = rotvec * scale

    axis = rotvec / np.where(angle > 0, angle, 1.0)
    x, y, z = np.moveaxis(np.where(np.abs(axis) > _ROUNDING, axis, 0.0), -1, 0)
    excluded = (z < 0) | ((z == 0) & (y < 0)) | ((z == 0) & (y == 0) & (x < 0))
    half_turn = np.pi * axis * np.where(excluded, -1.0, 1.0)[..., None]
    at_pi = np.abs(reduced) >= np.pi - _ROUNDING
    return np.where(at_pi, half_turn, canonical)


def rotation_distance(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """Return the angle in [0, π] between rotations (..., 3), Eq. (18).

    The arccos printed in the paper returns 0 or rounding noise of 3e-8 for angles below
    1e-8 rad. 2 atan2(‖vec‖, |w|) of the relative quaternion is the same angle and is
    accurate everywhere: `test_eq18_resolves_angles_where_arccos_cannot`.
    """
    w_a, vec_a = _quaternion(a)
    w_b, vec_b = _quaternion(b)
    w, vec = _quaternion_product(w_a, -vec_a, w_b, vec_b)
    return np.asarray(2.0 * np.arctan2(np.linalg.norm(vec, axis=-1), np.abs(w)))


def pose_distance(
    a: npt.ArrayLike, b: npt.ArrayLike, rotation_weight: float = 0.5
) -> Array:
    """Return the distance between poses (..., 6) on SE(3), Eq. (17).

    `rotation_weight` is ω₁, the weight of the squared angle; the squared translation
    has ω₂ = 1 - ω₁. Raises a ValueError if it is outside [0, 1].
    """
    _check_weight(rotation_weight)
    a = np.asarray(a, dtype=np.float64)
    b = np.asarray(b, dtype=np.float64)
    angle = rotation_distance(a[..., 3:], b[..., 3:])
    shift = np.linalg.norm(a[..., :3] - b[..., :3], axis=-1)
    turn, move = sqrt(rotation_weight) * angle, sqrt(1.0 - rotation_weight) * shift
    return np.asarray(np.hypot(turn, move))


def pose_steps(poses: npt.ArrayLike, rotation_weight: float = 0.5) -> Array:
    """Return distances (N - 1,) between successive poses: a fast `pose_distance`."""
    # One coordinate per row, contiguous: arithmetic on rows of 3 numbers is slow.
    columns = np.ascontiguousarray(np.asarray(poses, dtype=np.float64).T)
    rotvecs = columns[3:]
    half = 0.5 * np.sqrt(np.einsum("ij,ij->j", rotvecs, rotvecs))
    half = np.maximum(half, np.finfo(np.float64).tiny)  # for sin(h)/h at zero
    quaternions = np.empty((4, len(half)))
    np.cos(half, out=quaternions[0])
    np.multiply(rotvecs, 0.5 * np.sin(half) / half, out=quaternions[1:])
    turn = quaternions[:, 1:] - quaternions[:, :-1]
    squared_chord = np.einsum("ij,ij->j", turn, turn)
    if squared_chord.size == 0 or squared_chord.max() > 1.0:
        # The chord measures a rotation only up to π, where q and -q are equally near.
        return pose_distance(columns.T[1:], columns.T[:-1], rotation_weight)
    _check_weight(rotation_weight)
    angle = 4.0 * np.arcsin(0.5 * np.sqrt(squared_chord))
    shift = columns[:3, 1:] - columns[:3, :-1]
    squared_shift = np.einsum("ij,ij->j", shift, shift)
    squared = rotation_weight * angle**2 + (1.0 - rotation_weight) * squared_shift
    return np.asarray(np.sqrt(squared))


def compose_rotvecs(a: npt.ArrayLike, b: npt.ArrayLike) -> Array:
    """Return log(exp(a) exp(b)) [rad], (..., 3): first rotate by `b`, then by `a`."""
    product = _quaternion_product(*_quaternion(a), *_quaternion(b))
    return rotvec_from_quaternion(*product)


def relative_poses(poses: npt.ArrayLike, reference: npt.ArrayLike) -> Array:
    """Express poses (N, 6) in the frame of a reference pose (6,): T_ref⁻¹ T.

    Rotation vectors are unwrapped. Raises a ValueError for a wrong shape or an entry
    that is not finite.
    """
    path = checked_rows(poses, 6, "poses")
    origin = checked_rows(np.atleast_2d(reference), 6, "reference")[0]
    w, vec = _quaternion(-origin[3:])
    shift = path[:, :3] - origin[:3]
    aside = cross(vec, shift)
    positions = shift + 2.0 * (w * aside + cross(vec, aside))
    rotvecs = unwrap_rotvecs(compose_rotvecs(-origin[3:], path[:, 3:]))
    return np.hstack([positions, rotvecs])


def into_axes(rotvecs: npt.ArrayLike, vectors: npt.ArrayLike) -> Array:
    """Express vectors (..., 3) in axes turned by rotvecs (..., 3): R(θu)ᵀ v."""
    w, axis = _quaternion(rotvecs)
    rows = np.asarray(vectors, dtype=np.float64)
    aside = cross(rows, axis)
    return np.asarray(rows + 2.0 * (w[..., None] * aside + cross(aside, axis)))


def _quaternion(rotvec: npt.ArrayLike) -> tuple[Array, Array]:
    """Return scalar (...) and vector part (..., 3) of exp(rotvec)."""
    rotvec = np.asarray(rotvec, dtype=np.float64)
    angle = np.sqrt(np.add.reduce(rotvec * rotvec, axis=-1))
    # sin(θ/2)/θ through sinc, smooth at θ = 0; `numpy.sinc` takes twice as long.
    half = np.pi * np.maximum(angle / (2 * np.pi), 1e-20)
    scale = 0.5 * (np.sin(half) / half)
    return np.cos(angle / 2), rotvec * scale[..., None]


def _quaternion_product(
    w_a: Array, vec_a: Array, w_b: Array, vec_b: Array
) -> tuple[Array, Array]:
    """Return the Hamilton product of two quaternions in scalar and vector parts."""
    w = w_a * w_b - np.add.reduce(vec_a * vec_b, axis=-1)
    vec = w_a[..., None] * vec_b + w_b[..., None] * vec_a + cross(vec_a, vec_b)
    return w, vec


_NEXT, _LAST = np.array([1, 2, 0]), np.array([2, 0, 1])


def cross(a: Array, b: Array) -> Array:
    """Return a × b, (..., 3); `numpy.cross` takes five times as long per call."""
    first = a.take(_NEXT, -1) * b.take(_LAST, -1)
    return np.asarray(first - a.take(_LAST, -1) * b.take(_NEXT, -1))


def _check_weight(rotation_weight: float) -> None:
    """Raise unless the weight is one that Eq. (17) allows."""
    if not 0.0 <= rotation_weight <= 1.0:
        raise ValueError(f"rotation_weight must lie in [0, 1], got {rotation_weight}")


def handle_pose_on_arc(radius: ArrayLike, angle: ArrayLike) -> Array:
    """Return the handle's poses (..., 6) at opening angles, task frame [m, rad].

    x = R sin φ, z = -R (1 - cos φ), rotation +φ about y; radii and angles broadcast.
    """
    radii, angles = np.broadcast_arrays(radius, angle)
    poses = np.zeros((*angles.shape, 6))
    poses[..., 0] = radii * np.sin(angles)
    poses[..., 2] = radii * (np.cos(angles) - 1.0)
    poses[..., 4] = angles
    return poses
