"""The handle that a hand turns before it moves on: its axis, and the way about it.

A lever is turned before its door opens. The hand, centimetres from the lever's axis,
then goes along an arc that says nothing of the door, and that is as large before a
small door as before a large one. What goes along the door's own circle, from its start
and whatever the handle does, is the point of the hand that rests while the handle is
turned.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

Vector = tuple[float, float, float]
Quaternion = tuple[float, float, float, float]
"""(w, x, y, z)."""

Poses = Float[np.ndarray, "*N 6"]

_FIRST_TURN: Final = 0.4
"""What a hand turns by before a door has moved [rad]: less than handles ask for."""

_LATER_TURN: Final = 0.2
"""A later turn by less has no axis [rad]."""

_ANOTHER: Final = math.radians(45.0)
"""Axes are two that are farther apart than this [rad]."""

_STILL: Final = 0.015
"""What the point that rests moves by at most, root mean square [m]: a sensor beside the
handle is a centimetre from where the hand holds it."""

_LEAST_ARM: Final = 0.03
"""Who holds a handle nearer to its axis turns it by a moment, as a knob, and no force
is along its way [m]."""

_MOVED: Final = 0.01
"""An axis that has moved has moved by this much [m]."""

_FIRM: Final = 1e3
"""Weight of the choice of a point along an axis, over that of a sample."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TurnedHandle:
    """An axis that is fixed to the hand, where and as it is at the start; task frame.

    A hand at p, turned by R, has the axis's point at p + (R - 1) s from its start. All
    is computed in single numbers, so that one hand and many give the same bits.
    """

    point: Vector
    """s: a point of the axis, from the hand [m]."""
    axis: Vector
    """a: its direction, a unit vector; the handle is first turned about it by a
    positive angle."""
    travel: float = 0.0
    """How far it was turned when it was shown: the mean of the greatest turns [rad]."""
    opens: float = 0.0
    """Phase from which on its axis moves, and with it the door."""

    def held(self, pose: list[float], turn: float) -> list[float]:
        """Return the pose of a hand that turns the handle by another angle.

        The leaf, and with it the handle's axis, stays where the hand has it.

        Args:
            pose: Of the hand, (6,) [m, rad].
            turn: The angle [rad].
        """
        leaf, _ = self.turns(pose[3:])
        ax, ay, az = self.axis
        handle = [turn * ax, turn * ay, turn * az]
        rotation = _rotvec(_product(_quaternion(leaf), _quaternion(handle)))
        sx, sy, sz = self.point
        x, y, z = self.place(pose)
        rx, ry, rz = _turned(self.point, rotation)
        return [x + sx - rx, y + sy - ry, z + sz - rz, *rotation]

    def told(self, pose: list[float], mean: list[float]) -> list[float]:
        """Return what a hand's pose tells of the door, beside what was expected.

        It is the pose with the handle turned as expected, and moved along the way about
        its axis to where the hand was expected: there it goes as the handle's spring
        has it.

        Args:
            pose: Of the hand, (6,) [m, rad].
            mean: Expected, (6,) [m, rad].
        """
        _, turn = self.turns(mean[3:])
        x, y, z, *rotation = self.held(pose, turn)
        px, py, pz = self.place(pose)
        mx, my, mz = self.place(mean)
        wx, wy, wz = self.way(mean)
        lag = (mx - px) * wx + (my - py) * wy + (mz - pz) * wz
        return [x + lag * wx, y + lag * wy, z + lag * wz, *rotation]

    def place(self, pose: list[float]) -> Vector:
        """Return where the axis's point is, from its start [m].

        Args:
            pose: Of the hand, (6,) [m, rad].
        """
        x, y, z, *rotation = pose
        sx, sy, sz = self.point
        rx, ry, rz = _turned(self.point, rotation)
        return x + (rx - sx), y + (ry - sy), z + (rz - sz)

    def way(self, pose: list[float]) -> Vector:
        """Return where the hand goes while the handle turns: R (s × a), of length one.

        Zero for a knob.
        """
        (sx, sy, sz), (ax, ay, az) = self.point, self.axis
        x, y, z = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        arm = math.sqrt(x * x + y * y + z * z)
        if arm < _LEAST_ARM:
            return 0.0, 0.0, 0.0
        return _turned((x / arm, y / arm, z / arm), pose[3:])

    def turned(self, pose: list[float]) -> float:
        """Return by how much a closed door's handle is turned [rad].

        The hand may turn on a lever. So it counts where the hand is along its way: the
        place of an axis that rests is zero.

        Args:
            pose: Of the hand, (6,) [m, rad].
        """
        _, turn = self.turns(pose[3:])
        (sx, sy, sz), (ax, ay, az) = self.point, self.axis
        x, y, z = sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax
        arm = math.sqrt(x * x + y * y + z * z)
        if arm < _LEAST_ARM:
            return turn
        px, py, pz = self.place(pose)
        wx, wy, wz = self.way(pose)
        return turn + (px * wx + py * wy + pz * wz) / arm

    def turns(self, rotation: list[float]) -> tuple[Vector, float]:
        """Return the leaf's turn and the handle's: hand = leaf ∘ handle.

        The handle's is the twist about its axis, the leaf's the swing that is left.

        Args:
            rotation: Of the hand, a rotation vector (3,) [rad].

        Returns:
            A rotation vector across the axis, and an angle [rad].
        """
        w, x, y, z = _quaternion(rotation)
        ax, ay, az = self.axis
        half = math.atan2(x * ax + y * ay + z * az, w)
        cosine, sine = math.cos(half), -math.sin(half)
        # q ∘ twist⁻¹.
        back = cosine, ax * sine, ay * sine, az * sine
        return _rotvec(_product((w, x, y, z), back)), 2.0 * half

    def places(self, poses: Poses) -> Poses:
        """Return poses (*N, 6) with the point's places instead of the hand's."""
        moved = poses.copy()
        for row in moved.reshape(-1, 6):
            row[:3] = self.place(row.tolist())
        return moved


