"""Reaching for a handle as it was demonstrated, then opening with another agent.

The reach is a movement like any other: six heteroscedastic Gaussian processes, learned
from demonstrations that begin at many places and end at the handle. Where a hand begins
is a via-point at its first phase, and the handle one at its last.
"""

from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH, Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.adaptation import adapt
from gplfd_policies.agents.agent import Agent
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.control.rendering import ArmRendering
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint

CLOSING: Final = 0.9
"""How long the gripper takes to close with all its force [s], for which the hand waits
at the handle."""

_GRID: Final = np.linspace(0.0, 1.0, 100)
_STIFFEST: Final = np.repeat([most for _, most in ArmRendering.stiffness_range], 3)


def parted(
    demonstration: Demonstration, grasped: Bool[np.ndarray, " N"]
) -> tuple[Demonstration, Demonstration]:
    """Part a demonstration at the sample where its hand takes hold, which both have."""
    first = int(np.argmax(grasped))
    if first == 0 or first >= len(grasped) - 1 or not grasped[first:].all():
        raise ValueError(
            "a demonstration that is to teach reaching must begin without the handle, "
            "take hold of it and keep it to the end"
        )
    times, poses = demonstration.times, demonstration.poses
    reach = Demonstration(times=times[: first + 1], poses=poses[: first + 1])
    wrenches = demonstration.wrenches
    return reach, Demonstration(
        times=times[first:],
        poses=poses[first:],
        wrenches=None if wrenches is None else wrenches[first:],
    )


def joined(reach: Demonstration, opening: Demonstration) -> Demonstration:
    """Return the demonstration of which `parted` makes these two.

    If the opening has wrenches, those of the reach are zero: the hand holds nothing.
    """
    wrenches = opening.wrenches
    if wrenches is not None:
        wrenches = np.concatenate([np.zeros((len(reach.times) - 1, 6)), wrenches])
    return Demonstration(
        times=np.concatenate([reach.times, opening.times[1:]]),
        poses=np.concatenate([reach.poses, opening.poses[1:]]),
        wrenches=wrenches,
    )


@one_thread
def learn_reach(reaches: Sequence[Demonstration]) -> Movement:
    """Learn to reach from two demonstrations or more that end at the handle."""
    # The rest at the end is a part of the task: the hand closes.
    return fit_skill(align(reaches, trim_rests=False))


class ReachingAgent:
    """Reaches for the handle, waits until the gripper closed, and lets another act."""

    @one_thread
    def __init__(self, reach: Movement, then: Agent) -> None:
        self._reach, self._then = reach, then
        self._path = self._from(np.zeros(6))
        self._elapsed = 0.0

    @property
    def control(self) -> Control:
        """What it commands: the same as the agent that opens the door."""
        return self._then.control

    def inform(self, door: DoorGeometry) -> None:
        """Pass on the door of the next episode."""
        self._then.inform(door)

    @one_thread
    def reset(self, observation: Observation) -> None:
        """Begin where the hand is."""
        self._path = self._from(observation["ee_pose"])
        self._elapsed = 0.0

    @one_thread
    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        before, whole = self._elapsed, self._reach.duration + CLOSING
        self._elapsed += CONTROL_PERIOD
        if before >= whole:
            if before - CONTROL_PERIOD < whole:
                self._then.reset(observation)
            return self._then.act(observation)
        phase = min(self._elapsed / self._reach.duration, 1.0)
        mean, std = (
            np.array([np.interp(phase, _GRID, each) for each in values.T])
            for values in (self._path.mean, self._path.std)
        )
        stiffness = _STIFFEST if self.control == "impedance" else np.full(6, np.nan)
        return AgentStep(action=mean, desired=mean, std=std, stiffness=stiffness)

    @property
    def gripper_width(self) -> float:
        """What goes with the last pose [m]: wide open to the handle, then closed."""
        return GRIPPER_WIDTH if self._elapsed < self._reach.duration else 0.0

    def forecast(self) -> GaussianTrajectory | None:
        """Return what is expected of the opening, or None."""
        return self._then.forecast()

    def _from(self, start: Float[np.ndarray, " 6"]) -> GaussianTrajectory:
        """Return the reach from a pose to the handle."""
        ends = ViaPoint(phase=0.0, pose=start), ViaPoint(phase=1.0, pose=np.zeros(6))
        return adapt(self._reach, ends, "process").predict(_GRID)
