"""Geometry of a handle that is turned before its door opens.

While a lever is turned, the hand moves on an arc about its axis, which carries no
information about the door. A point on the axis rests. Poses are in the task frame.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
import scipy

from gplfd_env.conventions.constants import Vector
from gplfd_policies.arrays.shapes import Axes
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

Quaternion = tuple[float, float, float, float]  # (w, x, y, z).

_FIRST_TURNS: Final = (0.4, 0.25)
"""Least turns of the hand before the door moves [rad]: of levers, then of paddles."""
_LATER_TURN: Final = 0.2  # least angle of a later turn with a well-defined axis [rad]
_ANOTHER: Final = math.radians(45.0)
"""Two axes differ if the angle between them exceeds this [rad]."""
_STILL: Final = 0.015  # Largest root-mean-square motion of the resting point [m].
_LEAST_ARM: Final = 0.03
"""Lever arm [m] below which the handle counts as a knob, turned by a moment only."""
_MOVED: Final = 0.01
"""Displacement of the axis above which the door counts as moving [m]."""
_FIRM: Final = 1e3
"""Weight of the choice of a point along the axis, relative to that of a sample."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TurnedHandle:
    """The axis of a handle relative to the hand, at the start.

    With the hand at position p and rotation R, the axis's point is displaced by p + (R
    - 1) s. Python floats give one hand and many the same bits. Poses: (6,) [m, rad].
    """

    point: Vector
    """s: a point of the axis relative to the hand [m]."""
    axis: Vector
    """a: direction of the axis, a unit vector; the first turn about it is positive."""
    travel: float = 0.0
    """Mean of the largest demonstrated turns [rad]."""
    opens: float = 0.0
    """Phase at which the axis, and with it the door, begins to move."""

    def with_turn(self, pose: list[float], turn: float) -> list[float]:
        """Return the hand pose for another turn of the handle, with the same leaf."""
        leaf, _ = self.swing_twist(pose[3:])
        ax, ay, az = self.axis
        handle = [turn * ax, turn * ay, turn * az]
        rotation = _rotvec(_product(_quaternion(leaf), _quaternion(handle)))
        sx, sy, sz = self.point
        x, y, z = self.axis_displacement(pose)
        rx, ry, rz = _turned(self.point, rotation)
        return [x + sx - rx, y + sy - ry, z + sz - rz, *rotation]

    def without_handle_motion(
        self, pose: list[float], mean: list[float]
    ) -> list[float]:
        """Return the hand pose with the expected motion of the handle."""
        _, turn = self.swing_twist(mean[3:])
        x, y, z, *rotation = self.with_turn(pose, turn)
        px, py, pz = self.axis_displacement(pose)
        mx, my, mz = self.axis_displacement(mean)
        wx, wy, wz = self.turning_direction(mean)
        lag = (mx - px) * wx + (my - py) * wy + (mz - pz) * wz
        return [x + lag * wx, y + lag * wy, z + lag * wz, *rotation]

    def axis_displacement(self, pose: list[float]) -> Vector:
        """Return the displacement of the axis's point from its start [m]."""
        x, y, z, *rotation = pose
        sx, sy, sz = self.point
        rx, ry, rz = _turned(self.point, rotation)
        return x + (rx - sx), y + (ry - sy), z + (rz - sz)

    def turning_direction(self, pose: list[float]) -> Vector:
        """Return the hand's direction of turning, R (s × a) / arm; zero for a knob."""
        lever, arm = self._lever()
        if arm < _LEAST_ARM:
            return 0.0, 0.0, 0.0
        x, y, z = lever
        return _turned((x / arm, y / arm, z / arm), pose[3:])

    @property
    def arm(self) -> float:
        """Distance of the hand from the axis [m]; zero for a knob."""
        _, arm = self._lever()
        return 0.0 if arm < _LEAST_ARM else arm

    def turned(self, pose: list[float]) -> float:
        """Return the turn of the handle of a closed door [rad].

        The hand may turn on a lever: the axis's apparent way along its path is added.
        """
        _, turn = self.swing_twist(pose[3:])
        _, arm = self._lever()
        if arm < _LEAST_ARM:
            return turn
        px, py, pz = self.axis_displacement(pose)
        wx, wy, wz = self.turning_direction(pose)
        return turn + (px * wx + py * wy + pz * wz) / arm

    def _lever(self) -> tuple[Vector, float]:
        """Return s × a and its length, the lever arm [m]."""
        (sx, sy, sz), (ax, ay, az) = self.point, self.axis
        x, y, z = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        return (x, y, z), math.sqrt(x * x + y * y + z * z)

    def swing_twist(self, rotation: list[float]) -> tuple[Vector, float]:
        """Split a rotation vector into the leaf's swing and the handle's turn [rad]."""
        w, x, y, z = _quaternion(rotation)
        ax, ay, az = self.axis
        half = math.atan2(x * ax + y * ay + z * az, w)
        cosine, sine = math.cos(half), -math.sin(half)
        # q ∘ twist⁻¹.
        back = cosine, ax * sine, ay * sine, az * sine
        return _rotvec(_product((w, x, y, z), back)), 2.0 * half

    def axis_positions(self, poses: Axes) -> Axes:
        """Return poses (*N, 6) with the position of the axis's point."""
        moved = poses.copy()
        for row in moved.reshape(-1, 6):
            row[:3] = self.axis_displacement(row.tolist())
        return moved

    def seen(self, aligned: AlignedDemonstrations) -> AlignedDemonstrations:
        """Return demonstrations with positions of the axis instead of the hand."""
        return replace(aligned, poses=self.axis_positions(aligned.poses))


