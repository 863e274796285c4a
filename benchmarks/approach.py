"""Episodes that begin before the handle: python benchmarks/approach.py.

Every seed has demonstrations of its own, which reach and open, and a reset of its own,
which draws the hand's place. Beside it the same policies begin with the handle in the
hand, before the same doors.
"""

import warnings
from collections import Counter
from collections.abc import Callable, Sequence
from typing import Final, get_args

import numpy as np
import tyro

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.episodes.build import learned_agents, open_together
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import episode_task
from gplfd_experiments.speed.report import Measurement, Value, at_least, measure_all
from gplfd_policies import POLICIES

_GRASPED: Final = 1
"""Stage from which a handle has been taken."""


def opened(
    policy: str, door: DoorConfig, start: Start, seeds: int, randomization: str
) -> Sequence[EpisodeLog]:
    """Let a policy open a door once per seed; return the logs."""
    tasks = [
        episode_task(
            f"{door.radius:g}",
            door,
            policy=policy,
            seed=seed,
            randomization=randomization,
            start=start,
        )
        for seed in range(seeds)
    ]
    with warnings.catch_warnings():
        # Preparing demonstrations says what it found.
        warnings.simplefilter("ignore")
        agents = [learned_agents(task, POLICIES[policy])() for task in tasks]
    return open_together(tasks, agents)


def summary(logs: Sequence[EpisodeLog]) -> dict[str, Value]:
    """Return what episodes of one condition came to."""
    taken = [log for log in logs if log.capability.max() >= _GRASPED]
    when = [log.times[np.argmax(log.capability >= _GRASPED)] for log in taken]
    reasons = Counter(log.reason for log in logs if not log.success)
    return {
        "grasped": f"{len(taken)} of {len(logs)}",
        "opened": f"{sum(log.success for log in logs)} of {len(logs)}",
        "grasped after [s], median": float(np.median(when)) if when else None,
        "greatest force while reaching [N]": max(map(_reaching_force, logs)),
        "greatest slip [mm]": 1e3 * max(float(log.slip.max()) for log in logs),
        "why not": ", ".join(f"{n} {why}" for why, n in reasons.items()) or None,
    }


def _reaching_force(log: EpisodeLog) -> float:
    reaching = log.capability < _GRASPED
    force = np.linalg.norm(log.wrench[reaching, :3], axis=1)
    return float(force.max()) if reaching.any() else 0.0


def conditions(
    policy: str, doors: Sequence[str], seeds: int, randomization: str
) -> Measurement:
    """Open doors from both starts."""
    found = {
        (name, start): opened(policy, DOORS[name], start, seeds, randomization)
        for name in doors
        for start in get_args(Start)
    }
    reached = [found[name, "approach"] for name in doors]
    taken = [log.capability.max() >= _GRASPED for logs in reached for log in logs]
    return Measurement(
        title=f"{policy}, randomization {randomization}, {seeds} seeds",
        rows={f"{name}, {start}": summary(found[name, start]) for name, start in found},
        targets=(at_least(f"{policy}: share grasped", float(np.mean(taken)), 0.95),),
    )


def main(
    policies: tuple[str, ...] = ("gp", "oracle", "hinge-fit"),
    doors: tuple[str, ...] = ("small", "medium", "large", "room-834"),
    seeds: int = 20,
    randomization: str = "mild",
) -> None:
    """Open doors from before the handle, and with the handle in the hand.

    Args:
        policies: Which.
        doors: Which, by name.
        seeds: How many of demonstrations and resets.
        randomization: What every reset draws.
    """

    def measured(policy: str) -> Callable[[int], Measurement]:
        return lambda _: conditions(policy, doors, seeds, randomization)

    measure_all({policy: measured(policy) for policy in policies}, repeats=1)


if __name__ == "__main__":
    tyro.cli(main)
