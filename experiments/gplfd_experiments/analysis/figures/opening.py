"""One opening of a door, and what an adaptive and a fixed policy predicted in it.

The prediction error E[ε²] is that of Arduengo et al., *Gaussian-Process-based Robot
Learning from Demonstration*, arXiv:2002.09979, Section IV-B, where it has no number.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from gplfd_experiments.analysis.figures.hindsight import decisions, expectation
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import opening_motion, prediction_errors
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import Agent
from gplfd_policies.movements.trajectory import GaussianTrajectory


@dataclass(frozen=True, kw_only=True, slots=True)
class Prediction:
    """What a policy predicted at the phases of an opening, one step ahead."""

    mean: FloatArray
    """(T, 6) [m, rad]."""
    std: FloatArray
    """(T, 6) [m, rad]."""
    width: FloatArray
    """Half of the 95 % interval over ``std``, (T,)."""

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (T, 6)."""
        half = self.width[:, None] * self.std
        return self.mean - half, self.mean + half


@dataclass(frozen=True, kw_only=True, slots=True)
class Opening:
    """One door's opening and what was predicted in it."""

    log: EpisodeLog
    """The episode, with the adaptive policy."""
    motion: slice
    """Rows in which the door moves."""
    stages: tuple[GaussianTrajectory, ...]
    """The policy as adapted when each stage was reached."""
    initial: GaussianTrajectory
    """The policy before any via-point."""
    adaptive: Prediction
    """With the via-points before each step."""
    fixed: Prediction
    """Without via-points, at the same phases."""

    def errors(self) -> tuple[FloatArray, FloatArray]:
        """E[ε²] of the adaptive and of the fixed policy in the motion, (T', 6)."""
        bias = self.fixed.mean - self.log.handle_pose
        fixed = bias**2 + self.fixed.std**2
        return prediction_errors(self.log)[self.motion], fixed[self.motion]

    def coverage(self, prediction: Prediction) -> FloatArray:
        """Share of the motion's true poses inside the 95 % interval, (6,)."""
        low, high = prediction.interval()
        inside = (self.log.handle_pose >= low) & (self.log.handle_pose <= high)
        share: FloatArray = inside[self.motion].mean(axis=0)
        return share


def reviewed(log: EpisodeLog, agent: Agent, phases: Sequence[float]) -> Opening:
    """Show the opening once more to the policy, and note what it believed.

    The log has means and standard deviations; how wide their 95 % interval is depends
    on the number of via-points, which the policy knows.

    Args:
        log: The opening.
        agent: The policy that opened the door.
        phases: Observed phases at which the policy is kept as a stage.
    """
    width = np.empty(log.times.size)
    stages: list[GaussianTrajectory] = []
    decided = decisions(log, agent)
    initial = belief = expectation(agent)
    for row, decision in enumerate(decided):
        width[row] = _half_width(belief)
        if decision.via_point:
            belief = expectation(agent)
        reached = sum(decision.observed_phase >= phase for phase in phases)
        stages.extend([belief] * (reached - len(stages)))
    mean, std = log.first_forecast(log.observed_phase)
    return Opening(
        log=log,
        motion=opening_motion(log),
        stages=tuple(stages),
        initial=initial,
        adaptive=Prediction(
            mean=log.predicted_mean, std=log.predicted_std, width=width
        ),
        fixed=Prediction(mean=mean, std=std, width=np.full(width.size, width[0])),
    )


def _half_width(policy: GaussianTrajectory) -> float:
    """Half of a policy's 95 % interval over its standard deviation."""
    _, high = policy.interval()
    return float((high[-1, 0] - policy.mean[-1, 0]) / policy.std[-1, 0])
