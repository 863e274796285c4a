"""Resolution of the stiffness law: python benchmarks/stiffness_resolution.py.

All methods share a controller. Its stiffness is medium at β = √(n s), with s the spread
of the demonstrations and n the resolution. The script chooses n for every method, by a
criterion that was fixed before anything was measured:

* Each method opens the doors of the trials ``heavy`` and ``radius``, drawn with seeds
  that no trial uses, with each of four values of n.
* The default stays unless another value leaves fewer doors closed. Of such values, the
  one that leaves the fewest doors closed is chosen; of several, the one with the least
  median peak radial force.

`gplfd_policies.registry.tuning_spaces.RESOLUTIONS` contains the chosen values.
"""

import statistics
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import tyro
from harness import opened, report

from gplfd_experiments.console.progress import LOG
from gplfd_experiments.speed.report import Measurement, Value
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_policies.registry.catalogue import policy_named, with_resolution
from gplfd_policies.registry.tuning_spaces import SPACES

CANDIDATES: Final = (1e-4, 3e-4, 1e-3, 3e-3)
"""Values of n [m]; the first is the default."""
# dmp has no standard deviation, and gp-paper has the published stiffness law.
_OTHERS: Final = ("dmp", "gp-paper", "gp-paper-tuned")
METHODS: Final = tuple(
    name
    for end in ("", "-tuned")
    for name in (f"{method}{end}" for method in SPACES)
    if name not in _OTHERS
)
"""Methods whose stiffness follows their standard deviation."""
_FIRST_SEED: Final = 1000


def choose(policies: Sequence[str], seeds: int) -> Measurement:
    """Open the doors by each policy with each candidate, and choose."""
    trials = named_trials(["heavy", "radius"])
    rows: dict[str, dict[str, Value]] = {}
    for policy in policies:
        tasks = [
            replace(task, seed=_FIRST_SEED + task.seed)
            for task in trial_tasks(trials, only=(policy,), seeds=seeds)
        ]
        found: dict[float, tuple[int, float]] = {}
        row: dict[str, Value] = {}
        for resolution in CANDIDATES:
            LOG.info("%s opens %d doors, n = %g m", policy, len(tasks), resolution)
            changed = with_resolution(policy_named(policy), resolution)
            logs = opened(tasks, policy=changed)
            peak = statistics.median(np.abs(log.force_radial).max() for log in logs)
            closed = sum(not log.success for log in logs)
            found[resolution] = closed, peak
            row[f"{1e3 * resolution:g} mm"] = f"{closed}; {peak:.1f} N"
        rows[policy] = row | {"doors": len(tasks), "chosen mm": 1e3 * chosen(found)}
    title = f"closed doors and radial force, {seeds} seeds from {_FIRST_SEED}"
    return Measurement(title=title, rows=rows, targets=())


def chosen(found: dict[float, tuple[int, float]]) -> float:
    """Return the value to use, of closed doors and median peak force by value."""
    best = min(found, key=lambda resolution: found[resolution])
    default = CANDIDATES[0]
    return best if found[best][0] < found[default][0] else default


def main(policies: tuple[str, ...] = METHODS, seeds: int = 6) -> None:
    """Choose the resolution of every method; about 25 minutes of one core.

    Args:
        policies: Methods to choose it for.
        seeds: Number of seeds.
    """
    report({"resolution": partial(choose, policies, seeds)})


if __name__ == "__main__":
    tyro.cli(main)
