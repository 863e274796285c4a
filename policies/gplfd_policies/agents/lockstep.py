"""Agents that act together: N episodes, one control step at a time.

A compliant agent spends most of a control step on NumPy's cost per call. Agents with
one configuration that act in lockstep share it, and decide as they would alone.
"""

import dataclasses
from collections.abc import Sequence
from typing import Any, Protocol, SupportsIndex, runtime_checkable

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.agents.agent import Agent, CompliantAgent, as_agent
from gplfd_policies.arrays.members import members_of
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics
from gplfd_policies.handles.adapter import controller_of
from gplfd_policies.movements.trajectory import GaussianTrajectory

Mask = np.ndarray
"""Boolean, (N,), which is checked."""


@runtime_checkable
class AgentBatch(Protocol):
    """N agents in lockstep, each with a door of its own."""

    @property
    def control(self) -> Control:
        """What all of them command."""

    def inform(self, doors: Sequence[DoorGeometry]) -> None:
        """Tell every member the door of its next episode; for oracles, else ignored."""

    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode at the closed, grasped door.

        Args:
            observations: One row per member of the batch, (N, ...).
            mask: Which members begin, (N,); None means all.
        """

    def act(self, observations: Observation, mask: Mask | None = None) -> AgentStep:
        """Return the commands for the next control period.

        Args:
            observations: One row per member of the batch, (N, ...).
            mask: Which members act, (N,); None means all. The others' rows are not
                looked at, and nothing changes for them.
        """

    def forecast(self, member: SupportsIndex) -> GaussianTrajectory | None:
        """Return what one member now expects of the whole task, or None."""


@one_thread
def batch_agents(agents: Sequence[object]) -> AgentBatch:
    """Let agents act together.

    The batch takes the agents over: until they are reset, they do not act on their own
    any more.

    Args:
        agents: One per member, each an object of its own, as `make_agent` makes them,
            or anything else that `gplfd_policies.agents.agent.as_agent` takes.

    Returns:
        A batch that decides for all members at once if they are `CompliantAgent`s with
        one configuration, as those are that learned from the same demonstrations, and
        asks one after the other if not.

    Raises:
        ValueError: If there is no agent, one is given twice, one cannot act, or some
            command poses and others stiffness, too.
    """
    if not agents:
        raise ValueError("no agents were given; a batch needs at least one")
    if len({id(agent) for agent in agents}) < len(agents):
        raise ValueError(
            "an agent is given twice, but it can open only one door at a time; make "
            "one agent per member"
        )
    checked = [as_agent(agent) for agent in agents]
    if len({agent.control for agent in checked}) > 1:
        raise ValueError(
            "agents of one batch act in one environment, but some command poses and "
            "others pose and stiffness (their attribute control); make a batch of each"
        )
    alike = [agent for agent in checked if isinstance(agent, CompliantAgent)]
    if len(alike) < len(checked):
        return _OneByOne(checked)
    if any(_shared(agent) != _shared(alike[0]) for agent in alike):
        return _OneByOne(checked)
    return _AllAtOnce(alike)


def _shared(agent: CompliantAgent) -> tuple[object, ...]:
    """Everything that members of one batch share; records of arrays as their bytes."""

    def comparable(part: object) -> object:
        if isinstance(part, StiffnessProfile | VirtualDynamics):
            return [np.ravel(each).tobytes() for each in _values(part)]
        return part

    rule = type(agent.phases), agent.phases.settings
    return (agent.movement.n_grid, rule, *map(comparable, _values(agent.config)))


def _values(record: Any) -> list[Any]:
    return [getattr(record, one.name) for one in dataclasses.fields(record)]


class _AllAtOnce:
    """Compliant agents with one configuration."""

    def __init__(self, agents: Sequence[CompliantAgent]) -> None:
        self._movements = [agent.movement for agent in agents]
        rule = agents[0].phases.stacked([agent.phases for agent in agents])
        self._controller = controller_of(self._movements, rule, agents[0].config)
        self._actions = np.full((len(agents), 6), np.nan)
        self.control: Control = agents[0].control

    def inform(self, doors: Sequence[DoorGeometry]) -> None:
        """Ignore them, as each agent does."""

    @one_thread
    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode."""
        self._controller.reset(members_of(mask, len(self._movements)))

    @one_thread
    def act(self, observations: Observation, mask: Mask | None = None) -> AgentStep:
        """Return the commands for the next control period."""
        members = members_of(mask, len(self._movements))
        poses, wrenches = observations["ee_pose"], observations["wrench"]
        steps = self._controller.decide(
            poses[members], wrenches[members], members
        ).among(members, self._actions)
        self._actions = steps.action
        return steps

    @one_thread
    def forecast(self, member: SupportsIndex) -> GaussianTrajectory:
        """Return what one member now expects of the whole task."""
        return self._movements[member].trajectory()


class _OneByOne:
    """Any agents, asked one after the other."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._numbers = np.arange(len(agents))
        self._actions = np.full((len(agents), 6), np.nan)
        self.control: Control = agents[0].control

    @one_thread
    def inform(self, doors: Sequence[DoorGeometry]) -> None:
        """Tell every member the door of its next episode."""
        for agent, door in zip(self._agents, doors, strict=True):
            agent.inform(door)

    @one_thread
    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode."""
        for member in self._numbers[members_of(mask, self._numbers.size)].tolist():
            self._agents[member].reset(_row(observations, member))

    @one_thread
    def act(self, observations: Observation, mask: Mask | None = None) -> AgentStep:
        """Return the commands for the next control period."""
        members = members_of(mask, self._numbers.size)
        steps = AgentStep.stacked(
            [
                self._agents[member].act(_row(observations, member))
                for member in self._numbers[members].tolist()
            ]
        ).among(members, self._actions)
        self._actions = steps.action
        return steps

    @one_thread
    def forecast(self, member: SupportsIndex) -> GaussianTrajectory | None:
        """Return what one member now expects of the whole task."""
        return self._agents[member].forecast()


def _row(observations: Observation, member: int) -> Observation:
    return {name: rows[member] for name, rows in observations.items()}
