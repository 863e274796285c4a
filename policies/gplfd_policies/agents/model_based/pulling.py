"""The simplest agents: they pull back, or in the direction of the last displacement.

The last few centimetres of a handle's path are nearly tangent to its circle.
"""

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.following import (
    HandPath,
    Yielding,
    turned_towards,
)
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation, measured


class CompliantPullAgent:
    """Pulls straight back with a constant force and yields to everything else.

    Args:
        force: Force that pulls the set-point away from the door [N]. Tuned.
    """

    def __init__(self, *, force: float = 16.0) -> None:
        self._pull = np.array([force, 0.0, 0.0, 0.0, 0.0, 0.0])
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._yielding = Yielding()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        _, wrench = measured(observation)
        return self._yielding.step(np.zeros(6), wrench + self._pull)


class ChordAgent:
    """Commands a point ahead of the hand, in the direction of its last displacement.

    Args:
        lead: Distance of the set-point ahead of the hand [m]: 30 N of the robot's
            servo.
        lead_rate: Rate at which the lead grows at first [m/s]. Tuned.
    """

    def __init__(self, *, lead: float = 0.015, lead_rate: float = 0.015) -> None:
        self._greatest_lead, self._lead_rate = lead, lead_rate
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
            farther = self._lead + self._lead_rate * CONTROL_PERIOD
            self._lead = min(farther, self._greatest_lead)
            self._action = np.concatenate([hand + self._lead * direction, turn])
        return AgentStep(action=self._action)


class ReflexAgent:
    """Moves in the direction of the last displacement; yields to forces across it.

    Args:
        speed: Speed of the set-point [m/s]. Tuned.
    """

    def __init__(self, *, speed: float = 0.12) -> None:
        self._speed = speed
        self._load = CarriedLoad()
        self.reset({})

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._path, self._yielding = HandPath(), Yielding()
        self._position = np.zeros(3)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        self._path.add(hand[:3])
        direction = self._path.direction()
        turn = turned_towards(direction)
        load = self._load.compensate(wrench, direction)
        if np.linalg.norm(turn) < DEMONSTRATED_ANGLE:
            self._position += self._speed * CONTROL_PERIOD * load.pace * direction
        desired = np.concatenate([self._position, turn])
        return self._yielding.step(desired, load.compliant_wrench)
