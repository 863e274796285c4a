"""Tasks of a study, each named by its hash: from its settings, grouped in jobs."""

import dataclasses
import itertools
import math
from collections import Counter
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.console.arguments import check_circumstances, check_least
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.episodes.task import (
    EpisodeTask,
    Task,
    TaughtTask,
    episode_task,
    named_doors,
)
from gplfd_experiments.studies.learning_tests.folds import HELD_OUT, HeldOut
from gplfd_experiments.studies.settings import TABLE_1_NAME, Condition, StudySettings
from gplfd_experiments.studies.sources import chosen, policy_fields
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import hash_of
from gplfd_policies.registry.built_in import TABLE_1

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
"""Episodes of policies that share what they learn, or a single learning test."""

_MOST: Final = 100_000  # Largest number of tasks of a study.

TOGETHER: Final = 192
"""Largest number of episodes in lockstep: a step costs little more than of one."""
_LARGEST: Final = 1200
"""Usual largest number of episodes in a job. In larger jobs fewer episodes act alone,
but an interruption loses more: here it is a few minutes."""
SHARED: Final = 24
"""Number of episodes from which two workers share them."""

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
        names = {field.name for field in dataclasses.fields(kind)}
        if unknown := sorted(fields.keys() - names):
            raise ValueError(
                f"not a task of a study: unknown field {unknown[0]!r:.40}; perhaps a "
                "later version of gplfd wrote it"
            )
        return kind(**fields)
    except (KeyError, TypeError) as error:
        reason = f"not a task of a study: {error!r:.100} in {record!r:.200}"
        raise ValueError(reason) from error


