"""Let agents act until their episodes end, and log all quantities.

`rollout` runs one agent, `rollouts` many in lockstep; both give the same logs, bit for
bit.
"""

import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, TypeVar

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from gplfd_env.doors.config import DoorConfig
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_experiments.episodes.log import (
    PER_STEP,
    Decisions,
    EpisodeLog,
    Forces,
    Forecasts,
    Motion,
    Opening,
)
from gplfd_policies.agents.agent import AgentBatch, as_agent
from gplfd_policies.movements.movement import GaussianTrajectory

Arrays = dict[str, NDArray[Any]]
StepT = TypeVar("StepT")


def rollout(
    env: gym.Env[Any, Any],
    agent: object,
    *,
    policy: str,
    door: str,
    seed: int,
    forecast_period: float = 0.35,
    on_step: Callable[[float, float], None] | None = None,
) -> EpisodeLog:
    """Let an agent act until the episode ends, and log everything.

    Args:
        env: Door environment of the agent's control, see `gplfd_env.ENVIRONMENT_IDS`.
        agent: Any object that `gplfd_policies.agents.agent.as_agent` accepts.
        policy: Name of the policy, for the log.
        door: Name of the door, for the log.
        seed: Seed of the environment's reset.
        forecast_period: Simulated time between forecasts [s]; one more is taken
            before the first decision and one at the end.
        on_step: Called after every step with the simulated time [s] and the angle of
            the door [rad].

    Raises:
        ValueError: The agent returns no pose.
    """
    agent = as_agent(agent)
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    agent.inform(inner.door_geometry)
    agent.reset(observation)
    rows: list[Arrays] = []
    forecasts = ForecastRecorder(agent.forecast, forecast_period)
    ended = truncated = False
    while True:
        now = float(observation["time"][0])
        forecasts.take_if_due(now, force=ended)
        decision, cpu, wall = _timed(partial(agent.act, observation))
        measured = {
            "times": now,
            "qpos": inner.data.qpos,
            "solved": info["success"],
            "latency_s": cpu,
            "latency_wall_s": wall,
        }
        rows.append(_row(observation, info, decision, measured))
        if on_step is not None:
            on_step(now, float(info["door_angle"]))
        if ended:
            names = {"policy": policy, "door": door, "seed": seed}
            arrays = {name: np.asarray([row[name] for row in rows]) for name in rows[0]}
            return _log(arrays, forecasts, info, inner.door, truncated, **names)
        observation, _, terminated, truncated, info = env.step(
            decision.command(agent.control)
        )
        ended = terminated or truncated


def rollouts(
    envs: DoorOpeningVectorEnv,
    agents: AgentBatch,
    *,
    policy: str,
    doors: Sequence[str],
    seeds: Sequence[int],
    forecast_period: float | None = 0.35,
    before_step: Callable[[], None] = lambda: None,
) -> tuple[EpisodeLog, ...]:
    """Let every agent open its door once, and log each episode as `rollout` does.

    The N simulations have ``autoreset_mode="Disabled"``. Without a period [s] there are
    no forecasts. `before_step` is called before the first reset and every decision.
    ``latency_s`` and ``latency_wall_s`` are each agent's share of the batch's decision.

    Raises:
        ValueError: The simulations reset automatically.
    """
    if envs.autoreset_mode.value != "Disabled":
        raise ValueError(
            "lockstep rollouts need simulations that stand still when they end: make "
            'them with autoreset_mode="Disabled"'
        )
    before_step()
    observations, infos = envs.reset(seed=list(seeds))
    agents.inform(envs.door_geometries)
    agents.reset(observations)
    rows: list[Arrays] = []
    forecasts = [
        ForecastRecorder(partial(agents.forecast, row), forecast_period)
        for row in range(envs.num_envs)
    ]
    lengths = np.zeros(envs.num_envs, dtype=int)
    acting = np.ones(envs.num_envs, dtype=bool)
    ended, truncated = ~acting, ~acting
    while True:
        before_step()
        times = observations["time"][:, 0]
        for row in np.flatnonzero(acting).tolist():
            forecasts[row].take_if_due(float(times[row]), force=bool(ended[row]))
        decided, cpu, wall = _timed(partial(agents.act, observations, acting))
        count = np.count_nonzero(acting)
        measured = {
            "times": times,
            "qpos": envs.qpos,
            "solved": infos["success"],
            "latency_s": np.full(times.shape, cpu / count),
            "latency_wall_s": np.full(times.shape, wall / count),
        }
        rows.append(_row(observations, infos, decided, measured))
        lengths += acting
        # An episode's last row is the state in which it ended.
        acting = acting & ~ended
        if not acting.any():
            break
        observations, _, terminated, truncated, infos = envs.step(
            decided.command(agents.control)
        )
        ended = terminated | truncated
    together = {name: np.asarray([row[name] for row in rows]) for name in rows[0]}
    return tuple(
        _log(
            {name: array[: lengths[row], row] for name, array in together.items()},
            forecasts[row],
            {name: infos[name][row] for name in ("failure", "reason")},
            envs.variations[row].door,
            bool(truncated[row]),
            policy=policy,
            door=door,
            seed=seed,
        )
        for row, (door, seed) in enumerate(zip(doors, seeds, strict=True))
    )


