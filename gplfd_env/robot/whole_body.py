"""Control of the mobile base: the whole-body rule and the limits of the drive.

The arm is strong and far from its limits in the posture that holds the closed handle,
and the base moves such that the arm keeps it: as if it were fixed to the commanded hand
in the plane. With the hand's closed position h₀, its commanded displacement d and its
commanded yaw ψ (the twist of the rotation vector about the vertical), the target of a
base that started at the origin is

    b = h₀ + d - R(c ψ) h₀,    yaw c ψ.

A hand that moves towards the robot pulls the door open: c = 1, base and hand move as
one rigid body. A hand that moves away pushes the door through its frame, where a base
rigidly behind it would hit the wall beside the lock: c = 0.3, the hand turns more than
the base. Within 5 cm of the closed door c is interpolated linearly.

The arm alone executes motions within the dead band `DEAD_BAND`. Behind it the base
moves at the rate of the target, and reduces its distance to it with the time constant
`LAG`, within its braking distance. The hand's servo acts in the task frame, which is
fixed in the world, so the arm compensates the base.
"""

import math
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.placement import task_rotation_w

Planar = tuple[float, float, float]
"""x, y and yaw, or their rates: [m, m, rad], [m/s, m/s, rad/s]."""
Matrix = list[list[float]]
"""Three unit vectors."""
SPEED: Final = (1.0, 2.09)
"""Greatest speed of the base [m/s, rad/s]."""
ACCELERATION: Final = (1.0, 2.09)
"""Greatest acceleration of the base [m/s², rad/s²]."""
LAG: Final = 0.3
"""Time constant with which the base reduces its distance to the target [s]."""
DEAD_BAND: Final = (0.04, 0.07)
"""Dead band: distance from the target within which the base stands still [m, rad]."""
TURN: Final = (0.3, 1.0)
"""c: share of the hand's yaw that the base takes when the hand moves away, or towards
it."""

_COMING: Final = 0.05  # c is constant beyond this displacement of the hand [m].
# The base can count as blocked only above this commanded speed [m/s, rad/s].
_BLOCKED_SPEED: Final = (0.05, 0.1)

BLOCKED_TIME: Final = 0.5
"""The base is blocked after this long at less than half of its commanded speed [s]."""


class BaseDrive:
    """Commands the base of one simulation and detects that it is blocked.

    The hand holds the closed handle at `hand`, world frame [m]; `rate` is the commanded
    rate of the base's pose, world frame [m/s, rad/s].
    """

    def __init__(
        self, hand: tuple[float, float], door: DoorConfig, robot: RobotConfig
    ) -> None:
        self._hand = hand
        self._axes: Matrix = task_rotation_w(door, robot).T.tolist()
        self._dragged: Planar = (0.0, 0.0, 0.0)
        self.rate: Planar = (0.0, 0.0, 0.0)
        self._slowed = 0.0

    def follow(self, hand: list[float], base: Planar) -> None:
        """Command the base by the whole-body rule from a commanded hand pose, (6,)."""
        last = self._dragged
        x, y, yaw = self._dragged = _dragged(last, led_by(hand, self._hand, self._axes))
        dx, dy, turn = x - base[0], y - base[1], yaw - base[2]
        away = math.hypot(dx, dy)
        share = _approach(away, ACCELERATION[0]) / away if away > 0.0 else 0.0
        turning = math.copysign(_approach(abs(turn), ACCELERATION[1]), turn)
        vx = (x - last[0]) / CONTROL_PERIOD + share * dx
        vy = (y - last[1]) / CONTROL_PERIOD + share * dy
        self._accelerate((vx, vy, (yaw - last[2]) / CONTROL_PERIOD + turning))

    def obey(self, twist: list[float], base: Planar) -> None:
        """Command the base by a twist: ahead, left, turning left [m/s, rad/s]."""
        forward, left, turning = twist
        cosine, sine = math.cos(base[2]), math.sin(base[2])
        ahead, aside = cosine * forward - sine * left, sine * forward + cosine * left
        self._accelerate((ahead, aside, turning))

    def _accelerate(self, wanted: Planar) -> None:
        """Move the commanded rate towards a wanted one within the drive's limits."""
        vx, vy, turning = self.rate
        wx, wy = _shortened(wanted[0], wanted[1], SPEED[0])
        ax, ay = _shortened(wx - vx, wy - vy, ACCELERATION[0] * CONTROL_PERIOD)
        wanted_turn = min(max(wanted[2], -SPEED[1]), SPEED[1])
        step = ACCELERATION[1] * CONTROL_PERIOD
        turn = min(max(wanted_turn - turning, -step), step)
        self.rate = (vx + ax, vy + ay, turning + turn)

    def update_blocked(self, velocity: Planar) -> None:
        """Detect a blocked base from its measured rate [m/s, rad/s]."""
        vx, vy, turning = self.rate
        speed = math.hypot(vx, vy)
        along = vx * velocity[0] + vy * velocity[1]
        slow = speed > _BLOCKED_SPEED[0] and along < 0.5 * speed * speed
        slow_turn = turning * velocity[2] < 0.5 * turning * turning
        stiff = abs(turning) > _BLOCKED_SPEED[1] and slow_turn
        self._slowed = self._slowed + CONTROL_PERIOD if slow or stiff else 0.0

    @property
    def blocked(self) -> bool:
        """Whether something blocks the base."""
        return self._slowed >= BLOCKED_TIME - 1e-9


def led_by(hand: list[float], closed: tuple[float, float], axes: Matrix) -> Planar:
    """Return the target of the base, world frame, for a pose of the hand (6,).

    It is relative to the closed grasp, where the hand is at `closed` [m]; `axes` are
    the task frame's in the world frame.
    """
    x, y, z, rx, ry, rz = hand
    coming = min(max(x / _COMING, -1.0), 1.0)
    share = 0.5 * (TURN[0] + TURN[1] + coming * (TURN[1] - TURN[0]))
    # The twist of the rotation vector about y: swing and twist.
    angle, twist = math.sqrt(rx * rx + ry * ry + rz * rz), 0.0
    if angle > 0.0:
        half = 0.5 * angle
        twist = 2.0 * math.atan2(math.sin(half) * ry / angle, math.cos(half))
    yaw = share * twist
    cosine, sine = math.cos(yaw), math.sin(yaw)
    hx, hy = closed
    pull, up, left = axes
    x = hx + pull[0] * x + up[0] * y + left[0] * z - (cosine * hx - sine * hy)
    return (
        x,
        hy + pull[1] * hand[0] + up[1] * y + left[1] * z - (sine * hx + cosine * hy),
        yaw,
    )


def _dragged(pose: Planar, by: Planar) -> Planar:
    """Return a pose moved towards another until it is within the dead band."""
    dx, dy = by[0] - pose[0], by[1] - pose[1]
    away = math.hypot(dx, dy)
    share = (away - DEAD_BAND[0]) / away if away > DEAD_BAND[0] else 0.0
    turn = by[2] - pose[2]
    rest = min(max(turn, -DEAD_BAND[1]), DEAD_BAND[1])
    return pose[0] + share * dx, pose[1] + share * dy, pose[2] + (turn - rest)


def _approach(away: float, acceleration: float) -> float:
    """Return the approach speed at a distance s: v = s/T, at most √(a s).

    Braking is possible up to √(2 a s); the rest is a margin for a moving target.
    """
    return min(away / LAG, math.sqrt(acceleration * away))


def _shortened(x: float, y: float, most: float) -> tuple[float, float]:
    length = math.hypot(x, y)
    if length <= most:
        return x, y
    return x * (most / length), y * (most / length)
