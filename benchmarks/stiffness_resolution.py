"""Resolution of the stiffness law: python benchmarks/stiffness_resolution.py.

All methods share a controller. Its stiffness is medium at β = √(n s), s the spread of
the demonstrations; the resolution n was chosen on doors that ``gp`` opened. The script
opens the doors of the furniture trials ``heavy`` and ``radius`` with two values of n.
"""

from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
import tyro
from harness import report

from gplfd_experiments.console.progress import LOG
from gplfd_experiments.episodes.build import learned_agents, open_together
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.speed.report import Measurement, Value
from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.method import profile_of_spread

_METHODS: Final = (
    *("gp", "promp", "tp-gmm", "prodmp", "midigap", "kmp", "gmm-gp", "gmr"),
    *("local-gp", "wishart-gp"),
)
_TOGETHER: Final = 20
"""Doors that are opened in lockstep."""


def heavy_and_light(
    policies: Sequence[str], resolutions: Sequence[float], seeds: int
) -> Measurement:
    """Open the doors of two trials by each policy with each resolution [m]."""
    trials = named_trials(["heavy", "radius"])
    rows: dict[str, dict[str, Value]] = {}
    for policy in policies:
        tasks = trial_tasks(trials, only=(policy,), seeds=seeds)
        for resolution in resolutions:
            LOG.info("%s opens %d doors, n = %g m", policy, len(tasks), resolution)
            logs = opened_with(tasks, resolution)
            found: dict[str, Value] = {}
            for trial in trials:
                own = [
                    log
                    for task, log in zip(tasks, logs, strict=True)
                    if task.trial == trial
                ]
                peaks = [np.abs(log.force_radial).max() for log in own]
                found |= {
                    f"{trial}: opened": sum(log.success for log in own),
                    f"{trial}: of": len(own),
                    f"{trial}: radial peak N": float(np.median(peaks)),
                }
            rows[f"{policy}, n = {1e3 * resolution:g} mm"] = found
    return Measurement(title=f"heavy and radius, {seeds} seeds", rows=rows, targets=())


def opened_with(tasks: Sequence[EpisodeTask], resolution: float) -> list[EpisodeLog]:
    """Open the doors of tasks of one policy, whose stiffness law has a resolution."""
    policy = policy_named(tasks[0].policy)
    assert policy.method is not None
    profile = partial(profile_of_spread, resolution=(resolution, 3e-2))
    changed = replace(policy, make=replace(policy.method, profile=profile))
    make = {task.training: learned_agents(task, changed) for task in tasks}
    logs: list[EpisodeLog] = []
    for first in range(0, len(tasks), _TOGETHER):
        some = tasks[first : first + _TOGETHER]
        logs += open_together(some, [make[task.training]() for task in some])
    return logs


def main(
    policies: tuple[str, ...] = _METHODS,
    resolutions: tuple[float, ...] = (1e-4, 1e-3),
    seeds: int = 20,
) -> None:
    """Open heavy and light doors; about a minute per policy.

    Args:
        policies: Which; methods with a standard deviation.
        resolutions: Values of n [m].
        seeds: Seeds of the trials.
    """
    report({"resolution": partial(heavy_and_light, policies, resolutions, seeds)})


if __name__ == "__main__":
    tyro.cli(main)
