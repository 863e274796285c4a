"""Let agents act until their episodes end, and log all quantities.

`rollout` runs one agent, `rollouts` many in lockstep, with the same logs bit for bit.
"""

import math
import time
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from gplfd_env.doors.config import DoorConfig
from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_experiments.episodes.log import PARTS, PER_STEP, EpisodeForecasts, EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.agents.agent import AgentBatch, as_agent
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.movements.movement import GaussianTrajectory

Arrays = dict[str, NDArray[Any]]
Flags = NDArray[np.bool_]

_ALL: Final = np.array([True])
_TIMED: Final = 10  # The CPU time of one of so many decisions is measured.
_NO_FORECAST: Final[Any] = ((), (), (), ((),))


def rollout(
    env: gym.Env[Any, Any],
    agent: object,
    *,
    policy: str,
    door: str,
    seed: int,
    forecast_period: float = 0.35,
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

    Raises:
        ValueError: The agent returns no pose.
    """
    agent = as_agent(agent)
    inner: Any = env.unwrapped
    observation, info = env.reset(seed=seed)
    agent.inform(inner.door_geometry)
    agent.reset(observation)
    rows: list[Arrays] = []
    forecasts = ForecastRecorder([agent.forecast], forecast_period)
    ended = truncated = False
    while True:
        now = float(observation["time"][0])
        forecasts.take_if_due(np.array([now]), info["door_angle"], np.array([ended]))
        decision, cpu, wall = _timed(partial(agent.act, observation), len(rows))
        state = {"times": now, "qpos": inner.data.qpos, "solved": info["success"]}
        latency = {"latency_s": cpu, "latency_wall_s": wall}
        rows.append(_row(observation, info, decision, state | latency))
        if ended:
            names = {"policy": policy, "door": door, "seed": seed}
            arrays = {name: np.asarray([row[name] for row in rows]) for name in rows[0]}
            return _log(arrays, forecasts.of(0), info, inner.door, truncated, **names)
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
    forecast_angles: FloatArray | None = None,
    before_step: Callable[[], None] = lambda: None,
) -> tuple[EpisodeLog, ...]:
    """Let every agent open its door once, and log each episode as `rollout` does.

    The N simulations have ``autoreset_mode="Disabled"``. Without a period [s] there are
    no forecasts; with angles of the doors (N, P) [rad], only the first ones after
    they have been reached. `before_step` is called before the first reset and every
    decision. ``latency_s`` and ``latency_wall_s`` are shares of the batch's decision.

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
    asked = [partial(agents.forecast, row) for row in range(envs.num_envs)]
    forecasts = ForecastRecorder(asked, forecast_period, forecast_angles)
    lengths = np.zeros(envs.num_envs, dtype=int)
    acting = np.ones(envs.num_envs, dtype=bool)
    ended, truncated = ~acting, ~acting
    while True:
        before_step()
        times = observations["time"][:, 0]
        forecasts.take_if_due(times, infos["door_angle"], ended, acting)
        decided, cpu, wall = _timed(
            partial(agents.act, observations, acting), len(rows)
        )
        state = {"times": times, "qpos": envs.qpos, "solved": infos["success"]}
        shares = np.array([[cpu], [wall]]) / np.count_nonzero(acting)
        cpus, walls = np.broadcast_to(shares, (2, envs.num_envs))
        latency = {"latency_s": cpus, "latency_wall_s": walls}
        rows.append(_row(observations, infos, decided, state | latency))
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
            forecasts.of(row),
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
    """Takes forecasts of N episodes before the first decision and every period [s].

    With angles, (N, P) [rad], it leaves out those before which no other was reached.
    """

    def __init__(
        self,
        asked: Sequence[Callable[[], GaussianTrajectory | None]],
        period: float | None,
        angles: FloatArray | None = None,
    ) -> None:
        self._asked, self._period, self._angles = asked, period, angles
        self._furthest = self._due = np.full(len(asked), -np.inf)
        self._reached = np.zeros(len(asked), dtype=int)
        self._taken: list[list[tuple[Any, ...]]] = [[] for _ in asked]

    def take_if_due(
        self, now: FloatArray, angle: FloatArray, ended: Flags, acting: Flags = _ALL
    ) -> None:
        """Take forecasts that are due at these times [s], (N,), or at the end."""
        if self._period is None:
            return
        # Half a microsecond of tolerance, because times are rounded sums of steps.
        due = now >= self._due - 5e-7
        self._due = np.where(due, now + self._period, self._due)
        take = acting & (due | ended)
        if self._angles is not None:
            self._furthest = np.maximum(self._furthest, angle)
            reached = np.sum(self._angles <= self._furthest[:, None], axis=1)
            take &= reached > self._reached
            self._reached = np.where(take, reached, self._reached)
        for row in np.flatnonzero(take).tolist():
            if (forecast := self._asked[row]()) is not None:
                # Not the trajectory, because it refers to its input, up to 1 MB.
                values = forecast.mean, forecast.std, forecast.times
                self._taken[row].append((now[row], *values))

    def of(self, row: int) -> EpisodeForecasts:
        """Return the forecasts of an episode so far."""
        taken = zip(*self._taken[row], strict=True)
        times, means, stds, (*_, phases) = taken if self._taken[row] else _NO_FORECAST
        shape = (len(means), len(phases), 6)
        return EpisodeForecasts(
            times=np.array(times),
            phases=np.array(phases),
            mean=np.reshape(means, shape),
            std=np.reshape(stds, shape),
        )


def _timed(
    decide: Callable[[], AgentStep], number: int
) -> tuple[AgentStep, float, float]:
    """Return a decision, its CPU time in this thread and its wall time [s].

    The CPU time is NaN but for every tenth decision: on virtual machines its clock may
    take as long as a decision.
    """
    timed, started = number % _TIMED == 0, time.perf_counter_ns()
    cpu_started = time.thread_time_ns() if timed else 0
    decision = decide()
    cpu = 1e-9 * (time.thread_time_ns() - cpu_started) if timed else math.nan
    return decision, cpu, 1e-9 * (time.perf_counter_ns() - started)


def _log(
    arrays: Arrays,
    forecasts: EpisodeForecasts,
    info: Mapping[str, Any],
    door_config: DoorConfig,
    truncated: bool,
    **names: Any,
) -> EpisodeLog:
    """Return the log of an episode from its arrays and how it ended."""
    parts: dict[str, Any] = {
        part: record.of(arrays) for part, record in PARTS.items() if part != "forecasts"
    }
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
        forecasts=forecasts,
        **parts,
    )