def turned_handle(aligned: AlignedDemonstrations) -> TurnedHandle | None:
    """Find the handle that demonstrations turn first; None for a bar.

    The hand must turn about one axis first, end turned about another, and have a point
    s fixed to it that rests during the first turn, p + (R - 1) s = 0, by least squares
    over positions p and rotations R of all demonstrations.
    """
    paths, numbers = aligned.demonstrated.poses, np.arange(len(aligned.poses))
    angles = np.sqrt((paths[..., 3:] ** 2).sum(axis=2))
    for first_turn in _FIRST_TURNS:
        turned = np.argmax(angles >= first_turn, axis=1)
        if not turned.all() or angles[:, -1].min() < _LATER_TURN:
            continue
        turns = paths[numbers, turned, 3:] / angles[numbers, turned, None]
        first = np.mean(turns, axis=0)
        first = first / math.sqrt(float(first @ first))
        last = np.mean(paths[:, -1, 3:] / angles[:, -1:], axis=0)
        if abs(float(first @ last)) > math.cos(_ANOTHER):
            continue
        ends = (turned + 1).tolist()
        arcs = np.vstack([path[:end] for path, end in zip(paths, ends, strict=True)])
        rotations = scipy.spatial.transform.Rotation.from_rotvec(arcs[:, 3:].copy())
        matrix = (rotations.as_matrix() - np.eye(3)).reshape(-1, 3)
        side = -arcs[:, :3].ravel()
        # Every point along the axis is a solution; the nearest one is used.
        firm = np.vstack([matrix, _FIRM * np.outer(first, first)])
        point, *_ = np.linalg.lstsq(firm, np.concatenate([side, np.zeros(3)]))
        left = matrix @ point - side
        if math.sqrt(3.0 * float(np.mean(left * left))) > _STILL:
            continue
        px, py, pz = point.tolist()
        ax, ay, az = first.tolist()
        handle = TurnedHandle(point=(px, py, pz), axis=(ax, ay, az))
        furthest = [
            max(handle.swing_twist(rotation)[1] for rotation in path[:, 3:].tolist())
            for path in paths
        ]
        places = handle.axis_positions(aligned.poses)[..., :3].mean(axis=0)
        moved = np.sqrt((places**2).sum(axis=1)) >= _MOVED
        opens = float(aligned.times[int(np.argmax(moved))])
        return replace(handle, travel=float(np.mean(furthest)), opens=opens)
    return None


def _quaternion(rotation: Sequence[float]) -> Quaternion:
    a, b, c = rotation
    angle = math.sqrt(a * a + b * b + c * c)
    share = 0.5 if angle < 1e-9 else math.sin(0.5 * angle) / angle
    return math.cos(0.5 * angle), a * share, b * share, c * share


def _rotvec(quaternion: Quaternion) -> Vector:
    w, x, y, z = quaternion
    length = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 if length < 1e-9 else 2.0 * math.atan2(length, w) / length
    return x * scale, y * scale, z * scale


def _product(first: Quaternion, second: Quaternion) -> Quaternion:
    """Return first ∘ second."""
    w, x, y, z = first
    d, a, b, c = second
    return (
        w * d - x * a - y * b - z * c,
        w * a + x * d + y * c - z * b,
        w * b - x * c + y * d + z * a,
        w * c + x * b - y * a + z * d,
    )


def _turned(vector: Vector, rotation: Sequence[float]) -> Vector:
    """Rotate a vector by a rotation vector: Rodrigues' formula."""
    a, b, c = rotation
    x, y, z = vector
    angle = math.sqrt(a * a + b * b + c * c)
    if angle < 1e-9:
        return vector
    a, b, c = a / angle, b / angle, c / angle
    ux, uy, uz = b * z - c * y, c * x - a * z, a * y - b * x
    vx, vy, vz = b * uz - c * uy, c * ux - a * uz, a * uy - b * ux
    sine, rest = math.sin(angle), 1.0 - math.cos(angle)
    return (
        x + sine * ux + rest * vx,
        y + sine * uy + rest * vy,
        z + sine * uz + rest * vz,
    )
