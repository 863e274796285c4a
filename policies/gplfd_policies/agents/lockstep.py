"""Agents that act together: N episodes, one control step at a time.

A compliant agent spends most of a control step on NumPy's cost per call. Agents with
one configuration that act in lockstep share it, and decide as they would alone.
"""

import dataclasses
from collections.abc import Iterator, Sequence
from dataclasses import replace
from typing import Any, SupportsIndex

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.agents.agent import Agent, CompliantAgent, as_agent
from gplfd_policies.agents.handles import controller_of
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.arrays.rows import Rows, rows_of
from gplfd_policies.control.phase_stiffness import PhaseStiffness
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.control.stiffness import StiffnessProfile, VirtualDynamics
from gplfd_policies.movements.trajectory import GaussianTrajectory

Mask = np.ndarray
"""Boolean, (N,), which is checked."""


class AgentBatch:
    """N agents in lockstep, one per row with a door of its own, called one by one."""

    def __init__(self, agents: Sequence[Agent]) -> None:
        self._agents = tuple(agents)
        self._actions = np.full((len(agents), 6), np.nan)
        self.control: Control = agents[0].control

    @one_thread
    def inform(self, doors: Sequence[DoorGeometry]) -> None:
        """Give every agent the door of its next episode; only oracles use it."""
        for agent, door in zip(self._agents, doors, strict=True):
            agent.inform(door)

    @one_thread
    def reset(self, observations: Observation, mask: Mask | None = None) -> None:
        """Let agents of the mask (N,), or all, begin at the closed, grasped door."""
        self._reset(observations, rows_of(mask, len(self._agents)))

    @one_thread
    def act(self, observations: Observation, mask: Mask | None = None) -> AgentStep:
        """Return the next commands of the agents of the mask (N,), or of all.

        The others' rows of the observations (N, ...) are not read, and nothing changes
        for them.
        """
        rows = rows_of(mask, len(self._agents))
        steps = self._decide(observations, rows).among(rows, self._actions)
        self._actions = steps.action
        return steps

    @one_thread
    def forecast(self, row: SupportsIndex) -> GaussianTrajectory | None:
        """Return what one agent now expects of the whole task, or None."""
        return self._agents[row].forecast()

    def _reset(self, observations: Observation, rows: Rows) -> None:
        for agent, observation in self._each(observations, rows):
            agent.reset(observation)

    def _decide(self, observations: Observation, rows: Rows) -> AgentStep:
        """Return the steps of these rows alone."""
        return AgentStep.stacked(
            [
                agent.act(observation)
                for agent, observation in self._each(observations, rows)
            ]
        )

    def _each(
        self, observations: Observation, rows: Rows
    ) -> Iterator[tuple[Agent, Observation]]:
        for row in np.arange(len(self._agents))[rows].tolist():
            yield (
                self._agents[row],
                {name: values[row] for name, values in observations.items()},
            )


class _AllAtOnce(AgentBatch):
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
            first.handle_config,
            [agent.forces for agent in agents if agent.forces is not None] or None,
        )

    def _reset(self, observations: Observation, rows: Rows) -> None:
        self._controller.reset(rows)

    def _decide(self, observations: Observation, rows: Rows) -> AgentStep:
        poses, wrenches = observations["ee_pose"][rows], observations["wrench"][rows]
        return self._controller.decide(poses, wrenches, rows)


@one_thread
def batch_agents(agents: Sequence[object]) -> AgentBatch:
    """Let agents act together.

    The batch takes the agents over: until they are reset, they do not act on their own
    any more.

    Args:
        agents: One per row, each an object of its own, as `make_agent` makes them, or
            anything else that `gplfd_policies.agents.agent.as_agent` takes.

    Returns:
        A batch that computes all rows at once if they are `CompliantAgent`s with one
        configuration for one kind of handle, as those are that learned from the same
        demonstrations, and calls one agent after the other if not.

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
    if len(alike) == len(checked) and all(
        _shared(agent) == _shared(alike[0]) for agent in alike
    ):
        return _AllAtOnce(alike)
    return AgentBatch(checked)


def _shared(agent: CompliantAgent) -> tuple[object, ...]:
    """Return what the agents of one batch share; records of arrays as their bytes."""

    def comparable(part: object) -> object:
        if isinstance(part, StiffnessProfile):
            return part.k_max.tobytes(), part.k_min.tobytes()
        if isinstance(part, VirtualDynamics | PhaseStiffness):
            return [np.ravel(each).tobytes() for each in _values(part)]
        return part

    return (
        agent.movement.n_grid,
        type(agent.phases),
        agent.phases.settings,
        agent.handle is None,
        agent.forces is None,
        agent.handle_config,
        *map(comparable, _values(agent.config)),
    )


def _values(record: Any) -> list[Any]:
    return [getattr(record, one.name) for one in dataclasses.fields(record)]
