"""Agents that act together: N episodes, one control step at a time.

A Gaussian-process agent spends most of a control step on NumPy's cost per call. Agents
of one composition that act in lockstep share it, and decide as they would alone.
"""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from typing import Protocol, SupportsIndex, runtime_checkable

import numpy as np

from policies.agent import Agent, GaussianProcessAgent
from policies.composition import Composition
from policies.members import members_of
from policies.steps import AgentSteps, Observation
from policies.trajectory import GaussianTrajectory

__all__ = ["AgentBatch", "batch_agents"]

Mask = np.ndarray
"""Boolean, (N,), which is checked."""


@runtime_checkable
class AgentBatch(Protocol):
    """N agents in lockstep, each with a door of its own."""

    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode at the closed, grasped door.

        Args:
            observations: One row per member of the batch, (N, ...).
            mask: Which members begin, (N,); None means all.
        """

    def act(self, observations: Observation, mask: Mask | None = None) -> AgentSteps:
        """Return the commands for the next control period.

        Args:
            observations: One row per member of the batch, (N, ...).
            mask: Which members act, (N,); None means all. The others' rows are not
                looked at, and nothing changes for them.
        """

    def forecast(self, member: SupportsIndex) -> GaussianTrajectory | None:
        """Return what one member now expects of the whole task, or None."""


def batch_agents(agents: Sequence[Agent]) -> AgentBatch:
    """Let agents act together.

    The batch takes the agents over: until they are reset, they do not act on their own
    any more.

    Args:
        agents: One per member, each an object of its own, as `make_agent` makes them.

    Returns:
        A batch that decides for all members at once if they are Gaussian-process agents
        of one composition, and asks one after the other if not.

    Raises:
        ValueError: If there is no agent, or one is given twice.
    """
    if not agents:
        raise ValueError("no agents were given; a batch needs at least one")
    if len({id(agent) for agent in agents}) < len(agents):
        raise ValueError(
            "an agent is given twice, but it can open only one door at a time; make "
            "one agent per member"
        )
    alike = [agent for agent in agents if isinstance(agent, GaussianProcessAgent)]
    if len(alike) < len(agents):
        return _OneByOne(agents)
    first = alike[0]
    if any(_composition(agent) != _composition(first) for agent in alike):
        return _OneByOne(agents)
    return _AllAtOnce(alike)


def _composition(agent: GaussianProcessAgent) -> tuple[object, ...]:
    """Everything that members of one batch share."""
    gains = [
        np.ravel(getattr(part, one.name)).tobytes()
        for part in (agent.profile, agent.dynamics)
        for one in dataclasses.fields(part)
    ]
    rule = type(agent.phases), agent.phases.settings
    return (agent.policy.n_grid, rule, agent.load, agent.config, *gains)


class _AllAtOnce:
    """Gaussian-process agents of one composition."""

    def __init__(self, agents: Sequence[GaussianProcessAgent]) -> None:
        first = agents[0]
        self._policies = [agent.policy for agent in agents]
        self._composition = Composition(
            self._policies,
            phases=first.phases.stacked([agent.phases for agent in agents]),
            load=first.load,
            profile=first.profile,
            dynamics=first.dynamics,
            config=first.config,
        )
        self._actions = np.full((len(agents), 6), np.nan)

    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode."""
        self._composition.reset(members_of(mask, len(self._policies)))

    def act(self, observations: Observation, mask: Mask | None = None) -> AgentSteps:
        """Return the commands for the next control period."""
        members = members_of(mask, len(self._policies))
        poses, wrenches = observations["ee_pose"], observations["wrench"]
        decided = self._composition.decide(poses[members], wrenches[members], members)
        steps = AgentSteps(**decided).among(members, self._actions)
        self._actions = steps.action
        return steps

    def forecast(self, member: SupportsIndex) -> GaussianTrajectory:
        """Return what one member now expects of the whole task."""
        return self._policies[member].trajectory()


class _OneByOne:
    """Any agents, asked one after the other."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._numbers = np.arange(len(agents))
        self._actions = np.full((len(agents), 6), np.nan)

    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let members begin an episode."""
        for member in self._numbers[members_of(mask, self._numbers.size)].tolist():
            self._agents[member].reset(_row(observations, member))

    def act(self, observations: Observation, mask: Mask | None = None) -> AgentSteps:
        """Return the commands for the next control period."""
        members = members_of(mask, self._numbers.size)
        steps = AgentSteps.of(
            [
                self._agents[member].act(_row(observations, member))
                for member in self._numbers[members].tolist()
            ]
        ).among(members, self._actions)
        self._actions = steps.action
        return steps

    def forecast(self, member: SupportsIndex) -> GaussianTrajectory | None:
        """Return what one member now expects of the whole task."""
        return self._agents[member].forecast()


def _row(observations: Observation, member: int) -> Observation:
    return {name: rows[member] for name, rows in observations.items()}
