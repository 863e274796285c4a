"""What it is worth to know how far a handle has to be turned, and nothing else.

The circle fit of `gplfd_policies.agents.model_based.hinge_fit`, after the handle has
been turned by as much as it was told, about the axis that it was told. While the handle
is turned by θ, the leaf's own motion is seen and commanded through the handle's known
displacement: of poses as rigid motions, hand = leaf ∘ handle(θ).
"""

import math
from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.agents.model_based.hinge_fit import HingeFitAgent
from gplfd_policies.control.steps import AgentStep, Observation

Pose = Float[np.ndarray, " 6"]

_TURNING: Final = 1.0
"""Time in which the handle is turned [s]."""

_LET_BACK: Final = (math.radians(8.0), math.radians(25.0))
"""Opening angles between which it is let go back [rad]."""


class ToldHandleAgent:
    """Turns the handle as it was told, then opens the door by a circle fit."""

    def __init__(self) -> None:
        self._door: DoorGeometry | None = None
        self._opener = HingeFitAgent()
        self._turned = 0.0

    def inform(self, door: DoorGeometry) -> None:
        """Take in how the handle turns, and how far; not where the hinge is."""
        self._door = door

    def reset(self, observation: Observation) -> None:
        """Begin at the closed door."""
        self._turned = 0.0
        self._opener.reset(observation)

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period.

        Raises:
            ValueError: It was not told the handle.
        """
        if self._door is None:
            raise ValueError(
                "hinge-fit-told must be told the handle before the episode: "
                "agent.inform(door), with a gplfd_env.DoorGeometry such as "
                "env.unwrapped.door_geometry"
            )
        if self._door.travel > 0.0 and self._turned < 1.0:
            self._turned = min(1.0, self._turned + CONTROL_PERIOD / _TURNING)
            pose = self._handle(_minimum_jerk(self._turned))
            return AgentStep(action=pose, desired=pose, phase=0.0, observed_phase=0.0)
        angle = self._opener.observed_angle
        begins, ends = _LET_BACK
        handle = self._handle(1.0 - _minimum_jerk((angle - begins) / (ends - begins)))
        leaf = _composed(observation["ee_pose"], _inverse(handle))
        step = self._opener.act({**observation, "ee_pose": leaf})
        return replace(
            step,
            action=_composed(step.action, handle),
            desired=_composed(step.desired, handle),
        )

    def _handle(self, share: float) -> Pose:
        """Return the hand's pose at the closed door, the handle turned by a share."""
        assert self._door is not None
        return self._door.hand_poses(0.0, share * self._door.travel)


def _composed(first: Pose, second: Pose) -> Pose:
    """Return first ∘ second."""
    # Copies: SciPy refuses what is read-only.
    turn = Rotation.from_rotvec(first[3:].copy())
    rotation = (turn * Rotation.from_rotvec(second[3:].copy())).as_rotvec()
    return np.concatenate([first[:3] + turn.apply(second[:3]), rotation])


def _inverse(pose: Pose) -> Pose:
    back = Rotation.from_rotvec(-pose[3:])
    return np.concatenate([-back.apply(pose[:3]), -pose[3:]])


def _minimum_jerk(progress: float) -> float:
    s = min(max(progress, 0.0), 1.0)
    return s**3 * (10.0 - 15.0 * s + 6.0 * s**2)