def _row(
    observation: Mapping[str, NDArray[np.float64]],
    info: Mapping[str, Any],
    step: object,
    measured: Mapping[str, Any],
) -> Arrays:
    """Return copies of all quantities of a control step, of one episode or of N."""
    values = {**info, **observation, **measured}
    return {
        name: np.copy(values[name] if name in values else getattr(step, name))
        for name in ("times", *PER_STEP)
    }


class ForecastRecorder:
    """Takes a forecast before the first decision and at every period [s], if any."""

    def __init__(
        self, ask: Callable[[], GaussianTrajectory | None], period: float | None
    ) -> None:
        self._ask, self._period = ask, period
        self._taken: list[tuple[Any, ...]] = []

    def take_if_due(self, now: float, *, force: bool) -> None:
        """Take a forecast if one is due at the simulated time `now` [s], or forced."""
        if self._period is None:
            return
        # Half a microsecond of tolerance, because times are rounded sums of steps.
        due = not self._taken or now >= self._taken[-1][0] + self._period - 5e-7
        if (due or force) and (forecast := self._ask()) is not None:
            # Not the trajectory, because it refers to its input, up to 1 MB.
            self._taken.append((now, forecast.mean, forecast.std, forecast.times))

    def forecasts(self) -> Forecasts:
        """Return the forecasts so far."""
        taken = zip(*self._taken, strict=True) if self._taken else ((), (), (), ((),))
        times, means, stds, (*_, phases) = taken
        shape = (len(means), len(phases), 6)
        return Forecasts(
            times=np.array(times),
            phases=np.array(phases),
            mean=np.reshape(means, shape),
            std=np.reshape(stds, shape),
        )


def _timed(decide: Callable[[], StepT]) -> tuple[StepT, float, float]:
    """Return a decision, its CPU time in this thread and its wall time [s]."""
    started, cpu_started = time.perf_counter_ns(), time.thread_time_ns()
    decision = decide()
    cpu = time.thread_time_ns() - cpu_started
    return decision, 1e-9 * cpu, 1e-9 * (time.perf_counter_ns() - started)


def _log(
    arrays: Arrays,
    recorder: ForecastRecorder,
    info: Mapping[str, Any],
    door_config: DoorConfig,
    truncated: bool,
    **names: Any,
) -> EpisodeLog:
    """Return the log of an episode from its arrays and how it ended."""
    success = bool(arrays["solved"][-1])
    failure, reason = info["failure"], info["reason"]
    if truncated and not failure and not success:
        failure = reason = "time_limit"
    return EpisodeLog(
        **names,
        door_config=door_config.as_dict(),
        dt=float(np.median(np.diff(arrays["times"]))),
        success=success,
        failure=str(failure),
        reason=str(reason),
        times=arrays["times"],
        motion=Motion.of(arrays),
        opening=Opening.of(arrays),
        forces=Forces.of(arrays),
        decisions=Decisions.of(arrays),
        forecasts=recorder.forecasts(),
    )
