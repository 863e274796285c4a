"""The one loop in which an agent acts on a door."""

import time
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.recorder import ForecastRecorder, StepRecorder, make_log
from gplfd_policies.agents.agent import Agent, as_agent
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.control.steps import AgentStep


@dataclass(frozen=True, kw_only=True, slots=True)
class Progress:
    """An episode while it happens."""

    time: float
    """Simulated time since reset [s]."""
    door_angle: float
    """Opening angle of the door [rad]."""
    steps: int
    """Number of control steps so far."""
    log: Callable[[], EpisodeLog]
    """Makes the log of the episode so far; two steps or more. While it is not over it
    counts neither as solved nor as failed by the time limit."""


def rollout(
    env: gym.Env[Any, Any],
    agent: object,
    *,
    policy: str,
    door: str,
    seed: int,
    forecast_period: float = 0.35,
    on_step: Callable[[Progress], None] | None = None,
) -> EpisodeLog:
    """Let the agent act until the episode ends, and log everything.

    Args:
        env: Door environment of the agent's control, see `gplfd_env.ENVIRONMENT_IDS`;
            its ``unwrapped`` has the MuJoCo state and the variation.
        agent: Anything that `gplfd_policies.agents.agent.as_agent` takes.
        policy: Name of the policy, for the log.
        door: Name of the door, for the log.
        seed: Seed of the environment's reset.
        forecast_period: Simulated time between forecasts [s]; one more is taken
            before the first decision and one at the end.
        on_step: Called after every step.

    Returns:
        The log of the episode; its last row is the state in which it ended.

    Raises:
        ValueError: The agent does not return poses, or the environment's information
            lacks an entry.
    """
    agent = as_agent(agent)
    inner: Any = env.unwrapped
    # Matrices of a hundred rows: sharing them out among threads would cost
    # ten times the work itself.
    with one_thread:
        observation, info = env.reset(seed=seed)
        agent.inform(inner.door_geometry)
        agent.reset(observation)
        steps = StepRecorder()
        forecasts = ForecastRecorder(agent.forecast, forecast_period)
        ended = truncated = False

        def log() -> EpisodeLog:
            return make_log(
                steps.arrays() | forecasts.arrays(),
                failure=str(info["failure"]),
                reason=str(info["reason"]),
                truncated=truncated,
                policy=policy,
                door=door,
                door_config=inner.door.as_dict(),
                seed=seed,
            )

        while True:
            now = float(observation["time"][0])
            forecasts.take_if_due(now, force=ended)
            decision, cpu, wall = _timed_decision(agent, observation)
            steps.add(
                observation,
                info,
                decision,
                times=now,
                qpos=inner.data.qpos,
                solved=info["success"],
                latency_s=cpu,
                latency_wall_s=wall,
            )
            if on_step is not None:
                angle = float(info["door_angle"])
                on_step(Progress(time=now, door_angle=angle, steps=len(steps), log=log))
            if ended:
                return log()
            observation, _, terminated, truncated, info = env.step(
                decision.command(agent.control)
            )
            ended = terminated or truncated


def _timed_decision(agent: Agent, observation: Any) -> tuple[AgentStep, float, float]:
    """Let the agent decide; return the decision, its CPU time and wall time [s].

    CPU time is that of this thread: another process that takes the core away does not
    count. Wall time is what a robot waits, for other threads and input as well.
    """
    started, cpu_started = time.perf_counter_ns(), time.thread_time_ns()
    decision = agent.act(observation)
    cpu = time.thread_time_ns() - cpu_started
    return decision, 1e-9 * cpu, 1e-9 * (time.perf_counter_ns() - started)
