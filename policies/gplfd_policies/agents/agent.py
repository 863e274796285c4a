"""The agent interface, an adapter for agents of users, and the compliant agent.

The compliant agent follows Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, by `gplfd_policies.control.compliance`.
"""

import contextlib
import textwrap
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from typing import Any, Final, Protocol, SupportsIndex, get_args, runtime_checkable

import numpy as np

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.validation.fields import real_array
from gplfd_policies.adaptation.gridded import GriddedMovement, GriddedMovements
from gplfd_policies.agents.handles import HandleLoad, HandleMovements
from gplfd_policies.arrays.rows import Rows, rows_of
from gplfd_policies.control.compliance import ComplianceConfig, ComplianceController
from gplfd_policies.control.load import ForceForecast
from gplfd_policies.control.steps import AgentStep, Observation, measured
from gplfd_policies.control.stiffness import (
    PhaseStiffness,
    StiffnessProfile,
    VirtualDynamics,
)
from gplfd_policies.demonstrations.turned_handle import TurnedHandle, turned_handle
from gplfd_policies.movements.movement import GaussianTrajectory
from gplfd_policies.phase.phase_rule import PhaseRule


@runtime_checkable
class Agent(Protocol):
    """Acts in one episode; `as_agent` makes an agent from any object with ``act``."""

    @property
    def control(self) -> Control:
        """Kind of command, and thus of environment: poses, or poses and stiffness."""

    @property
    def dynamics(self) -> VirtualDynamics | None:
        """Mass and damping at the commanded stiffness; None if unknown."""

    def inform(self, door: DoorGeometry) -> None:
        """Receive the door of the next episode; only an oracle uses it."""

    def reset(self, observation: Observation) -> None:
        """Begin an episode at the closed, grasped door."""

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""

    def forecast(self) -> GaussianTrajectory | None:
        """Return the currently expected trajectory of the whole task, or None."""


def as_agent(candidate: object) -> Agent:
    """Make an agent from an object that can act.

    Args:
        candidate: Object with ``act(observation)``, which returns the commanded pose
            (6,) [m, rad] or an `AgentStep`; ``inform(door)``, ``reset(observation)``
            and ``forecast()`` are called if they exist. With an attribute ``control =
            "impedance"`` it returns (12,) [m, rad, N/m, N m/rad], or a step with both.

    Returns:
        An agent that checks the values that the object returns in each step.

    Raises:
        ValueError: If the object cannot act, or its ``control`` is unknown.
    """
    if type(candidate) in (*BATCHES, CheckedAgent) and isinstance(candidate, Agent):
        return candidate
    if isinstance(candidate, type) or not callable(getattr(candidate, "act", None)):
        raise ValueError(
            f"{candidate!r} is not an agent: an agent is an object with a method "
            "act(observation) that returns the commanded pose, six numbers [m, rad]"
        )
    return CheckedAgent(candidate)


class CheckedAgent:
    """Adapter for a user's agent: adds missing methods and checks returned values."""

    def __init__(self, candidate: Any) -> None:
        self._candidate, self._step = candidate, 0
        control: Any = getattr(candidate, "control", "pose")
        if control not in get_args(Control):
            raise ValueError(
                f"{type(candidate).__name__}.control is {control!r}; it must be "
                "'pose', or 'impedance' for an agent that also commands stiffness"
            )
        self.control: Control = control
        self.dynamics: VirtualDynamics | None = getattr(candidate, "dynamics", None)

    def inform(self, door: DoorGeometry) -> None:
        """Pass on the door of the next episode."""
        if hasattr(self._candidate, "inform"):
            self._candidate.inform(door)

    def reset(self, observation: Observation) -> None:
        """Begin an episode."""
        self._step = 0
        if hasattr(self._candidate, "reset"):
            self._candidate.reset(_copied(observation))

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""
        self._step += 1
        answer = step = self._candidate.act(_copied(observation))
        if not isinstance(answer, AgentStep):
            with contextlib.suppress(TypeError, ValueError, OverflowError):
                numbers = real_array(answer)
                if self.control == "pose" and numbers.shape == (6,):
                    step = AgentStep(action=numbers)
                elif self.control == "impedance" and numbers.shape == (12,):
                    step = AgentStep(action=numbers[:6], stiffness=numbers[6:])
        if (
            isinstance(step, AgentStep)
            and step.action.shape == (6,)
            and np.isfinite(step.command(self.control)).all()
        ):
            return step
        raise ValueError(
            f"{type(self._candidate).__name__}.act returned "
            f"{textwrap.shorten(repr(answer), 100, placeholder=' ...')} at step "
            f"{self._step} of an episode; it must return {_WANTED[self.control]}"
        )

    def forecast(self) -> GaussianTrajectory | None:
        """Return the currently expected trajectory of the whole task, or None."""
        if not hasattr(self._candidate, "forecast"):
            return None
        forecast = self._candidate.forecast()
        if forecast is None or isinstance(forecast, GaussianTrajectory):
            return forecast
        raise ValueError(
            f"{type(self._candidate).__name__}.forecast returned {type(forecast)}; it "
            "must return a gplfd_policies.GaussianTrajectory, or None"
        )


