"""How little can somebody feel who holds the hand: python benchmarks/person_limit.py.

The hand comes along with a speed that the demonstrations have, and arm and door with
it. What is left of the force on the person if the hand is commanded to be where it is,
from the first touch on, is what no controller of poses takes away.
"""

import contextlib
import statistics
from typing import Any

import numpy as np
import tyro

from gplfd_env.doors.config import DOORS
from gplfd_experiments.episodes.build import learned_agents, make_environment
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.speed.report import Measurement, Value, at_most, measure_all
from gplfd_policies import POLICIES

_WATCHED = 100
"""Steps after the first touch; the peak comes within twenty."""


def held(seed: int, follows: bool) -> dict[str, float]:
    """Let a person hold the hand; return the peak force [N] and the speed [m/s].

    Args:
        seed: Of teacher and environment.
        follows: Whether the command is the hand's own pose from the first touch on,
            instead of the agent's.
    """
    task = episode_task(
        "medium", DOORS["medium"], policy="gp", seed=seed, disturbance="person"
    )
    agent = learned_agents(task, POLICIES["gp"])()
    env: Any = make_environment(task, agent.control)
    with contextlib.closing(env):
        observation, info = env.reset(seed=task.reset_seed)
        agent.reset(observation)
        peak, speed, since = 0.0, 0.0, 0
        while since < _WATCHED:
            action = agent.act(observation).action
            if since and follows:
                action = observation["ee_pose"]
            if not since:
                speed = float(np.linalg.norm(observation["ee_twist"][:3]))
            observation, _, terminated, truncated, info = env.step(action)
            peak = max(peak, info["person_force"])
            since += info["person_force"] > 0.0 or since > 0
            if terminated or truncated:
                break
    return {"peak": peak, "speed": speed}


def compare(seeds: int) -> Measurement:
    """Hold the hand of the agent, and of one that follows the hand."""
    names = {"gp": False, "command follows the hand": True}
    found = {
        name: [held(seed, follows) for seed in range(seeds)]
        for name, follows in names.items()
    }
    rows: dict[str, dict[str, Value]] = {
        name: {
            "peak on the person [N]": statistics.median(one["peak"] for one in each),
            "hand before [m/s]": statistics.median(one["speed"] for one in each),
        }
        for name, each in found.items()
    }
    ours = rows["gp"]["peak on the person [N]"]
    return Measurement(
        title=f"somebody holds the hand, medians of {seeds} seeds",
        rows=rows,
        targets=(at_most("peak on the person, gp [N]", float(ours or 0.0), 20.0),),
    )


def main(seeds: int = 5) -> None:
    """Compare the agent with the limit.

    Args:
        seeds: How many, from 0.
    """
    measure_all({"person": compare}, seeds)


if __name__ == "__main__":
    tyro.cli(main)
