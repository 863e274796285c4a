"""The simplest agents that open doors: they pull towards where the hand just went.

A handle moves along the tangent of its circle, and the last few centimetres of its way
are nearly that; one look back is all that they know of doors.
"""

from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.path import HandPath, turned_towards
from gplfd_policies.agents.model_based.yielding import Yielding
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation

_SPEED: Final = 0.12
"""Of the reflex's set-point [m/s]."""
_LEAD: Final = 0.015
"""How far the chord's set-point is ahead of the hand [m]: 30 N of the robot's servo."""
_LEAD_RATE: Final = 0.015
"""How fast it gets there [m/s]."""


class ChordAgent:
    """Commands a point ahead of the hand, in the direction of its last displacement."""

    def __init__(self) -> None:
        self._path = HandPath()
        self._lead = 0.0
        self._action = np.zeros(6)

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path.reset()
        self._lead, self._action = 0.0, np.zeros(6)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand = observation["ee_pose"][:3]
        self._path.add(hand)
        direction = self._path.direction()
        turn = turned_towards(direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            self._lead = min(self._lead + _LEAD_RATE * CONTROL_PERIOD, _LEAD)
            self._action = np.concatenate([hand + self._lead * direction, turn])
        return AgentStep(action=self._action)


class ReflexAgent:
    """Moves on in the direction of the last displacement; yields to what is across."""

    def __init__(self) -> None:
        self._path, self._yielding = HandPath(), Yielding()
        self._load = CarriedLoad()
        self._position = np.zeros(3)

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path.reset()
        self._yielding.reset()
        self._position = np.zeros(3)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        self._path.add(observation["ee_pose"][:3])
        direction = self._path.direction()
        turn = turned_towards(direction)
        wrench, pace = self._load.share(observation["wrench"], direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            self._position += _SPEED * CONTROL_PERIOD * pace * direction
        return self._yielding.step(np.concatenate([self._position, turn]), wrench)
