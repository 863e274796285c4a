"""Opens a door by a circle fit: an engineered model without demonstrations.

The hand moves along the circle estimated from its path so far and turns with the angle.
It yields to every force except the door's resistance along the path: a lasting radial
force, which shows that the circle is wrong, displaces the command.
"""

from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.circle import UPRIGHT, Circle
from gplfd_policies.agents.model_based.following import (
    JUMP_DECAY,
    CompliantSetPoint,
    HandPath,
    accelerated,
)
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation, measured

_SPEED: Final = 0.25
"""Angular speed of the opening [rad/s]. Tuned."""
_ACCELERATION: Final = 0.125
"""Angular acceleration and deceleration [rad/s²]. Tuned."""


class HingeFitAgent:
    """Finds the hinge while it opens the door, and follows the circle about it."""

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
        self._speed = accelerated(self._speed, left, _ACCELERATION, _SPEED)
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
