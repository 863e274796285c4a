"""One agent: what the rollout needs, and the one that the paper describes.

The paper is Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979; `policies.compliance` is what the agent does.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

from policies.compliance import ComplianceConfig, ComplianceController
from policies.gridded import GriddedMovement
from policies.phase import PhaseRule
from policies.steps import AgentStep, Observation
from policies.trajectory import GaussianTrajectory

__all__ = ["Agent", "AgentStep", "CompliantAgent", "Observation"]


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
class CompliantAgent:
    """Follows a learned movement with variable-stiffness admittance control.

    The command phase runs by the clock, at the demonstrations' mean speed, unless the
    load rule makes it wait. `policies.lockstep` lets many of them act together.

    Attributes:
        movement: The movement on a grid of phases, adapted in place.
        phases: Tells where along the task an observed pose lies.
        config: Stiffness, load, timing and via-points.
    """

    movement: GriddedMovement
    phases: PhaseRule
    config: ComplianceConfig = field(default_factory=ComplianceConfig)
    _controller: ComplianceController = field(init=False, repr=False, compare=False)

    def __post_init__(self) -> None:
        controller = ComplianceController(self.movement, self.phases, self.config)
        object.__setattr__(self, "_controller", controller)

    def reset(self, observation: Observation) -> None:
        """Forget the last door and begin at the closed one."""
        self._controller.reset()

    def act(self, observation: Observation) -> AgentStep:
        """Return the command for the next control period.

        Args:
            observation: ``ee_pose`` (6,) [m, rad] and ``wrench`` (6,) [N, N m] on the
                hand, both in the task frame.
        """
        return self._controller.decide(observation["ee_pose"], observation["wrench"])

    def forecast(self) -> GaussianTrajectory:
        """Return the movement as it stands, over the whole task."""
        return self.movement.trajectory()