def jobs_of(study: Sequence[Task]) -> tuple[Job, ...]:
    """Group tasks that learn and act together; large groups, which take long, first.

    A job has all episodes after some sets of demonstrations, by the policies that
    differ in their pipeline only. Usually it has at most an eighth of a large study.
    """
    most = min(max(TOGETHER, len(study) // 8), _LARGEST)
    groups: dict[str, dict[str, dict[str, Task]]] = {}
    for task in study:
        learner, lesson = task.training_key, ""
        if isinstance(task, EpisodeTask):
            learner, lesson = task.learner_key, task.demonstrations_key
        lessons = groups.setdefault(learner, {})
        lessons.setdefault(lesson, {})[task.key] = task
    jobs: list[Job] = []
    for lessons in groups.values():
        total, done = sum(map(len, lessons.values())), 0
        number = max(math.ceil(total / most), min(2, total // SHARED))
        shares: list[list[Task]] = [[] for _ in range(number)]
        for tasks in lessons.values():
            # By the middle of a lesson, so that the shares are about equal.
            shares[(2 * done + len(tasks)) * number // (2 * total)] += tasks.values()
            done += len(tasks)
        jobs += [tuple(share) for share in shares if share]
    return tuple(sorted(jobs, key=len, reverse=True))


_NOISY: Final = (
    *("wobble_position_std", "wobble_rotation_std", "grasp_offset_std"),
    *("vertical_drift_std", "noise_position_std", "noise_rotation_std"),
)
"""Fields of `data.teacher.TeacherConfig` that the noise level multiplies."""


def checked(settings: StudySettings) -> StudySettings:
    """Return the settings with every name resolved and all values within range."""
    settings = dataclasses.replace(settings, policies=_policies(settings.policies))
    for policy in settings.policies:
        chosen(policy)
    named_doors(settings.doors, start=settings.start, robot=settings.robot)
    for names in itertools.product(settings.randomizations, settings.disturbances):
        check_circumstances(*names, settings.start)
    for name, values in dataclasses.asdict(settings).items():
        if isinstance(values, tuple):
            _check_list(name.replace("_", "-"), values)
    check_least("--seeds", settings.seeds, 1)
    for number in settings.demonstrations_per_door:
        # Exact Gaussian processes of more demonstrations take hours.
        check_least("--demonstrations-per-door", number, 1, 1000)
    for noise in settings.teacher_noise:
        check_least("--teacher-noise", noise, 0, 20)
    teachings = len(settings.demonstrations_per_door) * len(settings.teacher_noise)
    number = len(settings.doors) * len(list(conditions(settings)))
    number += settings.skill * len(HELD_OUT) * teachings
    number *= settings.seeds * len(settings.policies)
    if number > _MOST:
        raise ValueError(
            f"{number:,} tasks are more than the {_MOST:,} of a study: give fewer "
            "--seeds, --policies or --doors"
        )
    return settings


def tasks(settings: StudySettings) -> tuple[Task, ...]:
    """Return all tasks of a study; the seed varies slowest, so any part is comparable.

    Learning tests are of furniture doors; a study without such a door has none.
    """
    doors = named_doors(
        settings.doors, start=settings.start, robot=settings.robot
    ).values()
    furniture = any(door.kind == DoorConfig().kind for door in doors)
    study: list[Task] = []
    for seed in range(settings.seeds):
        for condition in conditions(settings):
            study += episodes(settings, condition, [seed])
        study += [
            SkillTask(
                **policy_fields(policy),
                seed=seed,
                demonstrations_per_door=number,
                teacher=noisy_teacher(noise),
                demonstrated_forces=settings.demonstrated_forces,
                held_out=left_out,
            )
            for number, noise, policy, left_out in itertools.product(
                settings.demonstrations_per_door,
                settings.teacher_noise,
                [policy for policy in settings.policies if chosen(policy).learns],
                HELD_OUT if settings.skill and furniture else (),
            )
        ]
    return tuple(study)


def conditions(settings: StudySettings) -> Iterator[Condition]:
    """Yield the conditions of a study."""
    alike = ("start", "demonstrated_forces", "robot")
    fields: dict[str, Any] = {name: getattr(settings, name) for name in alike}
    taught = settings.demonstrations_per_door, settings.teacher_noise
    drawn = settings.randomizations, settings.disturbances
    names = ("demonstrations_per_door", "teacher_noise", "randomization", "disturbance")
    for values in itertools.product(*taught, *drawn):
        varied: dict[str, Any] = dict(zip(names, values, strict=True))
        yield Condition(**fields, **varied)


def episodes(
    settings: StudySettings, condition: Condition, seeds: Sequence[int]
) -> Iterator[EpisodeTask]:
    """Yield policies × doors × seeds under one condition; the seed varies slowest."""
    doors = named_doors(settings.doors, start=settings.start, robot=settings.robot)
    fields = dataclasses.asdict(condition)
    teacher = noisy_teacher(fields.pop("teacher_noise"))
    for seed, policy, door in itertools.product(seeds, settings.policies, doors):
        yield episode_task(
            door,
            doors[door],
            **policy_fields(policy),
            seed=seed,
            teacher=teacher,
            **fields,
        )


def noisy_teacher(level: float) -> dict[str, float]:
    """Return the standard teacher with its noise multiplied by a level."""
    teacher = standard_teacher()
    return teacher | {name: level * teacher[name] for name in _NOISY}


def recorded_tasks(
    policies: Sequence[str], recordings: Sequence[Demonstration]
) -> tuple[RecordedTask, ...]:
    """Return the leave-one-out tests of methods, or groups of them, on recordings."""
    names = _policies(policies)
    _check_list("policies", names)
    for name in names:
        if not chosen(name).learns:
            raise ValueError(
                f"policy {name!r} learns no movement, so there is nothing to test; see "
                "`gplfd list`"
            )
    identity = hash_of(recordings)
    return tuple(
        RecordedTask(**policy_fields(name), seed=number, recordings=identity)
        for number, name in itertools.product(range(len(recordings)), names)
    )


def _policies(names: Sequence[str]) -> tuple[str, ...]:
    """Replace names of groups of policies by their members."""
    policies: list[str] = []
    for name in names:
        group, at, pipeline = name.partition("@")
        members = TABLE_1 if group == TABLE_1_NAME else (group,)
        policies += [f"{member}{at}{pipeline}" for member in members]
    return tuple(policies)


def _check_list(option: str, values: Sequence[object]) -> None:
    if not values:
        raise ValueError(f"--{option} needs at least one value")
    value, times = Counter(values).most_common(1)[0]
    if times > 1:
        raise ValueError(f"{value} is given twice in --{option}")
