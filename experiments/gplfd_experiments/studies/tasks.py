"""Tasks of a study: episodes and learning tests, each named by its hash."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from gplfd_experiments.episodes.task import EpisodeTask, Task, TaughtTask
from gplfd_experiments.studies.learning_tests.folds import HeldOut

Result = dict[str, Any]
"""Result of a task: ``format`` and ``format_version`` of the file, ``task``, the
``versions`` and ``git`` of the code that made it, and ``metrics``; or ``error``,
``traceback`` and, where the machine caused the error, ``lost``."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTask(TaughtTask):
    """Prediction of left-out demonstrations, without a robot."""

    held_out: HeldOut
    kind: Literal["skill"] = field(default="skill", init=False)


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedTask(Task):
    """Leave-one-out test on the user's motion files: number `seed` is left out."""

    recordings: str
    """Hash of all motion files, `gplfd_policies.demonstrations.npz.hash_of`."""
    kind: Literal["recorded"] = field(default="recorded", init=False)


Job = tuple[Task, ...]
"""Episodes of one policy that are opened in lockstep, or a single learning test."""

TOGETHER: Final = 12
"""Largest number of episodes in a job of several trainings."""

KINDS: Final[Mapping[str, type[Task]]] = {
    "episode": EpisodeTask,
    "skill": SkillTask,
    "recorded": RecordedTask,
}


def task_from(record: Mapping[str, Any]) -> Task:
    """Return the task of a result: the inverse of `Task.definition`."""
    fields = dict(record)
    try:
        kind = KINDS[fields.pop("kind")]
        known = {field.name for field in dataclasses.fields(kind)}
        if unknown := sorted(fields.keys() - known):
            raise ValueError(
                f"not a task of a study: unknown field {unknown[0]!r:.40}; perhaps a "
                "later version of gplfd wrote it"
            )
        return kind(**fields)
    except (KeyError, TypeError) as error:
        reason = f"not a task of a study: {error!r:.100} in {record!r:.200}"
        raise ValueError(reason) from error


def jobs_of(study: Iterable[Task]) -> tuple[Job, ...]:
    """Group tasks that learn and act together, in their given order.

    Tasks with one training are in one job, and so are, up to `TOGETHER` episodes,
    several trainings of a policy whose agents compute their steps together. The result
    of a task does not depend on the others of its job.
    """
    trainings: dict[str, dict[str, Task]] = {}
    for task in study:
        trainings.setdefault(task.training_key, {})[task.key] = task
    jobs: list[list[Task]] = []
    open_jobs: dict[str, list[Task]] = {}
    for tasks in trainings.values():
        first = next(iter(tasks.values()))
        alike = first.lockstep_key if isinstance(first, EpisodeTask) else None
        job = open_jobs.get(alike or "")
        if job is None or len(job) + len(tasks) > TOGETHER:
            job = []
            jobs.append(job)
            if alike is not None:
                open_jobs[alike] = job
        job += tasks.values()
    return tuple(map(tuple, jobs))
