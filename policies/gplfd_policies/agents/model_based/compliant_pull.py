"""A constant pull and a soft hand: what opens a door without knowing that it is one."""

from typing import Final

import numpy as np

from gplfd_policies.agents.model_based.yielding import Yielding
from gplfd_policies.control.steps import AgentStep, Observation

_PULL: Final = np.array([16.0, 0.0, 0.0, 0.0, 0.0, 0.0])
"""Force with which the set-point is drawn away from the door [N, N m]."""


class CompliantPullAgent:
    """Pulls straight back with a constant force and yields to everything else."""

    def __init__(self) -> None:
        self._yielding = Yielding()

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._yielding.reset()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        return self._yielding.step(np.zeros(6), observation["wrench"] + _PULL)
