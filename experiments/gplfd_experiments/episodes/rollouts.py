"""Many episodes in lockstep: one vector environment, one batch of agents."""

import time
from collections.abc import Sequence
from functools import partial

import numpy as np

from gplfd_env.envs.vector import DoorOpeningVectorEnv
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.recorder import ForecastRecorder, StepRecorder, make_log
from gplfd_policies.agents.lockstep import AgentBatch
from gplfd_policies.arrays.one_thread import one_thread


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

    An episode's log is that of `gplfd_experiments.episodes.rollout.rollout` with the
    single environment and the agent alone, bit for bit, but for ``latency_s`` and
    ``latency_wall_s``: each member's share of the batch's decision.

    Args:
        envs: N simulations with ``autoreset_mode="Disabled"``, of the agents' control.
        agents: Their N agents.
        policy: Name of the policy, for the logs.
        doors: Names of the N doors, for the logs.
        seeds: Seeds of the N simulations' resets.
        forecast_period: Simulated time between forecasts [s]; None for none.

    Raises:
        ValueError: The simulations reset by themselves, or N differs.
    """
    _check(envs, doors, seeds)
    # See `gplfd_experiments.episodes.rollout.rollout`.
    with one_thread:
        observations, infos = envs.reset(seed=list(seeds))
        agents.inform(envs.door_geometries)
        agents.reset(observations)
        steps = StepRecorder()
        forecasts = [
            ForecastRecorder(partial(agents.forecast, row), forecast_period)
            for row in range(envs.num_envs)
        ]
        lengths = np.zeros(envs.num_envs, dtype=int)
        acting = np.ones(envs.num_envs, dtype=bool)
        ended, truncated = ~acting, ~acting
        while True:
            times = observations["time"][:, 0]
            for row in np.flatnonzero(acting).tolist():
                forecasts[row].take_if_due(float(times[row]), force=bool(ended[row]))
            started, cpu_started = time.perf_counter_ns(), time.thread_time_ns()
            decided = agents.act(observations, acting)
            cpu = time.thread_time_ns() - cpu_started
            wall = time.perf_counter_ns() - started
            share = 1e-9 / np.count_nonzero(acting)
            steps.add(
                observations,
                infos,
                decided,
                times=times,
                qpos=envs.qpos,
                solved=infos["success"],
                latency_s=np.full(times.shape, share * cpu),
                latency_wall_s=np.full(times.shape, share * wall),
            )
            lengths += acting
            # An episode's last row is the state in which it ended.
            acting = acting & ~ended
            if not acting.any():
                break
            observations, _, terminated, truncated, infos = envs.step(
                decided.command(agents.control)
            )
            ended = terminated | truncated
    together = steps.arrays()
    return tuple(
        make_log(
            {name: rows[: lengths[row], row] for name, rows in together.items()}
            | forecasts[row].arrays(),
            failure=str(infos["failure"][row]),
            reason=str(infos["reason"][row]),
            truncated=bool(truncated[row]),
            policy=policy,
            door=door,
            door_config=envs.variations[row].door.as_dict(),
            seed=seed,
        )
        for row, (door, seed) in enumerate(zip(doors, seeds, strict=True))
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
