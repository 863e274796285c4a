"""Let agents act until their episodes end, and log all quantities.

`rollout` runs one agent, `rollouts` many in lockstep, with the same logs bit for bit.
"""

import math
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
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
Rows = NDArray[np.int64]

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
    steps = _Steps()
    forecasts = ForecastRecorder([agent.forecast], forecast_period)
    ended = truncated = False
    while True:
        now = float(observation["time"][0])
        forecasts.take_if_due(np.array([now]), info["door_angle"], np.array([ended]))
        decision, cpu, wall = _timed(partial(agent.act, observation), steps.count)
        state = {"times": now, "qpos": inner.data.qpos, "solved": info["success"]}
        latency = {"latency_s": cpu, "latency_wall_s": wall, "row": 0}
        steps.add({**info, **observation, **state, **latency}, decision)
        if ended:
            names: Any = {"policy": policy, "door": door, "seed": seed}
            logged = forecasts.of(0), info, inner.door, truncated
            return _log(steps.of(0), *logged, **names)
        command = decision.command(agent.control)
        observation, _, terminated, truncated, info = env.step(command)
        ended = terminated or truncated


def rollouts(
    envs: DoorOpeningVectorEnv,
    agents: AgentBatch,
    *,
    policies: Sequence[str],
    doors: Sequence[str],
    seeds: Sequence[int],
    forecast_period: float | None = 0.35,
    forecast_angles: FloatArray | None = None,
    before_step: Callable[[], None] = lambda: None,
) -> Iterator[EpisodeLog]:
    """Let every agent open its door once, and return logs like those of `rollout`.

    The N simulations have ``autoreset_mode="Disabled"``. Each log is made when taken.
    Without a period [s] there are no forecasts; with angles of the doors (N, P) [rad],
    only the first after each is reached. `before_step` is called before the first reset
    and every decision; ``latency_s`` and ``latency_wall_s`` are shares of its time.

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
    steps = _Steps()
    asked = [partial(agents.forecast, row) for row in range(envs.num_envs)]
    forecasts = ForecastRecorder(asked, forecast_period, forecast_angles)
    every, acting = np.arange(envs.num_envs), np.ones(envs.num_envs, dtype=bool)
    ended, truncated = ~acting, ~acting
    while True:
        before_step()
        times = observations["time"][:, 0]
        forecasts.take_if_due(times, infos["door_angle"], ended, acting)
        rows = np.flatnonzero(acting)
        decide = partial(agents.decide, observations, rows)
        decided, cpu, wall = _timed(decide, steps.count)
        state = {"times": times, "qpos": envs.qpos, "solved": infos["success"]}
        cpus, walls = (np.full(envs.num_envs, x / len(rows)) for x in (cpu, wall))
        latency = {"latency_s": cpus, "latency_wall_s": walls, "row": every}
        steps.add({**infos, **observations, **state, **latency}, decided, rows)
        # An episode's last row is the state in which it ended.
        acting = acting & ~ended
        if not acting.any():
            break
        command = decided.command(agents.control)
        commands = np.zeros((envs.num_envs, command.shape[1]))
        commands[rows] = command
        observations, _, terminated, truncated, infos = envs.step(commands)
        ended = terminated | truncated
    names = zip(policies, doors, seeds, strict=True)
    return (
        _log(
            steps.of(row),
            forecasts.of(row),
            {name: infos[name][row] for name in ("failure", "reason")},
            envs.variations[row].door,
            bool(truncated[row]),
            policy=policy,
            door=door,
            seed=seed,
        )
        for row, (policy, door, seed) in enumerate(names)
    )


class _Steps:
    """Quantities of episodes, a row per control step of each, in arrays that double.

    Small arrays would fragment the memory, so that the process keeps what they free.
    """

    def __init__(self) -> None:
        self.count, self._size, self._grown = 0, 0, Arrays()

    def add(
        self, values: Mapping[str, Any], decided: object, rows: Rows | None = None
    ) -> None:
        """Copy the quantities of a step: of one agent, or of the rows that decided."""
        first, self.count = self._size, self.count + 1
        self._size += 1 if rows is None else len(rows)
        for name in ("row", "times", *PER_STEP):
            now = np.asarray(values[name] if name in values else getattr(decided, name))
            if rows is None:
                now = now[None]
            elif name in values:
                now = now.take(rows, axis=0)
            if self._size > len(self._grown.get(name, ())):
                dtype = bool if now.dtype == bool else np.float64
                grown = np.empty((max(128, 2 * self._size), *now.shape[1:]), dtype)
                grown[:first] = self._grown.get(name, grown)[:first]
                self._grown[name] = grown
            self._grown[name][first : self._size] = now

    def of(self, row: int) -> Arrays:
        """Return all quantities of an episode, by its number in `row`."""
        steps = np.flatnonzero(self._grown["row"][: self._size] == row)
        return {name: array.take(steps, axis=0) for name, array in self._grown.items()}


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
