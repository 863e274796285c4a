"""Episodes that begin before the handle: python benchmarks/approach.py.

Every seed has demonstrations of its own, which reach and open, and a reset of its own,
which draws the hand's place. Beside it the same policies begin with the handle in the
hand, before the same doors.
"""

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Final, get_args

import numpy as np
import tyro
from harness import opened, report, tasks_of

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DOORS
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.speed.report import Measurement, Value, at_least

_GRASPED: Final = 1
"""Stage from which a handle has been taken."""


def summary(logs: Sequence[EpisodeLog]) -> dict[str, Value]:
    """Return what episodes of one condition came to."""
    taken = [log for log in logs if log.capability.max() >= _GRASPED]
    when = [log.times[np.argmax(log.capability >= _GRASPED)] for log in taken]
    forces = [0.0]
    for log in logs:
        reaching = log.wrench[log.capability < _GRASPED, :3]
        forces += np.linalg.norm(reaching, axis=1).tolist()
    reasons = Counter(log.reason for log in logs if not log.success)
    return {
        "grasped": f"{len(taken)} of {len(logs)}",
        "opened": f"{sum(log.success for log in logs)} of {len(logs)}",
        "grasped after [s], median": float(np.median(when)) if when else None,
        "greatest force while reaching [N]": max(forces),
        "greatest slip [mm]": 1e3 * max(float(log.slip.max()) for log in logs),
        "why not": ", ".join(f"{n} {why}" for why, n in reasons.items()) or None,
    }


def conditions(
    policy: str, doors: Sequence[str], seeds: int, randomization: str
) -> Measurement:
    """Open doors from both starts."""
    rows: dict[str, dict[str, Value]] = {}
    taken = []
    for name in doors:
        for start in get_args(Start):
            tasks = [
                task
                for seed in range(seeds)
                for task in tasks_of(
                    [DOORS[name]],
                    policy,
                    seed=seed,
                    randomization=randomization,
                    start=start,
                )
            ]
            logs = opened(tasks)
            rows[f"{name}, {start}"] = summary(logs)
            if start == "approach":
                taken += [log.capability.max() >= _GRASPED for log in logs]
    return Measurement(
        title=f"{policy}, randomization {randomization}, {seeds} seeds",
        rows=rows,
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
    report(
        {one: partial(conditions, one, doors, seeds, randomization) for one in policies}
    )


if __name__ == "__main__":
    tyro.cli(main)
