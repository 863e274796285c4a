"""Agents that find the path during the motion, and their path and compliance.

The simplest pull back, or in the direction of the last displacement: the last few
centimetres of a handle's path are nearly tangent to its circle. `HingeFitAgent` fits a
circle.

The admittance is the same as in the learned agents, Eq. (22) of Arduengo et al.,
arXiv:2002.09979, M ë + D ė + K e = F. Learned agents follow a learned path. An agent
that finds the path during the motion needs a very soft spring: with D² ≫ 4 M K the
displacement follows ė = F/D for some twenty seconds. It integrates the force, so that a
lasting lateral force becomes zero instead of being balanced. With the robot's servo of
2000 N/m the bandwidth of the loop is 2000/D = 20 rad/s, with a delay margin of 80 ms.
"""

import math
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.circle import UPRIGHT, Circle
from gplfd_policies.arrays.shapes import Float, SixAxes
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.steps import AgentStep, Observation, measured
from gplfd_policies.control.stiffness import VirtualDynamics

Point = Float[np.ndarray, " 3"]

_PULL: Final = np.array([1.0, 0.0, 0.0])
"""Pulling direction of a closed door, task frame."""
_SPACING: Final = 0.005
"""Length of a segment of the path [m]: several times the noise of a position, so that a
hand at rest adds no segment. Tuned."""
_CHORD: Final = 12
"""Number of segments that the last displacement spans. Tuned."""
_STIFFNESS: Final = np.repeat([5.0, 0.5], 3)
"""K, translation [N/m] and rotation [N m/rad]. Tuned."""
_NEARLY_FREE: Final = VirtualDynamics(mass=np.repeat([1.0, 0.1], 3), damping_ratio=22.4)
"""M, and δ, with which D = 2 δ √(M K) is 100 N s/m and 10 N m s/rad. Tuned."""
JUMP_DECAY: Final = 0.95
"""Share of a jump between two estimates of the path left after a period. Tuned."""


class HandPath:
    """The hand's path since the closed door, as the mean points of its segments.

    Points are positions [m], size 3, or poses [m, rad], size 6.
    """

    points: Float[np.ndarray, "N size"]

    def __init__(self, size: int = 3) -> None:
        self.points, self._last = np.zeros((0, size)), np.zeros(3)
        self._sum, self._count = np.zeros(size), 0

    def add(self, point: Float[np.ndarray, " size"]) -> bool:
        """Add a point of the hand; return whether it ends a segment."""
        self._sum += point
        self._count += 1
        if math.dist(point[:3], self._last) < _SPACING:
            return False
        self._last = point[:3].copy()
        self.points = np.vstack([self.points, self._sum / self._count])
        self._sum, self._count = np.zeros_like(self._sum), 0
        return True

    def direction(self) -> Point:
        """Return the direction of the last displacement; at first the pull."""
        missing = _CHORD - len(self.points)
        if missing == _CHORD:
            return _PULL
        start = -missing * _SPACING * _PULL
        if missing <= 0:
            start = self.points[-_CHORD]
        chord = self.points[-1] - start
        return np.asarray(chord / np.sqrt(chord @ chord))


def accelerated(speed: float, left: float, rate: float, most: float) -> float:
    """Return the next speed, at most ``most``, that can still stop at a place.

    Speeds rise and fall by ``rate`` per second; ``left`` is the rest of the way.
    """
    return min(speed + rate * CONTROL_PERIOD, math.sqrt(2.0 * rate * left), most)


def turned_towards(direction: Point) -> Point:
    """Return the shortest rotation vector from the pull to a unit vector."""
    _, up, left = direction
    across = np.array([0.0, -left, up])
    sine = math.hypot(up, left)
    scale = math.atan2(sine, direction[0]) / sine if sine > 1e-9 else 1.0
    return np.asarray(scale * across)


class CompliantSetPoint:
    """Set-points that forces displace; initially at rest and not displaced."""

    def __init__(self) -> None:
        self._admittance = Admittance(_NEARLY_FREE)

    def step(self, desired: SixAxes, wrench: SixAxes, **known: Any) -> AgentStep:
        """Return the step that commands a pose, displaced by a wrench."""
        offset = self._admittance.step(_STIFFNESS, wrench, CONTROL_PERIOD)
        action = desired + offset
        action[3:] = compose_rotvecs(offset[3:], desired[3:])
        return AgentStep(action=action, desired=desired, stiffness=_STIFFNESS, **known)


