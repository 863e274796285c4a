"""The agent: policy, adaptation, stiffness and admittance composed, step by step.

Implements Section IV-B of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979: the door's motion, observed while opening it, adapts
the policy; the policy's uncertainty sets the stiffness; the virtual dynamics move the
set-point of a position-controlled arm.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from gplfd_env.se3 import compose_rotvecs
from policies.controllers.admittance import Admittance
from policies.controllers.stability import GovernedStiffness, StiffnessGovernor
from policies.controllers.stiffness import StiffnessProfile, VirtualDynamics
from policies.gridded import GriddedPolicy
from policies.load import LoadRule
from policies.phase import PhaseRule
from policies.trajectory import GaussianTrajectory, ViaPoint

Observation = Mapping[str, Float[np.ndarray, "..."]]
Pose = Float[np.ndarray, " 6"]

_LOOK_AHEAD: Final = 0.05
"""Stretch of the path, in phase, whose chord is its direction."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AgentStep:
    """What an agent decided in one control step, and why.

    An agent without uncertainty or without compliance fills what it has no notion of
    with NaN.

    Attributes:
        action: Commanded hand pose, task frame [m, rad].
        desired: The policy's mean at the command phase [m, rad].
        std: The policy's standard deviation there, which sets the stiffness [m, rad].
        std_rate: Rate of the σ the controller really used, jumps included [1/s].
        stiffness: Rendered stiffness, after the governor [N/m, N m/rad].
        stiffness_rate: Its rate over this step [N/m/s, N m/rad/s].
        stability_margin: Pointwise stability bound minus `stiffness_rate`.
        phase: Command phase: where along the task the set-point is, 0..1.
        observed_phase: Where along the task the hand is, 0..1.
        predicted_mean: Mean at `observed_phase`, before this observation adapted the
            policy; the phase itself was told by it.
        predicted_std: Standard deviation there [m, rad].
        via_point: This observation was taken as a via-point.
    """

    action: Pose
    desired: Pose
    std: Pose
    std_rate: Pose
    stiffness: Pose
    stiffness_rate: Pose
    stability_margin: Pose
    phase: float
    observed_phase: float
    predicted_mean: Pose
    predicted_std: Pose
    via_point: bool

    def __post_init__(self) -> None:
        for name in _STEP_ARRAYS:
            array = getattr(self, name).copy()
            array.flags.writeable = False
            object.__setattr__(self, name, array)


_STEP_ARRAYS: Final = (
    *("action", "desired", "std", "std_rate", "stiffness", "stiffness_rate"),
    *("stability_margin", "predicted_mean", "predicted_std"),
)


@runtime_checkable
class Agent(Protocol):
    """What the rollout needs of a policy."""

    def reset(self, observation: Observation) -> None:
        """Begin an episode at the closed, grasped door."""

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""

    def forecast(self) -> GaussianTrajectory | None:
        """Return what the policy now expects of the whole task, or None."""


@dataclass(frozen=True, kw_only=True, slots=True)
class AgentConfig:
    """How the agent moves through the task and what it takes as a via-point."""

    control_period: float = 0.01
    """Time between two commands [s]."""

    via_spacing: float = 0.01
    """Progress between two via-points, in phase."""

    via_std: tuple[float, float] = (1e-3, 3e-2)
    """Noise of an observed via-point: position [m], rotation [rad]."""

    max_turn_lead: float = 0.05
    """How far the set-point's rotation may run ahead of the hand, in phase. It turns
    with the handle: turning first would only twist the hand on the bar."""

    def __post_init__(self) -> None:
        for name in ("control_period", "via_spacing", "max_turn_lead"):
            value = getattr(self, name)
            if not 0.0 < value < math.inf:
                raise ValueError(
                    f"AgentConfig.{name} must be positive and finite, got {value}"
                )
        if len(self.via_std) != 2 or not all(0.0 <= s < math.inf for s in self.via_std):
            raise ValueError(
                "AgentConfig.via_std must be two finite numbers >= 0, position [m] and "
                f"rotation [rad], got {self.via_std}"
            )


@dataclass(slots=True)
class _Memory:
    """What the agent carries from one step to the next."""

    phase: float = 0.0
    last_via: float = 0.0
    std: Pose | None = None


