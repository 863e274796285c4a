"""Times of agents in closed loop and of recording them: python benchmarks/agents.py."""

import copy
import statistics
import tempfile
import time
from functools import partial
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import tyro
from harness import report

from gplfd_env import ENVIRONMENT_ID
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.recording import record_episode
from gplfd_experiments.speed.machine import load
from gplfd_experiments.speed.report import Measurement, at_least, at_most
from gplfd_experiments.speed.timing import Action, Timed, after, measure, repeated
from gplfd_policies.agents.lockstep import batch_agents
from gplfd_policies.registry.catalogue import make_agent

ALONE: Final = "one agent, gym.make"
TOGETHER: Final = "{} agents in lockstep, gym.make_vec on 2 threads"


def loop(envs: Any, agents: Any, count: int, periods: int) -> tuple[Timed, list[float]]:
    """Return a closed loop of agents and simulations for timing.

    Also returns a list of the agents' CPU seconds per control step; every run appends
    one entry. Runs begin at closed doors, and no episode ends.
    """
    deciding: list[float] = []

    def prepare() -> Action:
        first, _ = envs.reset(seed=0)
        agents.reset(first)
        return partial(run, first)

    def run(observation: Any) -> None:
        spent = 0
        for _ in range(periods):
            started = time.thread_time_ns()
            action = agents.act(observation).action
            spent += time.thread_time_ns() - started
            observation, *_ = envs.step(action)
        deciding.append(1e-9 * spent / (count * periods))

    return Timed(prepare=prepare, operations=count * periods), deciding


def measure_loops(repeats: int, counts: tuple[int, ...], periods: int) -> Measurement:
    """Time one agent alone and increasing numbers of agents in lockstep, in turns."""
    agent = make_agent("gp", Teacher().standard_demonstrations(seed=0))
    alone = gym.make(ENVIRONMENT_ID, door="medium")
    loops = {ALONE: loop(alone, agent, 1, periods)}
    for count in counts:
        envs = gym.make_vec(
            ENVIRONMENT_ID,
            num_envs=count,
            door=[
                DEMONSTRATED_RADII[n % len(DEMONSTRATED_RADII)] for n in range(count)
            ],
            num_threads=2,
            autoreset_mode="Disabled",
        )
        # The policy learns once; each copy is an independent agent.
        agents = batch_agents([copy.deepcopy(agent) for _ in range(count)])
        loops[TOGETHER.format(count)] = loop(envs, agents, count, periods)
    times = measure({name: timed for name, (timed, _) in loops.items()}, repeats)
    most = TOGETHER.format(counts[-1])
    return Measurement(
        title=f"agent in the loop ({load()})",
        rows={
            name: {
                "control steps/s": times[name].rate,
                "CPU µs/step": 1e6 * times[name].cpu_median,
                "of which agent": 1e6 * statistics.median(deciding[-repeats:]),
            }
            for name, (_, deciding) in loops.items()
        },
        targets=(
            at_least(f"loop: {most} [control steps/s]", times[most].rate, 5000.0),
        ),
    )


def measure_recording(repeats: int) -> Measurement:
    """Open the medium door and record it, in turns; CPU time of all threads."""
    given = Teacher().standard_demonstrations(seed=0)
    agent = make_agent("gp", given)
    env: Any = gym.make(ENVIRONMENT_ID, door="medium")
    episode = partial(rollout, env, agent, policy="gp", door="medium", seed=0)
    log = episode()
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "medium.rrd"
        record = partial(record_episode, path, log, env.unwrapped.model, given)
        times = measure(
            {"rollout": after(env.reset, episode), "recording": repeated(record)},
            repeats,
        )
        size = path.stat().st_size
    env.close()
    over = times["recording"].cpu_over(times["rollout"])
    return Measurement(
        title=f"recording of an episode of {len(log.times)} control steps, "
        f"{size / 1e6:.1f} MB",
        rows={name: {"CPU ms [quartiles]": cpu} for name, cpu in times.items()},
        targets=(at_most("recording: CPU time over the rollout's", over, 0.10),),
    )


def main(
    repeats: int = 5, counts: tuple[int, ...] = (2, 16, 64), periods: int = 250
) -> None:
    """Measure the policy ``gp`` in closed loop, and the time of recording an episode.

    Args:
        repeats: Measurements of every time.
        counts: Numbers of agents in lockstep, increasing.
        periods: Control periods of a run; 250 periods are half an opening.
    """
    report(
        {
            "loops": partial(measure_loops, repeats, counts, periods),
            "recording": partial(measure_recording, repeats),
        }
    )


if __name__ == "__main__":
    tyro.cli(main)