_PULL_WRENCH: Final = np.array([16.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Constant wrench that pulls the set-point away from the door [N, N m]. Tuned."""
_LEAD: Final = 0.015
"""Distance of the set-point ahead of the hand [m]: 30 N of the robot's servo."""
_LEAD_RATE: Final = 0.015
"""Rate at which the lead grows at first [m/s]. Tuned."""
_SPEED: Final = 0.12
"""Speed of the set-point that moves in the last direction [m/s]. Tuned."""


class CompliantPullAgent:
    """Pulls straight back with a constant force and yields to everything else."""

    def __init__(self) -> None:
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._set_point = CompliantSetPoint()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        _, wrench = measured(observation)
        return self._set_point.step(np.zeros(6), wrench + _PULL_WRENCH)


class ChordAgent:
    """Commands a point ahead of the hand, in the direction of its last displacement."""

    def __init__(self) -> None:
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path = HandPath()
        self._lead, self._action = 0.0, np.zeros(6)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand = measured(observation)[0][:3]
        self._path.add(hand)
        direction = self._path.direction()
        turn = turned_towards(direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            farther = self._lead + _LEAD_RATE * CONTROL_PERIOD
            self._lead = min(farther, _LEAD)
            self._action = np.concatenate([hand + self._lead * direction, turn])
        return AgentStep(action=self._action)


class ReflexAgent:
    """Moves in the direction of the last displacement; yields to forces across it."""

    def __init__(self) -> None:
        self._load = CarriedLoad()
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path, self._set_point = HandPath(), CompliantSetPoint()
        self._position = np.zeros(3)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        self._path.add(hand[:3])
        direction = self._path.direction()
        turn = turned_towards(direction)
        load = self._load.compensate(wrench, direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            self._position += _SPEED * CONTROL_PERIOD * load.pace * direction
        desired = np.concatenate([self._position, turn])
        return self._set_point.step(desired, load.compliant_wrench)


_ANGULAR_SPEED: Final = 0.25
"""Angular speed of the opening [rad/s]. Tuned."""
_ANGULAR_ACCELERATION: Final = 0.125
"""Angular acceleration and deceleration [rad/s²]. Tuned."""


class HingeFitAgent:
    """Finds the hinge while it opens the door, and follows the circle about it.

    The hand moves along the circle estimated from its path so far and turns with the
    angle. It yields to every force except the door's resistance along the path: a
    lasting radial force, which shows that the circle is wrong, displaces the command.
    """

    def __init__(self) -> None:
        self._load = CarriedLoad()
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed door."""
        self._path, self._set_point = HandPath(), CompliantSetPoint()
        self._circle = Circle.expected(UPRIGHT)
        self._door = self._circle.door()
        # A length, not an angle: a change of radius moves the set-point only sideways.
        self._travelled = self._speed = 0.0
        self._fading = np.zeros(6)
        self.observed_angle = 0.0

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        if self._path.add(hand[:3]):
            # A new estimate: the command changes to it without a jump.
            before = self._door.hand_poses(self._angle)
            self._circle = self._circle.updated(self._path.points)
            self._door = self._circle.door()
            self._fading += before - self._door.hand_poses(self._angle)

        # The set-point advances; it stops at the angle at which demonstrations end.
        direction = self._door.direction(self._angle)
        load = self._load.compensate(wrench, direction)
        left = max(DEMONSTRATED_ANGLE - self._angle, 0.0)
        self._speed = accelerated(
            self._speed, left, _ANGULAR_ACCELERATION, _ANGULAR_SPEED
        )
        step = float(load.pace) * self._speed * CONTROL_PERIOD * self._door.radius
        self._travelled = max(self._travelled + step, 0.0)

        self._fading *= JUMP_DECAY
        observed = self.observed_angle = float(self._door.angle(hand[:3]))
        return self._set_point.step(
            self._door.hand_poses(self._angle) + self._fading,
            load.compliant_wrench,
            phase=self._angle / DEMONSTRATED_ANGLE,
            observed_phase=np.clip(observed / DEMONSTRATED_ANGLE, 0.0, 1.0),
        )

    @property
    def _angle(self) -> float:
        """Angle of the set-point on the current circle [rad]."""
        return self._travelled / self._door.radius