@dataclass(slots=True)
class GaussianProcessAgent:
    """Follows a Gaussian-process policy with variable-stiffness admittance control.

    The command phase runs by the clock, at the demonstrations' mean speed, unless the
    load rule makes it wait.

    Attributes:
        policy: The policy on a grid of phases, adapted in place.
        phases: Tells where along the task an observed pose lies.
        load: What is done about the door's resistance.
        profile: Stiffness as a function of uncertainty, Eq. (24).
        dynamics: Virtual mass and damping ratio, Eq. (22).
        config: Timing and via-points.
    """

    policy: GriddedPolicy
    phases: PhaseRule
    load: LoadRule
    profile: StiffnessProfile
    dynamics: VirtualDynamics
    config: AgentConfig = field(default_factory=AgentConfig)
    _governor: StiffnessGovernor = field(init=False)
    _admittance: Admittance = field(init=False)
    _memory: _Memory = field(init=False, default_factory=_Memory)

    def __post_init__(self) -> None:
        self._governor = StiffnessGovernor(self.profile, self.dynamics)
        self._admittance = Admittance(self.dynamics)

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self.policy.reset()
        self.phases.reset()
        self._governor.reset()
        self._admittance.reset()
        self._memory = _Memory()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period.

        Args:
            observation: ``ee_pose`` (6,) [m, rad] and ``wrench`` (6,) [N, N m] on the
                hand, both in the task frame.
        """
        pose, memory = observation["ee_pose"], self._memory
        observed_phase, phase_std = self.phases.update(pose, memory.phase)
        predicted_mean, predicted_std = self.policy.at(observed_phase)
        via_point = self._adapt(pose, observed_phase, phase_std)
        direction = self._direction(observed_phase)
        wrench, pace = self.load.share(observation["wrench"], direction)
        self._advance(pace)
        desired, std = self._set_point(memory.phase, observed_phase)
        std_rate = self._rate_of(std)
        governed, action = self._render(desired, std, wrench)
        return AgentStep(
            action=action,
            desired=desired,
            std=std,
            std_rate=std_rate,
            stiffness=governed.stiffness,
            stiffness_rate=governed.rate,
            stability_margin=governed.margin,
            phase=memory.phase,
            observed_phase=observed_phase,
            predicted_mean=predicted_mean,
            predicted_std=predicted_std,
            via_point=via_point,
        )

    def forecast(self) -> GaussianTrajectory:
        """Return the policy as it stands, over the whole task."""
        return self.policy.trajectory()

    def _adapt(self, pose: Pose, phase: float, phase_std: float) -> bool:
        if phase < self._memory.last_via + self.config.via_spacing:
            return False
        self._memory.last_via = phase
        # An error of the phase moves the via-point along the path: each output is as
        # weak as the path runs along it while the phase is uncertain.
        along = self.phases.rate(phase) * phase_std
        noise = np.repeat(self.config.via_std, 3)
        std = np.sqrt(noise**2 + along**2)
        self.policy.observe(ViaPoint(phase=phase, pose=pose, std=std))
        return True

    def _set_point(self, phase: float, observed_phase: float) -> tuple[Pose, Pose]:
        """Mean and σ at the command phase; the rotation leads by less than the pull."""
        desired, std = self.policy.at(phase)
        turn_phase = min(phase, observed_phase + self.config.max_turn_lead)
        if turn_phase < phase:
            turned, _ = self.policy.at(turn_phase)
            desired[3:] = turned[3:]
        return desired, std

    def _direction(self, phase: float) -> Float[np.ndarray, " 3"]:
        """Return the direction in which the policy moves the hand on, a unit vector."""
        ahead = min(phase + _LOOK_AHEAD, 1.0)
        start, _ = self.policy.at(ahead - _LOOK_AHEAD)
        end, _ = self.policy.at(ahead)
        chord = end[:3] - start[:3]
        unit: Float[np.ndarray, " 3"] = chord / (math.sqrt(chord @ chord) + 1e-9)
        return unit

    def _advance(self, pace: float) -> None:
        step = pace * self.config.control_period / self.policy.skill.duration
        self._memory.phase = min(max(self._memory.phase + step, 0.0), 1.0)

    def _rate_of(self, std: Pose) -> Pose:
        """Rate of the σ that is really used: between steps, not along one curve."""
        previous = self._memory.std
        self._memory.std = std
        if previous is None:
            return np.zeros(6)
        rate: Pose = (std - previous) / self.config.control_period
        return rate

    def _render(
        self, desired: Pose, std: Pose, wrench: Pose
    ) -> tuple[GovernedStiffness, Pose]:
        """Return the governed stiffness, and the set-point displaced by the wrench."""
        period = self.config.control_period
        governed = self._governor.step(self.profile.stiffness(std), period)
        offset = self._admittance.step(governed.stiffness, wrench, period)
        action = desired + offset
        action[3:] = compose_rotvecs(offset[3:], desired[3:])
        return governed, action
