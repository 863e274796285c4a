"""Opens an unknown door along the mechanism estimated from the hand's path.

As in `hinge_fit`, the hand yields to every force except the door's resistance along the
path; the mechanism is the most probable of those in `mechanism`.

The agent begins by pulling straight back. If the hand stays within two centimetres for
1.5 seconds, it tries the next direction: along the wall, into the wall, along the wall
the other way. If the mechanism is rotational, the motion ends at 67° from the closed
door, like the demonstrations. For other mechanisms the end is unknown: the set-point
moves on until the door stops, and waits at the greatest load that the load rule allows.
"""

import math
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies.agents.model_based.following import (
    JUMP_DECAY,
    CompliantSetPoint,
    HandPath,
    accelerated,
)
from gplfd_policies.agents.model_based.mechanism import (
    GaussianProcess,
    Mechanism,
    Prismatic,
    Rotational,
)
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import AgentStep, Observation, measured

_GUESSES: Final = np.array([[1, 0, 0], [0, 0, -1], [-1, 0, 0], [0, 0, 1]], float)
"""Directions to try, task frame."""
_PATIENCE, _PLAY = 1.5, 4
"""Time for each direction [s], and number of segments within which the hand counts as
not moving. Tuned."""
_LEAST_RADIUS: Final = 0.25
"""Least radius of a hinged leaf [m]: the end on a smaller circle is computed with
it."""
_SPEED: Final = 0.12
"""Speed of the set-point [m/s]. Tuned."""
_ACCELERATION: Final = 0.06
"""Acceleration and deceleration of the set-point [m/s²]. Tuned."""


class MechanismFitAgent:
    """Finds the mechanism while it opens the door, and follows it."""

    def __init__(self) -> None:
        self._load = CarriedLoad()
        self.reset({})

    def _begin(self, guess: int) -> None:
        """Try a direction from the closed door."""
        pull = _GUESSES[guess % len(_GUESSES)]
        self._guess, self._fading = guess, np.zeros(6)
        self._travelled = self._speed = self._tried = 0.0
        self._path = HandPath(6)
        self.model: Mechanism = Prismatic(pull, line=pull)
        sides = [side for side in (*np.eye(3), *-np.eye(3)) if side @ pull == 0.0]
        self._candidates: list[Mechanism] = [
            *(Mechanism(np.zeros(6)), self.model, GaussianProcess(np.zeros((1, 6)))),
            *(Rotational.expected(pull, side) for side in sides),
        ]

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed door."""
        self._set_point = CompliantSetPoint()
        self._begin(0)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        hand, wrench = measured(observation)
        if self._path.add(hand):
            path, before = self._path.points, self.model.poses(self._travelled)
            self._candidates = [model.updated(path) for model in self._candidates]
            best = min(self._candidates, key=lambda model: model.bic(path))
            if best.degrees > 0:
                self.model = best
                self._travelled = max(float(best.coordinates(before[:3])), 0.0)
                # The command changes to a new estimate without a jump.
                self._fading += before - best.poses(self._travelled)

        # If nothing moves, the set-point returns before the next direction.
        self._tried += CONTROL_PERIOD
        stuck = self._tried > _PATIENCE and len(self._path.points) <= _PLAY
        if stuck and self._travelled == 0.0:
            self._begin(self._guess + 1)

        direction = self.model.direction(self._travelled)
        load = self._load.compensate(wrench, direction)
        left = math.inf
        if isinstance(self.model, Rotational):
            end = DEMONSTRATED_ANGLE * max(self.model.radius, _LEAST_RADIUS)
            left = max(end - self._travelled, 0.0)
        self._speed = accelerated(self._speed, left, _ACCELERATION, _SPEED)
        step = self._speed * CONTROL_PERIOD * (-1.0 if stuck else float(load.pace))
        self._travelled = max(self._travelled + step, 0.0)
        self._fading *= JUMP_DECAY
        desired = self.model.poses(self._travelled) + self._fading
        return self._set_point.step(desired, load.compliant_wrench)
