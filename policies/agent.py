"""One agent: what the rollout needs, and the one that the paper describes.

The paper is Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979; `policies.composition` is what the agent does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from policies.composition import AgentConfig, Composition
from policies.controllers.stiffness import StiffnessProfile, VirtualDynamics
from policies.gridded import GriddedPolicy
from policies.load import LoadRule
from policies.phase import PhaseRule
from policies.steps import AgentStep, Observation
from policies.trajectory import GaussianTrajectory

__all__ = ["Agent", "AgentConfig", "AgentStep", "GaussianProcessAgent", "Observation"]


@runtime_checkable
class Agent(Protocol):
    """What the rollout needs of a policy."""

    def reset(self, observation: Observation) -> None:
        """Begin an episode at the closed, grasped door."""

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period."""

    def forecast(self) -> GaussianTrajectory | None:
        """Return what the policy now expects of the whole task, or None."""


@dataclass(frozen=True, slots=True)
class GaussianProcessAgent:
    """Follows a Gaussian-process policy with variable-stiffness admittance control.

    The command phase runs by the clock, at the demonstrations' mean speed, unless the
    load rule makes it wait. `policies.lockstep` lets many
    of them act together.

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
    _composition: Composition = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        composition = Composition(
            self.policy,
            phases=self.phases,
            load=self.load,
            profile=self.profile,
            dynamics=self.dynamics,
            config=self.config,
        )
        object.__setattr__(self, "_composition", composition)

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._composition.reset()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period.

        Args:
            observation: ``ee_pose`` (6,) [m, rad] and ``wrench`` (6,) [N, N m] on the
                hand, both in the task frame.
        """
        return AgentStep.of(
            self._composition.decide(observation["ee_pose"], observation["wrench"])
        )

    def forecast(self) -> GaussianTrajectory:
        """Return the policy as it stands, over the whole task."""
        return self.policy.trajectory()
