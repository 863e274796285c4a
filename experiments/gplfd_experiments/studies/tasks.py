"""What a study consists of: episodes and learning tests, each named by its hash."""

import dataclasses
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from gplfd_experiments.episodes.task import EpisodeTask, Task, TaughtTask
from gplfd_experiments.studies.learning_tests.folds import HeldOut

Result = dict[str, Any]
"""What a task came to: the ``format`` and ``format_version`` of the file, ``task``, the
``versions`` and ``git`` of the code that made it, and ``metrics`` or, where the task
failed, ``error``, ``traceback`` and, where the machine failed it, ``lost``."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTask(TaughtTask):
    """What a policy learned, held against demonstrations it did not see; no robot."""

    held_out: HeldOut
    """What the policy does not see."""
    kind: Literal["skill"] = field(default="skill", init=False)
    """What tells it from other tasks in a file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedTask(Task):
    """What a policy learned from recordings, held against the one it did not see.

    The recording with the number `seed` is left out.
    """

    recordings: str
    """Hash of all of them, `gplfd_policies.demonstrations.npz.hash_of`."""
    kind: Literal["recorded"] = field(default="recorded", init=False)
    """What tells it from other tasks in a file."""


Job = tuple[Task, ...]
"""Tasks that one worker runs together: episodes of one policy that learned once, or a
single learning test."""

_KINDS: Final[Mapping[str, type[Task]]] = {
    "episode": EpisodeTask,
    "skill": SkillTask,
    "recorded": RecordedTask,
}


def task_from(record: Mapping[str, Any]) -> Task:
    """Return the task of a result: the inverse of `Task.definition`.

    Raises:
        ValueError: The record is not that of a task.
    """
    fields = dict(record)
    try:
        kind = _KINDS[fields.pop("kind")]
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
    """Group tasks by what they learn from, in the order in which they come.

    What a task comes to does not depend on the others of its job.
    """
    groups: dict[str, dict[str, Task]] = {}
    for task in study:
        groups.setdefault(task.training, {})[task.key] = task
    return tuple(tuple(group.values()) for group in groups.values())
