"""The point about which a hand turns before it moves on: the axis of a handle.

A lever is turned before its door opens. The hand, centimetres from the lever's axis,
then goes along an arc that says nothing of the door, and that is as large before a
small door as before a large one. What goes along the door's own circle, from its
start and whatever the handle does, is the point of the hand that rests while the
handle is turned.
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_env.se3 import relative_poses
from policies.aligned import AlignedDemonstrations

Point = tuple[float, float, float]
"""A point that is fixed to the hand, from the hand's own at the start [m]."""

_FIRST_TURN: Final = 0.4
"""What a hand turns by before a door has moved [rad]: less than any handle asks for."""

_FIRM: Final = 1e3
"""Weight of the choice of a point along an axis, over that of a sample."""

_LEAST_TURN: Final = 0.2
"""A later turn by less has no axis [rad]."""

_ANOTHER: Final = math.cos(math.radians(45.0))
"""Axes are two that are farther apart than this."""


def pivot(aligned: AlignedDemonstrations) -> Point | None:
    """Return the point about which demonstrations turn first.

    A hand that turns about one axis first, by `_FIRST_TURN`, and about another later
    turns a handle. The point s, fixed to the hand, that rests meanwhile solves

        p + (R(θ) - 1) s = 0

    for the hand's positions p and rotations θ, by least squares.

    Returns:
        s in the task frame's axes at the start [m]; None if the hand turns about one
        axis, as on a bar.
    """
    rows, sides, first_axes, later_axes = [], [], [], []
    for poses in aligned.demonstrated.poses:
        angles = np.sqrt((poses[:, 3:] ** 2).sum(axis=1))
        turned = int(np.argmax(angles >= _FIRST_TURN))
        later = relative_poses(poses, poses[turned])[-1, 3:]
        if turned == 0 or math.sqrt(float(later @ later)) < _LEAST_TURN:
            return None
        first_axes.append(poses[turned, 3:] / angles[turned])
        # What is left of the whole turn, about axes that do not turn with the hand.
        left = poses[-1, 3:]
        later_axes.append(left / math.sqrt(float(left @ left) + 1e-12))
        for pose in poses[: turned + 1]:
            rows.append(_rotation(*pose[3:].tolist()) - np.eye(3))
            sides.append(-pose[:3])
    first, later_axis = np.mean(first_axes, axis=0), np.mean(later_axes, axis=0)
    if abs(float(first @ later_axis)) > _ANOTHER:
        return None
    # Along the axis of the turn any point would do: the nearest is taken.
    rows.append(_FIRM * np.outer(first, first))
    sides.append(np.zeros(3))
    point, *_ = np.linalg.lstsq(np.vstack(rows), np.concatenate(sides))
    x, y, z = point.tolist()
    return x, y, z


def at_point(
    poses: Float[np.ndarray, "*N 6"], point: Point
) -> Float[np.ndarray, "*N 6"]:
    """Return the poses of a point that is fixed to the hand, (*N, 6) [m, rad]."""
    moved = poses.copy()
    flat = moved.reshape(-1, 6)
    for row in flat:
        row[:3] = position_at(row.tolist(), point)
    return moved


def position_at(pose: list[float], point: Point) -> Point:
    """Return where a point that is fixed to the hand is, from its start: p + (R - 1) s.

    In single numbers, so that one hand and many give the same bits.

    Args:
        pose: Of the hand, (6,) [m, rad].
        point: s [m].
    """
    x, y, z, a, b, c = pose
    sx, sy, sz = point
    angle = math.sqrt(a * a + b * b + c * c)
    if angle < 1e-9:
        return x, y, z
    # R s - s = sin θ (k × s) + (1 - cos θ) k × (k × s), the axis k.
    a, b, c = a / angle, b / angle, c / angle
    ux, uy, uz = b * sz - c * sy, c * sx - a * sz, a * sy - b * sx
    vx, vy, vz = b * uz - c * uy, c * ux - a * uz, a * uy - b * ux
    sine, rest = math.sin(angle), 1.0 - math.cos(angle)
    return (
        x + sine * ux + rest * vx,
        y + sine * uy + rest * vy,
        z + sine * uz + rest * vz,
    )


def seen_at(aligned: AlignedDemonstrations, point: Point) -> AlignedDemonstrations:
    """Return demonstrations of a point that is fixed to the hand."""
    return replace(aligned, poses=at_point(aligned.poses, point))


def _rotation(a: float, b: float, c: float) -> Float[np.ndarray, "3 3"]:
    columns = [
        position_at([0.0, 0.0, 0.0, a, b, c], axis) for axis in np.eye(3).tolist()
    ]
    return np.array(columns).T + np.eye(3)
