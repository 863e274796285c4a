"""A study: episodes and learning tests, one result file per task.

A task is named by the hash of what defines it, so a study that was interrupted goes on
where it stopped, and one that is finished can be given more seeds, doors or policies
without repeating a task. A task that failed is tried again. The code is no part of the
name: every result says which code made it, and `made_by_other_code` counts those of
other code.
"""

from __future__ import annotations

import contextlib
import dataclasses
import hashlib
import json
from collections.abc import Generator, Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, Final, Literal

from experiments.atomic_write import write_json
from experiments.provenance import code_state

if TYPE_CHECKING:
    from experiments.engines import Engine

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Doors that the synthetic human opens [m]."""

Result = dict[str, Any]
"""What a task came to: ``task``, the ``versions`` and ``git`` of the code that made it,
and ``metrics`` or, where the task failed, ``error`` and ``traceback``."""

HeldOut = Literal["demonstration", "radius"]
"""What a learning test leaves out: one demonstration of each door, or the middle
door."""


def standard_teacher() -> dict[str, float]:
    """Return the fields of the standard `experiments.teacher.TeacherConfig`."""
    from experiments.teacher import TeacherConfig

    return dataclasses.asdict(TeacherConfig())


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The smallest part of a study; what all kinds of tasks have in common."""

    policy: str
    """Name of the policy."""
    seed: int
    """Seed of teacher, policy and environment."""
    demonstrations_per_door: int = 2
    """How often the teacher opens each of the three demonstrated doors."""
    teacher: Mapping[str, float] = field(default_factory=standard_teacher)
    """Fields of `experiments.teacher.TeacherConfig`."""

    @property
    def key(self) -> str:
        """Hash of everything that defines the task."""
        text = json.dumps(dataclasses.asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTask(Task):
    """One door opened once."""

    door: str
    """Name of the door."""
    door_config: Mapping[str, float]
    """Fields of `gplfd_env.config.DoorConfig`."""
    randomization: str = "none"
    """Name in `gplfd_env.randomization.RANDOMIZATIONS`."""
    kind: Literal["episode"] = field(default="episode", init=False)
    """What tells it from other tasks in a file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTask(Task):
    """What a policy learned, held against demonstrations it did not see; no robot."""

    held_out: HeldOut
    """What the policy does not see."""
    kind: Literal["skill"] = field(default="skill", init=False)
    """What tells it from other tasks in a file."""


Job = tuple[Task, ...]
"""Tasks that one worker runs together: episodes of one policy that learned once, or a
single learning test."""

_KINDS: Final[Mapping[str, type[Task]]] = {"episode": EpisodeTask, "skill": SkillTask}


def task_from(record: Mapping[str, Any]) -> Task:
    """Return the task of a result: the inverse of `dataclasses.asdict`.

    Raises:
        ValueError: The record is not that of a task.
    """
    fields = dict(record)
    try:
        return _KINDS[fields.pop("kind")](**fields)
    except (KeyError, TypeError) as error:
        raise ValueError(f"not a task of a study: {error!r} in {record}") from error


def jobs_of(study: Iterable[Task]) -> tuple[Job, ...]:
    """Group tasks by what they learn from, in the order in which they come.

    What a task comes to does not depend on the others of its job.
    """
    groups: dict[str, dict[str, Task]] = {}
    for task in study:
        definition = dataclasses.asdict(task)
        for name in ("door", "door_config"):
            definition.pop(name, None)
        group = groups.setdefault(json.dumps(definition, sort_keys=True), {})
        group[task.key] = task
    return tuple(tuple(group.values()) for group in groups.values())


def run_study(
    folder: Path, study: Sequence[Task], engine: Engine | None = None
) -> Generator[Result, None, None]:
    """Run the tasks without a result or with an error.

    Only this process writes files; engines bring it the results as small records.

    Args:
        folder: Results are kept in ``folder/tasks/<key>.json``.
        study: What to run.
        engine: Where to run it; in this process if None.

    Yields:
        A result per task that ran, in the order in which they finish, when its file
        is written.
    """
    from experiments.engines import Lost
    from experiments.engines.serial import Serial
    from experiments.study_jobs import failed, run_job

    missing = [task for task in study if not is_finished(stored_result(folder, task))]
    finished = (engine or Serial()).run(run_job, jobs_of(missing))
    # Closed at once when the reader stops, so that no worker outlives an interruption.
    with contextlib.closing(finished):
        for job, outcome in finished:
            results = (
                [failed(task, outcome.reason) for task in job]
                if isinstance(outcome, Lost)
                else outcome
            )
            for task, result in zip(job, results, strict=True):
                write_json(result_path(folder, task), result)
                yield result


def made_by_other_code(folder: Path, study: Iterable[Task]) -> int:
    """Count the results that `run_study` would keep although other code made them.

    Other code is another git commit, a checkout with edits where this one has none or
    the reverse, or other package versions. Two different edits of one commit cannot be
    told apart.
    """
    stored = (stored_result(folder, task) for task in study)
    return sum(
        any(result.get(name) != state for name, state in code_state().items())
        for result in stored
        if result is not None and is_finished(result)
    )


def is_finished(result: Mapping[str, Any] | None) -> bool:
    """Tell whether a result stays: it is there, and no error."""
    return result is not None and "error" not in result


def result_path(folder: Path, task: Task) -> Path:
    """Return where a task's result is kept."""
    return folder / "tasks" / f"{task.key}.json"


def stored_result(folder: Path, task: Task) -> Result | None:
    """Return the result of a task, which may be an error; None if there is none."""
    path = result_path(folder, task)
    if not path.is_file():
        return None
    result: Result = json.loads(path.read_text(encoding="utf-8"))
    return result
