"""What an engineer who knows that it is a door would write, without demonstrations.

Where the hinge is, is estimated online from the hand's path
(`gplfd_policies.agents.model_based.circle`); the hand is pulled along the estimated
circle at a set pace, turns with the angle, and yields to every force but the door's
resistance along the way, so that a lasting radial force, which says that the circle is
wrong, moves the command.
"""

import math
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.circle import UPRIGHT, Circle
from gplfd_policies.agents.model_based.path import HandPath
from gplfd_policies.agents.model_based.yielding import Yielding
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation

_PACE: Final = 0.25
"""Angular speed of the opening [rad/s]."""
_ACCELERATION: Final = 0.125
"""With which it is reached and left [rad/s²]."""
_FADING: Final = 0.95
"""What is left after a period of a jump between two estimates."""


class HingeFitAgent:
    """Finds the hinge while it opens the door, and follows the circle about it.

    Attributes:
        observed_angle: How far the hand has come on the present circle [rad].
    """

    def __init__(self) -> None:
        self._path, self._yielding = HandPath(), Yielding()
        self._load = CarriedLoad()
        self._begin()

    def _begin(self) -> None:
        self._circle = Circle.expected(UPRIGHT)
        self._door = self._circle.door()
        # A length, no angle: another radius then moves the set-point sideways only.
        self._travelled = self._speed = 0.0
        self._fading = np.zeros(6)
        self.observed_angle = 0.0

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path.reset()
        self._yielding.reset()
        self._begin()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand = observation["ee_pose"]
        if self._path.add(hand[:3]):
            self._estimate()
        direction = self._door.direction(self._angle)
        wrench, pace = self._load.share(observation["wrench"], direction)
        self._advance(float(pace))
        self._fading *= _FADING
        observed = self.observed_angle = float(self._door.angle(hand[:3]))
        return self._yielding.step(
            self._door.hand_poses(self._angle) + self._fading,
            wrench,
            phase=self._angle / DEMONSTRATED_ANGLE,
            observed_phase=np.clip(observed / DEMONSTRATED_ANGLE, 0.0, 1.0),
        )

    @property
    def _angle(self) -> float:
        """Angle of the set-point on the present circle [rad]."""
        return self._travelled / self._door.radius

    def _estimate(self) -> None:
        """Estimate the circle anew; the command goes over to it without a jump."""
        before = self._door.hand_poses(self._angle)
        self._circle = self._circle.updated(self._path.points)
        self._door = self._circle.door()
        self._fading += before - self._door.hand_poses(self._angle)

    def _advance(self, pace: float) -> None:
        """Move the set-point on; it comes to rest where demonstrations end."""
        left = max(DEMONSTRATED_ANGLE - self._angle, 0.0)
        self._speed = min(
            self._speed + _ACCELERATION * CONTROL_PERIOD,
            math.sqrt(2.0 * _ACCELERATION * left),
            _PACE,
        )
        step = pace * self._speed * CONTROL_PERIOD * self._door.radius
        self._travelled = max(self._travelled + step, 0.0)
