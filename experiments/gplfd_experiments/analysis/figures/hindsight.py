"""What an agent decides, expects and predicts when it is shown a logged episode."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import opening_motion, prediction_errors
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import Agent
from gplfd_policies.control.steps import AgentStep, Observation
from gplfd_policies.movements.trajectory import GaussianTrajectory


def decisions(log: EpisodeLog, agent: Agent) -> Iterator[AgentStep]:
    """Show an agent the observations of a logged episode, row by row.

    Nothing is simulated: the agent of the log repeats its decisions; another one says
    what it would have made of the same observations. The agent is reset at once and
    acts when asked for its next decision: in between, `expectation` is what it expects.
    """

    def observation(row: int) -> Observation:
        names = ("ee_pose", "ee_twist", "wrench", "joint_pos", "joint_vel")
        seen = {name: getattr(log, name)[row] for name in names}
        return seen | {"time": log.times[row : row + 1]}

    agent.reset(observation(0))
    return (agent.act(observation(row)) for row in range(log.times.size))


def expectation(agent: Agent) -> GaussianTrajectory:
    """Return what an agent now expects of the whole task; one without raises."""
    forecast = agent.forecast()
    if forecast is None:
        raise ValueError("the agent makes no forecasts; use a Gaussian-process policy")
    return forecast


@dataclass(frozen=True, slots=True)
class Prediction:
    """What a policy predicted at T phases of an opening, one step ahead [m, rad]."""

    mean: FloatArray
    std: FloatArray
    width: FloatArray
    """Half of the 95 % interval over ``std``, (T,)."""

    def interval(self) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds, (T, 6)."""
        half = self.width[:, None] * self.std
        return self.mean - half, self.mean + half


@dataclass(frozen=True, kw_only=True, slots=True)
class Opening:
    """One door's opening and what was predicted in it, with and without via-points."""

    log: EpisodeLog
    motion: slice
    """Rows in which the door moves."""
    initial: GaussianTrajectory
    """The policy before any via-point."""
    stages: tuple[GaussianTrajectory, ...]
    """The policy as adapted when each stage was reached."""
    adaptive: Prediction
    fixed: Prediction

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
    """Show the opening once more to its policy, which is kept at some observed phases.

    The log does not have the width of the 95 % interval, which the policy knows.
    """
    width = np.empty(log.times.size)
    stages: list[GaussianTrajectory] = []
    decided = decisions(log, agent)
    initial = belief = expectation(agent)
    for row, decision in enumerate(decided):
        _, high = belief.interval()
        width[row] = (high[-1, 0] - belief.mean[-1, 0]) / belief.std[-1, 0]
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
        adaptive=Prediction(log.predicted_mean, log.predicted_std, width),
        fixed=Prediction(mean, std, np.full(width.size, width[0])),
    )