def _copied(observation: Observation) -> Observation:
    """Return what an agent may change in place: logs and other agents keep theirs."""
    return {name: np.copy(values) for name, values in observation.items()}


_WANTED: Final = {
    "pose": "the commanded pose, six finite numbers (x, y, z, θu_x, θu_y, θu_z) "
    "[m, rad], or an AgentStep with such an action; to command the arm's stiffness, "
    "too, give the agent an attribute control = 'impedance'",
    "impedance": "the commanded pose and stiffness, twelve finite numbers (six [m, "
    "rad], then six [N/m, N m/rad] on the same axes), or an AgentStep with both",
}


def _controller_of(
    movements: GriddedMovement | Sequence[GriddedMovement],
    phases: PhaseRule,
    config: ComplianceConfig,
    handles: Sequence[TurnedHandle],
    forces: GriddedMovement | Sequence[GriddedMovement] | None = None,
) -> ComplianceController:
    """Return the controller of one hand or many, for turning handles or without any."""
    forecast = None
    if forces is not None:
        forecast = ForceForecast(GriddedMovements(forces), config.force_std)
    if not handles:
        paths = GriddedMovements(movements)
        load = config.load.begin(config.profile, paths.numbers.shape)
        return ComplianceController(paths, phases, load, config, forecast)
    turning = HandleMovements(movements, handles)
    borne = HandleLoad(config, turning)
    return ComplianceController(turning, phases, borne, config, forecast)


@dataclass(frozen=True, slots=True)
class CompliantAgent:
    """Follows a learned movement with variable-stiffness admittance control.

    Attributes:
        movement: The movement on a grid of phases, adapted in place.
        phases: Estimates the phase of an observed pose.
        config: Stiffness, load, timing and via-points.
        forces: The movement of the demonstrated forces, adapted in place, or None.
        handle: The handle that the demonstrations turn; None for a bar.
    """

    movement: GriddedMovement
    phases: PhaseRule
    config: ComplianceConfig = field(default_factory=ComplianceConfig)
    forces: GriddedMovement | None = None
    handle: TurnedHandle | None = field(init=False, repr=False, compare=False)
    _controller: ComplianceController = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        handle = turned_handle(self.movement.learned.aligned)
        handles = [] if handle is None else [handle]
        controller = _controller_of(
            self.movement, self.phases, self.config, handles, self.forces
        )
        object.__setattr__(self, "handle", handle)
        object.__setattr__(self, "_controller", controller)

    @property
    def control(self) -> Control:
        """Kind of command, by where the stiffness is realised."""
        return self.config.rendering.control

    @property
    def dynamics(self) -> VirtualDynamics:
        """Mass and damping at the commanded stiffness."""
        return self.config.dynamics

    def inform(self, door: DoorGeometry) -> None:
        """Ignore the door: the agent uses only what it learns and observes."""

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed door."""
        self._controller.reset()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command from ``ee_pose`` [m, rad] and ``wrench`` [N, N m]."""
        return self._controller.decide(*measured(observation))

    def forecast(self) -> GaussianTrajectory:
        """Return the current movement over the whole task."""
        return self.movement.trajectory()


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

    def reset(self, observations: Observation, mask: np.ndarray | None = None) -> None:
        """Reset the agents of the mask (N,), or all, at the closed, grasped door."""
        self._reset(observations, rows_of(mask, len(self._agents)))

    def act(
        self, observations: Observation, mask: np.ndarray | None = None
    ) -> AgentStep:
        """Return the next commands of the agents of the mask (N,), or of all."""
        rows = rows_of(mask, len(self._agents))
        steps = self.decide(observations, rows).among(rows, self._actions)
        self._actions = steps.action
        return steps

    def forecast(self, row: SupportsIndex) -> GaussianTrajectory | None:
        """Return the trajectory that one agent currently expects, or None."""
        return self._agents[row].forecast()

    def _reset(self, observations: Observation, rows: Rows) -> None:
        for row in np.arange(len(self._agents))[rows].tolist():
            self._agents[row].reset(row_of(observations, row))

    def decide(self, observations: Observation, rows: Rows) -> AgentStep:
        """Return the next steps of these rows only, given the observations of all."""
        numbers = np.arange(len(self._agents))[rows].tolist()
        return AgentStep.stacked(
            [self._agents[row].act(row_of(observations, row)) for row in numbers]
        )


