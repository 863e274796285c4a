"""Common parts of agents that find the path during the motion: path and compliance.

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
from gplfd_policies.arrays.shapes import Float, SixAxes
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.steps import AgentStep
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
