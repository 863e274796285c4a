"""Compliance control: movement, adaptation, stiffness and admittance, step by step.

Implements Section IV-B of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979: the door's motion, observed while opening it, adapts
the movement; its uncertainty sets the stiffness; the virtual dynamics move the
set-point of a position-controlled arm.

Written once for one hand and for many: arrays of many have a leading axis of members,
each with a door of its own, which share the cost of NumPy's calls. What a member does
depends on no other, to the last bit: arithmetic is element by element, a sum over a
direction is taken by NumPy in one order wherever it lies, and matrices (of one member's
policy) have the same shape in company as alone. Products that NumPy leaves to BLAS, as
``vecdot``, are not used across members: some kernels add in an order that depends on
where in memory a row begins.
"""

import math
from dataclasses import dataclass, field
from typing import Final

import numpy as np
from jaxtyping import Bool, Float

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_policies.adaptation.gridded import LOOK_AHEAD, GriddedMovements, look_ahead
from gplfd_policies.arrays.members import EVERY_MEMBER, Members, Numbers
from gplfd_policies.control.load import Encounter, LearnedLoad, Load, LoadRule
from gplfd_policies.control.rendering import Rendering, VirtualRendering
from gplfd_policies.control.stability import GovernedStiffness, StiffnessGovernor
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    StiffnessProfile,
    VirtualDynamics,
)
from gplfd_policies.movements.trajectory import ViaPoint
from gplfd_policies.phase.phase_rule import POSE_ERROR, PhaseObserver

Poses = Float[np.ndarray, "*N 6"]
Phases = Float[Numbers, "*N"]
Due = Bool[np.ndarray | np.bool_, "*N"]

