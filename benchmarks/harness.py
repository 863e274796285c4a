"""Shared functions of the scripts in this folder: opening doors, and reporting.

A script has functions that return a `Measurement`. `report` calls them in turn and
prints the code version, the machine, a table of each, and whether the targets are met.
"""

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any, Final

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.episodes.build import learned_agents, open_together
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.speed.machine import load, processor
from gplfd_experiments.speed.report import Measurement, measure_all
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.registry.catalogue import policy_named
from gplfd_policies.registry.policy import Policy

_TOGETHER: Final = 16
"""Number of doors that are opened in lockstep."""


def tasks_of(
    doors: Iterable[DoorConfig], policy: str, **circumstances: Any
) -> list[EpisodeTask]:
    """Return a task for each door; `circumstances` are fields of all tasks."""
    return [
        episode_task(f"{door.radius:g}", door, policy=policy, **circumstances)
        for door in doors
    ]


def opened(
    tasks: Sequence[EpisodeTask],
    given: LabelledDemonstrations | None = None,
    policy: Policy | None = None,
) -> list[EpisodeLog]:
    """Let a policy open doors; it learns once from each set of demonstrations.

    All tasks have the same policy, base and start. Demonstrations that are ``given``
    replace those of the tasks, and a ``policy`` replaces the named one. A log does not
    depend on the other tasks.
    """
    make: dict[str, Callable[[], Any]] = {}
    with warnings.catch_warnings():
        # Warnings about rests and noise of the demonstrations.
        warnings.simplefilter("ignore")
        for task in tasks:
            if task.training_key not in make:
                own = policy or policy_named(task.policy)
                make[task.training_key] = learned_agents(task, own, given)
    logs: list[EpisodeLog] = []
    for first in range(0, len(tasks), _TOGETHER):
        some = tasks[first : first + _TOGETHER]
        logs += open_together(some, [make[task.training_key]() for task in some])
    return logs


def report(measures: Mapping[str, Callable[[], Measurement]]) -> dict[str, Measurement]:
    """Run the measurements in turn; print results, code version and machine."""
    state = code_state()
    versions = ", ".join(f"{name} {one}" for name, one in state["versions"].items())
    git = state["git"] or {"commit": "unknown", "dirty": False}
    changed = ", changed" if git["dirty"] else ""
    print(f"commit {git['commit']}{changed}; {versions}; {processor()}, {load()}\n")
    return measure_all(measures)
