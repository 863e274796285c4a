"""Agents in lockstep: N episodes, one control step at a time.

A compliant agent spends most of a control step on NumPy's cost per call. Agents with
the same configuration in lockstep share this cost, and decide as each would alone.
"""

import dataclasses
from collections.abc import Sequence
from dataclasses import replace
from typing import Any, SupportsIndex

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.agents.agent import Agent, CompliantAgent, as_agent
from gplfd_policies.agents.handles import controller_of
from gplfd_policies.arrays.rows import Rows, rows_of
from gplfd_policies.control.phase_stiffness import PhaseStiffness
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics
from gplfd_policies.movements.movement import GaussianTrajectory

Mask = np.ndarray
"""Boolean mask, (N,); it is checked."""


class AgentBatch:
    """N agents in lockstep, one per row, each with its own door; called one by one."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._actions = np.full((len(agents), 6), np.nan)
        self.control: Control = agents[0].control

    def inform(self, doors: Sequence[DoorGeometry]) -> None:
        """Pass the door of the next episode to every agent; only oracles use it."""
        for agent, door in zip(self._agents, doors, strict=True):
            agent.inform(door)

    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Reset the agents of the mask (N,), or all, at the closed, grasped door."""
        self._reset(observations, rows_of(mask, len(self._agents)))

    def act(self, observations: Observation, mask: Mask | None = None) -> AgentStep:
        """Return the next commands of the agents of the mask (N,), or of all.

        Rows of the observations (N, ...) of the other agents are not read, and these
        agents do not change.
        """
        rows = rows_of(mask, len(self._agents))
        steps = self._decide(observations, rows).among(rows, self._actions)
        self._actions = steps.action
        return steps

    def forecast(self, row: SupportsIndex) -> GaussianTrajectory | None:
        """Return the trajectory that one agent currently expects, or None."""
        return self._agents[row].forecast()

    def _reset(self, observations: Observation, rows: Rows) -> None:
        for row in np.arange(len(self._agents))[rows].tolist():
            self._agents[row].reset(_of(observations, row))

    def _decide(self, observations: Observation, rows: Rows) -> AgentStep:
        """Return the steps of these rows only."""
        numbers = np.arange(len(self._agents))[rows].tolist()
        return AgentStep.stacked(
            [self._agents[row].act(_of(observations, row)) for row in numbers]
        )


def _of(observations: Observation, row: int) -> Observation:
    return {name: values[row] for name, values in observations.items()}


class _VectorisedBatch(AgentBatch):
    """Compliant agents with one configuration, computed together."""

    def __init__(self, agents: Sequence[CompliantAgent]) -> None:
        super().__init__(agents)
        first = agents[0]
        profiles = [agent.config.profile for agent in agents]
        self._controller = controller_of(
            [agent.movement for agent in agents],
            first.phases.stacked([agent.phases for agent in agents]),
            replace(first.config, profile=StiffnessProfile.stacked(profiles)),
            [agent.handle for agent in agents if agent.handle is not None],
            [agent.forces for agent in agents if agent.forces is not None] or None,
        )

    def _reset(self, observations: Observation, rows: Rows) -> None:
        self._controller.reset(rows)

    def _decide(self, observations: Observation, rows: Rows) -> AgentStep:
        poses, wrenches = observations["ee_pose"][rows], observations["wrench"][rows]
        return self._controller.decide(poses, wrenches, rows)


def batch_agents(agents: Sequence[object]) -> AgentBatch:
    """Combine agents into a batch.

    The batch takes over the agents: they must be reset before they can act alone again.

    Args:
        agents: One object per row, from `make_agent`, or any object that
            `gplfd_policies.agents.agent.as_agent` accepts.

    Returns:
        A batch that computes all rows together if they are `CompliantAgent`s with the
        same configuration and kind of handle (e.g. learned from the same
        demonstrations). Otherwise it calls one agent after the other.

    Raises:
        ValueError: If there is no agent, one is given twice, one cannot act, or only
            some of them command stiffness.
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
    shared = [_shared(agent) for agent in alike]
    if len(alike) == len(checked) and all(parts == shared[0] for parts in shared):
        return _VectorisedBatch(alike)
    return AgentBatch(checked)


def _shared(agent: CompliantAgent) -> tuple[object, ...]:
    """Return the part that the agents of a batch must share; arrays as bytes."""

    def comparable(part: object) -> object:
        if isinstance(part, StiffnessProfile):
            return part.k_max.tobytes(), part.k_min.tobytes()
        if isinstance(part, VirtualDynamics | PhaseStiffness):
            return [np.ravel(value).tobytes() for value in _values(part)]
        return part

    return (
        agent.movement.n_grid,
        type(agent.phases),
        agent.phases.settings,
        agent.handle is None,
        agent.forces is None,
        *map(comparable, _values(agent.config)),
    )


def _values(record: Any) -> list[Any]:
    return [getattr(record, field.name) for field in dataclasses.fields(record)]
