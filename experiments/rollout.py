"""The one loop in which an agent acts on a door."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from experiments.episode_log import EpisodeLog
from policies.agent import Agent, as_agent
from policies.steps import STEP_SHAPES, AgentStep

if TYPE_CHECKING:
    from policies.trajectory import GaussianTrajectory

OBSERVATIONS: Final = ("ee_pose", "ee_twist", "wrench", "joint_pos", "joint_vel")
"""Observations that are logged."""

INFOS: Final = (
    *("door_angle", "handle_pose", "grasped", "slip"),
    *("force_tangential", "force_radial", "force_vertical"),
)
"""Entries of the info that are logged."""

DECISIONS: Final = tuple(STEP_SHAPES)
"""Fields of `policies.steps.AgentStep` that are logged."""


def rollout(
    env: gym.Env[Any, Any],
    agent: object,
    *,
    policy: str,
    door: str,
    door_config: Mapping[str, float] | None = None,
    seed: int,
    forecast_period: float = 0.35,
    on_step: Callable[[float, float], None] | None = None,
) -> EpisodeLog:
    """Let the agent act until the episode ends, and log everything.

    Args:
        env: Door environment; its ``unwrapped.data`` is the MuJoCo state.
        agent: Anything that `policies.agent.as_agent` takes.
        policy: Name of the policy, for the log.
        door: Name of the door, for the log.
        door_config: Fields of the door's configuration, for the log; those of the
            environment's own door by default.
        seed: Seed of the environment's reset.
        forecast_period: Simulated time between forecasts [s]; one more is taken
            before the first decision and one at the end.
        on_step: Called after every step with the time [s] and the door angle [rad].

    Returns:
        The log of the episode; its last row is the state in which it ended.

    Raises:
        ValueError: The agent does not return poses, or the environment's information
            lacks an entry.
    """
    agent = as_agent(agent)
    # Matrices of a hundred rows: sharing them out among threads would cost
    # ten times the work itself.
    with threadpool_limits(limits=1, user_api="blas"):
        observation, info = env.reset(seed=seed)
        agent.reset(observation)
        rows = _Rows(env)
        forecasts = Forecasts(agent.forecast, forecast_period)
        ended = truncated = False
        while True:
            now = float(observation["time"][0])
            forecasts.take_if_due(now, force=ended)
            decision, latency = _timed_decision(agent, observation)
            rows.add(now, observation, info, decision, latency)
            if on_step is not None:
                on_step(now, float(info["door_angle"]))
            if ended:
                break
            observation, _, terminated, truncated, info = env.step(decision.action)
            ended = terminated or truncated
    arrays: dict[str, Any] = rows.arrays() | forecasts.arrays()
    return EpisodeLog(
        policy=policy,
        door=door,
        door_config=_door_config(env) if door_config is None else door_config,
        seed=seed,
        **ending(arrays, str(info["failure"]), truncated),
        **arrays,
    )


def _timed_decision(agent: Agent, observation: Any) -> tuple[AgentStep, float]:
    """Let the agent decide; return the decision and its CPU time [s]."""
    # CPU time of this thread: another process that takes the core away for a while
    # does not count as the agent thinking.
    started = time.thread_time_ns()
    decision = agent.act(observation)
    return decision, 1e-9 * (time.thread_time_ns() - started)


def ending(
    arrays: Mapping[str, NDArray[Any]], told: str, truncated: bool
) -> dict[str, Any]:
    """Return ``dt``, ``success`` and ``failure`` of an episode's log.

    Args:
        arrays: The log's arrays by name.
        told: The environment's last ``failure``.
        truncated: Whether the episode was cut off.
    """
    success = bool(arrays["solved"][-1])
    late = truncated and not told and not success
    return {
        "dt": float(np.median(np.diff(arrays["times"]))),
        "success": success,
        "failure": "time_limit" if late else told,
    }


def _door_config(env: gym.Env[Any, Any]) -> dict[str, float]:
    return dataclasses.asdict(env.unwrapped.door)  # type: ignore[attr-defined]


class _Rows:
    """Collects one row per decision."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        self._data: Any = env.unwrapped.data  # type: ignore[attr-defined]
        self._lists: dict[str, list[Any]] = {
            name: []
            for name in (
                *("times", "qpos", "latency_s", "solved"),
                *OBSERVATIONS,
                *INFOS,
                *DECISIONS,
            )
        }

    def add(
        self,
        now: float,
        observation: Mapping[str, NDArray[np.float64]],
        info: Mapping[str, Any],
        decision: AgentStep,
        latency: float,
    ) -> None:
        lists = self._lists
        lists["times"].append(now)
        lists["qpos"].append(self._data.qpos.copy())
        lists["latency_s"].append(latency)
        try:
            lists["solved"].append(info["success"])
            for name in INFOS:
                lists[name].append(np.copy(info[name]))
        except KeyError as error:
            raise ValueError(
                f"the environment's info lacks {error}; it has {sorted(info)}"
            ) from error
        for name in OBSERVATIONS:
            lists[name].append(np.copy(observation[name]))
        for name in DECISIONS:
            lists[name].append(np.copy(getattr(decision, name)))

    def arrays(self) -> dict[str, NDArray[Any]]:
        return {name: np.asarray(rows) for name, rows in self._lists.items()}


class Forecasts:
    """Asks for a forecast before the first decision and then regularly.

    Args:
        ask: Gives the agent's forecast, or None.
        period: Simulated time between forecasts [s]; None for no forecasts at all.
    """

    def __init__(
        self, ask: Callable[[], GaussianTrajectory | None], period: float | None
    ) -> None:
        self._ask = ask
        self._period = period
        self._times: list[float] = []
        self._phase: NDArray[np.float64] = np.empty(0)
        self._means: list[NDArray[np.float64]] = []
        self._stds: list[NDArray[np.float64]] = []

    def take_if_due(self, now: float, *, force: bool) -> None:
        """Take a forecast if it is time, or if ``force`` says so.

        Args:
            now: Simulated time [s].
            force: Take it anyway.
        """
        if self._period is None:
            return
        # Half a microsecond: times are sums of steps and miss the multiple by rounding.
        due = not self._times or now >= self._times[-1] + self._period - 5e-7
        if not (due or force):
            return
        forecast = self._ask()
        if forecast is not None:
            self._times.append(now)
            self._phase = np.array(forecast.times)
            self._means.append(np.array(forecast.mean))
            self._stds.append(np.array(forecast.std))

    def arrays(self) -> dict[str, NDArray[np.float64]]:
        """Return the forecasts by the names of `EpisodeLog`."""
        shape = (len(self._times), self._phase.size, 6)
        return {
            "forecast_times": np.array(self._times),
            "forecast_phase": self._phase,
            "forecast_mean": np.reshape(self._means, shape),
            "forecast_std": np.reshape(self._stds, shape),
        }
