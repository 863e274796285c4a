"""The simplest agents: they pull back, or in the direction of the last displacement.

The last few centimetres of a handle's path are nearly tangent to its circle.
"""

from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.following import (
    CompliantSetPoint,
    HandPath,
    turned_towards,
)
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation, measured

_PULL: Final = np.array([16.0, 0.0, 0.0, 0.0, 0.0, 0.0])
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
        return self._set_point.step(np.zeros(6), wrench + _PULL)


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