def row_of(observations: Observation, row: int) -> Observation:
    """Return the observation of one of N agents."""
    return {name: values[row] for name, values in observations.items()}


class _VectorisedBatch(AgentBatch):
    """Compliant agents with one configuration, computed together, each as if alone."""

    def __init__(self, agents: Sequence[CompliantAgent]) -> None:
        super().__init__(agents)
        first = agents[0]
        profiles = [agent.config.profile for agent in agents]
        self._controller = _controller_of(
            [agent.movement for agent in agents],
            first.phases.stacked([agent.phases for agent in agents]),
            replace(first.config, profile=StiffnessProfile.stacked(profiles)),
            [agent.handle for agent in agents if agent.handle is not None],
            [agent.forces for agent in agents if agent.forces is not None] or None,
        )

    def _reset(self, observations: Observation, rows: Rows) -> None:
        self._controller.reset(rows)

    def decide(self, observations: Observation, rows: Rows) -> AgentStep:
        """See `AgentBatch.decide`."""
        poses, wrenches = observations["ee_pose"][rows], observations["wrench"][rows]
        return self._controller.decide(poses, wrenches, rows)


BATCHES: Final[dict[type, Callable[..., AgentBatch]]] = {}
"""What computes agents of a class together, by the class."""
BATCHES[CompliantAgent] = _VectorisedBatch


def batch_agents(agents: Sequence[object]) -> AgentBatch:
    """Combine agents into a batch, which takes them over.

    Args:
        agents: One object per row, from `make_agent`, or any object that
            `gplfd_policies.agents.agent.as_agent` accepts.

    Returns:
        A batch that computes all rows together if they are `CompliantAgent`s with the
        same configuration and kind of handle, or modes of such; else one by one.

    Raises:
        ValueError: No agent, one twice, one that cannot act, or controls that differ.
    """
    if not agents:
        raise ValueError("no agents were given; a batch needs at least one")
    if len({id(agent) for agent in agents}) < len(agents):
        raise ValueError("an agent is given twice; make one agent per member")
    checked = [as_agent(agent) for agent in agents]
    if len({agent.control for agent in checked}) > 1:
        raise ValueError(
            "agents of one batch act in one environment, but some command poses and "
            "others pose and stiffness (their attribute control); make a batch of each"
        )
    first, *others = map(shared_in_batch, agents)
    if first is None or any(parts != first for parts in others):
        return AgentBatch(checked)
    return BATCHES[type(agents[0])](agents)


def shared_in_batch(agent: object) -> tuple[object, ...] | None:
    """Return what agents that are computed together must share; arrays as bytes.

    None for an agent that is called alone.
    """
    if not isinstance(agent, CompliantAgent):
        exact = type(agent) in BATCHES  # A subclass may act differently.
        return getattr(agent, "shared_in_batch", None) if exact else None

    def values(record: Any) -> list[Any]:
        return [getattr(record, entry.name) for entry in fields(record)]

    def comparable(part: object) -> object:
        if isinstance(part, StiffnessProfile):
            return part.k_max.tobytes(), part.k_min.tobytes()
        if isinstance(part, VirtualDynamics | PhaseStiffness):
            return [np.ravel(value).tobytes() for value in values(part)]
        return part

    return (
        agent.movement.n_grid,
        type(agent.phases),
        agent.phases.settings,
        agent.handle is None,
        agent.forces is None,
        *map(comparable, values(agent.config)),
    )
