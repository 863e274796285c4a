"""Who should be soft, set-point or arm: python benchmarks/renderings.py.

Opens doors, undisturbed and in trials, with policies that differ in what renders the
stiffness, and prints how they fare, seed by seed on the same doors.
"""

import statistics
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Final

import tyro

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import EpisodeMetrics, episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask
from gplfd_experiments.speed.report import Measurement, Value, at_least, measure_all
from gplfd_experiments.studies.jobs import episode_logs
from gplfd_experiments.studies.tasks import jobs_of
from gplfd_experiments.studies.trials.plan import trial_tasks
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.studies.trials.records import Level, Trial

POLICIES: Final = ("gp", "gp-impedance")
"""What is compared: the same method, rendered by virtual dynamics and by the arm."""
JUDGED: Final = ("person", "stop", "heavy", "push", "delay", "locked")
"""Trials of what the rendering decides."""

_ORDINARY: Final = "ordinary"
_DOORS: Final = ("small", "medium", "large")
_NO_TRIAL: Final = Trial(
    question="Are doors opened on which nothing is tried?",
    claims=(),
    measures=("success", "force_radial_peak"),
    levels={
        "none": Level(doors=_DOORS),
        "hard": Level(doors=_DOORS, randomization="hard"),
    },
)

_MEASURES: Final[Mapping[str, Callable[[EpisodeMetrics], float | None]]] = {
    "angle [deg]": lambda one: one.final_angle_deg,
    "radial [N]": lambda one: one.force_radial_peak,
    "handle [N]": lambda one: one.force_handle_peak,
    "person [N]": lambda one: one.person_force_peak or None,
    "stop, sustained [N]": lambda one: one.stop_force_sustained or None,
    "pushed by [mm]": lambda one: one.push_displacement_mm,
    "released at [rad/s]": lambda one: one.release_speed,
    "slip [mm]": lambda one: one.slip_max_mm,
    "k_x least [N/m]": lambda one: one.stiffness_min[0] if one.stiffness_min else None,
}
"""Medians over episodes; nothing where nothing of it happened."""


def summary(logs: Sequence[EpisodeLog]) -> dict[str, Value]:
    """Return how many doors were opened, how many grasps kept, and the medians."""
    every = [episode_metrics(log) for log in logs]
    kept = sum(log.failure != "grasp_lost" for log in logs)
    row: dict[str, Value] = {
        "opened": f"{sum(one.success for one in every)}/{len(every)}",
        "kept": f"{kept}/{len(every)}",
    }
    for name, measure in _MEASURES.items():
        found = [value for one in every if (value := measure(one)) is not None]
        row[name] = statistics.median(found) if found else None
    return row


def compare(
    seeds: int, trials: Sequence[str] = JUDGED, policies: Sequence[str] = POLICIES
) -> Measurement:
    """Open undisturbed doors, and those of some trials, with every policy.

    Args:
        seeds: How many, from 0.
        trials: Names of trials.
        policies: Names of policies.
    """
    conditions = {_ORDINARY: _NO_TRIAL} | {name: TRIALS[name] for name in trials}
    planned = trial_tasks(conditions, policies=policies)
    tasks = [one for one in planned if one.policy in policies and one.seed < seeds]
    found: dict[tuple[str, str, str], list[EpisodeLog]] = {
        (name, level, policy): []
        for name, trial in conditions.items()
        for level in trial.levels
        for policy in policies
    }
    for job in jobs_of(tasks):
        episodes = [one for one in job if isinstance(one, EpisodeTask)]
        for task, log in zip(episodes, episode_logs(episodes), strict=True):
            found[task.trial, task.level, task.policy].append(log)
    return Measurement(
        title=f"medians of {seeds} seeds",
        rows={
            f"{name}, {level}: {policy}": summary(logs)
            for (name, level, policy), logs in found.items()
        },
        targets=tuple(
            at_least(f"undisturbed doors opened by {policy}", _opened(logs), 1.0)
            for (name, level, policy), logs in found.items()
            if (name, level) == (_ORDINARY, "none")
        ),
    )


def _opened(logs: Sequence[EpisodeLog]) -> float:
    return statistics.mean(log.success for log in logs)


def main(seeds: int = 4, trials: tuple[str, ...] = JUDGED) -> None:
    """Compare renderings of one method's stiffness.

    Args:
        seeds: How many, from 0.
        trials: Trials that are run beside the undisturbed doors.
    """
    measure_all({"renderings": partial(compare, trials=trials)}, seeds)


if __name__ == "__main__":
    tyro.cli(main)
