"""Many episodes in lockstep: one vector environment, one batch of agents."""

from __future__ import annotations

import dataclasses
import time
from collections.abc import Mapping, Sequence
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray
from threadpoolctl import threadpool_limits

from experiments.episode_log import EpisodeLog
from experiments.rollout import DECISIONS, INFOS, OBSERVATIONS, Forecasts, ending

if TYPE_CHECKING:
    from gplfd_env.vector import DoorOpeningVectorEnv
    from policies.lockstep import AgentBatch
    from policies.steps import AgentStep

Mask = NDArray[np.bool_]


def rollouts(
    envs: DoorOpeningVectorEnv,
    agents: AgentBatch,
    *,
    policy: str,
    doors: Sequence[str],
    seeds: Sequence[int],
    forecast_period: float | None = 0.35,
) -> tuple[EpisodeLog, ...]:
    """Let every agent open its door once, and log each episode.

    An episode's log is that of `experiments.rollout.rollout` with the single
    environment and the agent alone, bit for bit, but for ``latency_s``: each member's
    share of the batch's decision.

    Args:
        envs: N simulations with ``autoreset_mode="Disabled"``.
        agents: Their N agents.
        policy: Name of the policy, for the logs.
        doors: Names of the N doors, for the logs.
        seeds: Seeds of the N simulations' resets.
        forecast_period: Simulated time between forecasts [s]; None for none.

    Raises:
        ValueError: The simulations reset by themselves, or N differs.
    """
    _check(envs, doors, seeds)
    # See `experiments.rollout.rollout`.
    with threadpool_limits(limits=1, user_api="blas"):
        observations, infos = envs.reset(seed=list(seeds))
        agents.reset(observations)
        table = _Table(envs, agents, forecast_period)
        acting = np.ones(envs.num_envs, dtype=bool)
        ended, truncated = ~acting, ~acting
        while True:
            table.forecast(observations["time"][:, 0], acting, ended)
            started = time.thread_time_ns()
            steps = agents.act(observations, acting)
            spent = 1e-9 * (time.thread_time_ns() - started) / np.count_nonzero(acting)
            table.add(observations, infos, steps, acting, spent)
            # An episode's last row is the state in which it ended.
            acting = acting & ~ended
            if not acting.any():
                break
            observations, _, terminated, truncated, infos = envs.step(steps.action)
            ended = terminated | truncated
    return tuple(
        EpisodeLog(
            policy=policy,
            door=door,
            door_config=dataclasses.asdict(envs.variations[row].door),
            seed=seed,
            **arrays | ending(arrays, str(infos["failure"][row]), bool(truncated[row])),
        )
        for row, (door, seed, arrays) in enumerate(
            zip(doors, seeds, table.episodes(), strict=True)
        )
    )


def _check(
    envs: DoorOpeningVectorEnv, doors: Sequence[str], seeds: Sequence[int]
) -> None:
    if envs.autoreset_mode.value != "Disabled":
        raise ValueError(
            "lockstep rollouts need simulations that stand still when they end: make "
            'them with autoreset_mode="Disabled"'
        )
    if not len(doors) == len(seeds) == envs.num_envs:
        raise ValueError(
            f"{envs.num_envs} simulations need as many doors and seeds, got "
            f"{len(doors)} and {len(seeds)}"
        )


class _Table:
    """Collects one row per control step for all episodes together."""

    def __init__(
        self, envs: DoorOpeningVectorEnv, agents: AgentBatch, period: float | None
    ) -> None:
        self._envs = envs
        self._columns: dict[str, list[Any]] = {
            name: []
            for name in (
                *("times", "qpos", "latency_s", "solved"),
                *OBSERVATIONS,
                *INFOS,
                *DECISIONS,
            )
        }
        self._lengths = np.zeros(envs.num_envs, dtype=int)
        self._forecasts = [
            Forecasts(partial(agents.forecast, row), period)
            for row in range(envs.num_envs)
        ]

    def add(
        self,
        observations: Mapping[str, NDArray[np.float64]],
        infos: Mapping[str, Any],
        steps: AgentStep,
        acting: Mask,
        latency: float,
    ) -> None:
        columns = self._columns
        times = observations["time"][:, 0]
        columns["times"].append(times)
        columns["qpos"].append(self._envs.qpos)
        columns["latency_s"].append(np.full(times.shape, latency))
        columns["solved"].append(infos["success"])
        for name in OBSERVATIONS:
            columns[name].append(observations[name])
        for name in INFOS:
            columns[name].append(infos[name])
        for name in DECISIONS:
            columns[name].append(getattr(steps, name))
        self._lengths += acting

    def forecast(self, times: NDArray[np.float64], acting: Mask, ended: Mask) -> None:
        for row in np.flatnonzero(acting).tolist():
            self._forecasts[row].take_if_due(float(times[row]), force=bool(ended[row]))

    def episodes(self) -> list[dict[str, NDArray[Any]]]:
        """Return the arrays of every episode, cut at its end."""
        stacked = {name: np.stack(rows) for name, rows in self._columns.items()}
        return [
            {
                name: np.ascontiguousarray(rows[:length, row])
                for name, rows in stacked.items()
            }
            | forecasts.arrays()
            for row, (length, forecasts) in enumerate(
                zip(self._lengths.tolist(), self._forecasts, strict=True)
            )
        ]