_LOST: Final = 0.1
"""A phase that falls by more had been found in the wrong place."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ComplianceConfig:
    """How an agent moves through the task, yields, and takes via-points."""

    load: LoadRule = field(default_factory=LearnedLoad)
    """What is done about the door's resistance."""

    profile: StiffnessProfile = DEFAULT_PROFILE
    """Stiffness as a function of uncertainty, Eq. (24)."""

    dynamics: VirtualDynamics = DEFAULT_DYNAMICS
    """Mass and damping ratio of what the stiffness is rendered with, Eq. (22)."""

    rendering: Rendering = field(default_factory=VirtualRendering)
    """What renders it: virtual dynamics, or the arm itself."""

    control_period: float = CONTROL_PERIOD
    """Time between two commands [s]."""

    via_spacing: float = 0.01
    """Progress between two via-points, in phase."""

    via_std: tuple[float, float] = POSE_ERROR
    """Noise of an observed via-point: position [m], rotation [rad]."""

    max_turn_lead: float = 0.05
    """How far the set-point's rotation may run ahead of the hand, in phase. It turns
    with the handle: turning first would only twist the hand on the bar."""

    def __post_init__(self) -> None:
        for name in ("control_period", "via_spacing", "max_turn_lead"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(
                    f"ComplianceConfig.{name} must be positive and finite, got {value}"
                )
        if not isinstance(self.load, LoadRule):
            raise ValueError(
                "ComplianceConfig.load must be a load rule, with begin(profile, shape) "
                f"(gplfd_policies.control.load.LoadRule), got {self.load!r}"
            )
        lowest, highest = np.repeat(self.rendering.stiffness_range, 3, axis=0).T
        asked = self.profile
        if np.any(asked.k_min < lowest) or np.any(asked.k_max > highest):
            raise ValueError(
                f"ComplianceConfig.profile asks for {asked.k_min} to {asked.k_max} "
                "[N/m, N m/rad], but its rendering can do from "
                f"{lowest} to {highest}; choose another profile, or VirtualRendering"
            )
        if len(self.via_std) != 2 or not all(0.0 <= s < math.inf for s in self.via_std):
            raise ValueError(
                "ComplianceConfig.via_std must be two finite numbers >= 0, position "
                f"[m] and rotation [rad], got {self.via_std}"
            )


class _Memory:
    """What is carried from one step to the next, besides the controllers' states."""

    def __init__(self, shape: tuple[int, ...]) -> None:
        self.phase = np.zeros(shape)
        self.observed_phase = np.zeros(shape)
        self.last_via = np.zeros(shape)
        self.std = np.full((*shape, 6), np.nan)  # NaN: none yet
        self.fresh = True

    def reset(self, members: Members) -> None:
        """Forget what these members carry."""
        for phase in (self.phase, self.observed_phase, self.last_via):
            phase[members] = 0.0
        self.std[members] = np.nan
        self.fresh = True


class ComplianceController:
    """Decides for one hand, or for many with one rule of the phase and one config.

    `gplfd_policies.handles.adapter.controller_of` makes one, with adapters around
    movements, phases and load where handles turn.

    Args:
        movements: The movements that are followed; adapted in place.
        phases: Tells where along the task the observed poses lie.
        load: `ComplianceConfig.load` at work.
        config: Stiffness, timing and via-points.
    """

    def __init__(
        self,
        movements: GriddedMovements,
        phases: PhaseObserver,
        load: Load,
        config: ComplianceConfig,
    ) -> None:
        self._movements, self._phases = movements, phases
        self._load, self._config = load, config
        shape = self._movements.durations.shape
        self._governor = StiffnessGovernor(config.profile, config.dynamics, shape)
        self._renderer = config.rendering.renderer(
            config.dynamics, config.control_period, shape
        )
        self._memory = _Memory(shape)
        self._via_noise = np.repeat(config.via_std, 3)

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Let these members forget their last doors and begin at closed ones."""
        self._movements.reset(members)
        self._governor.reset(members)
        self._renderer.reset(members)
        self._load.reset(members)
        self._memory.reset(members)
        self._phases.reset(members)

    def decide(
        self, poses: Poses, wrenches: Poses, members: Members = EVERY_MEMBER
    ) -> AgentStep:
        """Return what these members do in the next control period, and why.

        Args:
            poses: Poses of these members' hands, task frame [m, rad].
            wrenches: Forces and moments on them [N, N m].
            members: Whose they are. Nothing changes for the others.
        """
        memory = self._memory
        # A copy: the rule may return it, and the command phase moves on below.
        command = memory.phase[members].copy()
        seen = self._phases.update(
            poses, memory.observed_phase[members], command, members
        )
        observed_phase = memory.observed_phase[members] = seen.phase
        mean, mean_std, direction = self._movements.ahead(observed_phase, members)
        via_point = self._adapt(poses, observed_phase, seen.std, members)
        if via_point.any():
            _, _, direction = self._movements.ahead(observed_phase, members)
        encounter = Encounter(
            wrench=wrenches,
            direction=direction,
            pose=poses,
            displacement=self._renderer.displacement(poses[..., :3], members),
        )
        response = self._load.meet(encounter, members)
        phase, rate = self._advance(response.pace, members)
        desired, velocity, std = self._set_point(phase, rate, observed_phase, members)
        # Where the hand is held off, along the path, the policy is not to be trusted.
        doubt = np.asarray(response.give)[..., None] * direction
        std[..., :3] = np.sqrt(std[..., :3] * std[..., :3] + doubt * doubt)
        std_rate = self._rate_of(std, members)
        governed = self._govern(std, members)
        action = self._renderer.step(
            desired,
            velocity,
            governed.stiffness,
            yielded=response.wrench,
            carried=(response.wrench - wrenches)[..., :3],
            members=members,
        )
        return AgentStep(
            action=action,
            desired=desired,
            std=std,
            std_rate=std_rate,
            stiffness=governed.stiffness,
            stiffness_rate=governed.rate,
            stability_margin=governed.margin,
            contact_margin=self._renderer.contact_margin(governed.stiffness),
            carried_load=response.carried,
            give=response.give,
            phase=phase,
            observed_phase=observed_phase,
            phase_misfit=seen.misfit,
            predicted_mean=self._movements.hand_poses(mean, members),
            predicted_std=mean_std,
            via_point=via_point,
        )

    def _adapt(
        self,
        poses: Poses,
        phases: Phases,
        phase_stds: Phases,
        members: Members,
    ) -> Due:
        """Condition the movements of members that have come far enough; say which."""
        last_via = self._memory.last_via[members]
        # Far back, the phase was lost before: what was taken then is not where it was.
        lost = phases < last_via - _LOST
        due = (phases >= last_via + self._config.via_spacing) | lost
        if not due.any():
            return due
        self._memory.last_via[members] = np.where(due, phases, last_via)
        # An error of the phase moves all outputs together along the path.
        rate, phase_std = self._phases.rate(phases, members), np.asarray(phase_stds)
        along = rate * phase_std[..., None]
        # Indexed by `due`, the arrays of one hand have a leading axis, too.
        numbers, seen = self._movements.numbers[members][due], np.asarray(phases)[due]
        for member, phase, pose, error in zip(
            numbers.tolist(), seen.tolist(), poses[due], along[due], strict=True
        ):
            via_point = ViaPoint(
                phase=phase, pose=pose, std=self._via_noise, along=error
            )
            self._movements.observe(member, via_point)
        return due

    def _set_point(
        self, phase: Phases, rate: Phases, observed_phase: Phases, members: Members
    ) -> tuple[Poses, Float[np.ndarray, "*N 3"], Poses]:
        """Mean, its velocity and σ at the command phase, which moves at a rate.

        The rotation leads by less than the pull.
        """
        turn_phase = np.minimum(phase, observed_phase + self._config.max_turn_lead)
        asked = np.array([*look_ahead(phase, phase), turn_phase])
        means, stds = self._movements.at(asked, members)
        along = (means[2, ..., :3] - means[1, ..., :3]) / LOOK_AHEAD
        velocity = along * np.asarray(rate)[..., None]
        desired = means[0]
        desired[..., 3:] = means[3, ..., 3:]
        return self._movements.hand_poses(desired, members), velocity, stds[0]

    def _advance(self, pace: Phases, members: Members) -> tuple[Phases, Phases]:
        """Return the command phase a period later, and its rate [1/s]."""
        period, durations = self._config.control_period, self._movements.durations
        before = self._memory.phase[members]
        step = pace * period / durations[members]
        moved: Phases = np.minimum(np.maximum(before + step, 0.0), 1.0)
        rate = (moved - before) / period  # now: `before` may be a view
        self._memory.phase[members] = moved
        return moved, rate

    def _rate_of(self, std: Poses, members: Members) -> Poses:
        """Rate of the σ that is really used: between steps, not along one curve."""
        memory = self._memory
        previous = memory.std[members]
        if memory.fresh:
            previous = np.where(np.isnan(previous), std, previous)
        rate: Poses = (std - previous) / self._config.control_period
        memory.std[members] = std
        memory.fresh = memory.fresh and bool(np.isnan(memory.std).any())
        return rate

    def _govern(self, std: Poses, members: Members) -> GovernedStiffness:
        """Return the stiffness that σ asks for, as fast as it may rise."""
        wished = self._config.profile.stiffness(std)
        return self._governor.step(wished, self._config.control_period, members)