def turned_handle(aligned: AlignedDemonstrations) -> TurnedHandle | None:
    """Return the handle that demonstrations turn first.

    A hand that turns about one axis first, by `_FIRST_TURN`, and is turned about
    another in the end, turns a handle if a point rests meanwhile that is fixed to it:

        p + (R - 1) s = 0,

    by least squares over positions p and rotations R of all demonstrations.

    Returns:
        The handle; None of a bar, or where no point rests.
    """
    firsts, lasts, rows, sides = [], [], [], []
    for poses in aligned.demonstrated.poses:
        angles = np.sqrt((poses[:, 3:] ** 2).sum(axis=1))
        turned = int(np.argmax(angles >= _FIRST_TURN))
        if turned == 0 or angles[-1] < _LATER_TURN:
            return None
        firsts.append(poses[turned, 3:] / angles[turned])
        lasts.append(poses[-1, 3:] / angles[-1])
        rotations = Rotation.from_rotvec(poses[: turned + 1, 3:].copy())
        rows.append(
            rotations.as_matrix().reshape(-1, 3) - np.tile(np.eye(3), (turned + 1, 1))
        )
        sides.append(-poses[: turned + 1, :3].ravel())
    first = np.mean(firsts, axis=0)
    first = first / math.sqrt(float(first @ first))
    if abs(float(first @ np.mean(lasts, axis=0))) > math.cos(_ANOTHER):
        return None
    matrix, side = np.vstack(rows), np.concatenate(sides)
    # Along the axis any point would do: the nearest is taken.
    firm = np.vstack([matrix, _FIRM * np.outer(first, first)])
    point, *_ = np.linalg.lstsq(firm, np.concatenate([side, np.zeros(3)]))
    left = matrix @ point - side
    if math.sqrt(3.0 * float(np.mean(left * left))) > _STILL:
        return None
    px, py, pz = point.tolist()
    ax, ay, az = first.tolist()
    handle = TurnedHandle(point=(px, py, pz), axis=(ax, ay, az))
    furthest = [
        max(handle.turns(rotation)[1] for rotation in poses[:, 3:].tolist())
        for poses in aligned.demonstrated.poses
    ]
    places = handle.places(aligned.poses)[..., :3].mean(axis=0)
    moved = np.sqrt((places**2).sum(axis=1)) >= _MOVED
    return replace(
        handle,
        travel=float(np.mean(furthest)),
        opens=float(aligned.times[int(np.argmax(moved))]),
    )


def seen_at(
    aligned: AlignedDemonstrations, handle: TurnedHandle
) -> AlignedDemonstrations:
    """Return the demonstrations of a handle's axis instead of the hand's."""
    return replace(aligned, poses=handle.places(aligned.poses))


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
    """Return a vector, turned by a rotation vector: Rodrigues' formula."""
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
