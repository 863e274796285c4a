"""What a study compares: settings that a person writes, tasks that follow from them."""

from __future__ import annotations

import dataclasses
import itertools
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final, get_args

from experiments.study import EpisodeTask, HeldOut, SkillTask, Task, standard_teacher

TABLE_1_NAME: Final = "table-1"
"""Stands for the policies of the paper's Table 1 where policies are named."""

_NOISY: Final = (
    *("wobble_position_std", "wobble_rotation_std", "grasp_offset_std"),
    *("vertical_drift_std", "noise_position_std", "noise_rotation_std"),
)
"""Fields of `experiments.teacher.TeacherConfig` that the noise level multiplies."""

_LARGEST_NOISE: Final = 20.0


@dataclass(frozen=True, kw_only=True, slots=True)
class StudySettings:
    """Everything that says which tasks a study has."""

    policies: tuple[str, ...] = (TABLE_1_NAME,)
    """Policies to compare; see `gplfd list`. "table-1" stands for the nine of the
    paper's Table 1."""

    doors: tuple[str, ...] = (
        *("small", "medium", "large"),
        *("0.3", "0.42", "0.58", "0.62"),
    )
    """Doors to open: names (see `gplfd list`) or radii in metres. Small, medium and
    large (0.35, 0.50, 0.65) are demonstrated."""

    seeds: int = 20
    """Number of seeds: 0, 1, ... Each has demonstrations of its own."""

    demonstrations_per_door: tuple[int, ...] = (2,)
    """How often the synthetic human opens each of the three demonstrated doors."""

    teacher_noise: tuple[float, ...] = (1.0,)
    """Noise levels of the synthetic human: multiples of its standard wobble, grasp
    offset, drift and sensor noise."""

    randomizations: tuple[str, ...] = ("none",)
    """What varies from episode to episode: none, mild or hard."""

    skill: bool = True
    """Also hold what is learned against demonstrations left out, without a robot."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Condition:
    """What all policies, doors and seeds of one table have in common."""

    demonstrations_per_door: int
    """How often the teacher opens each demonstrated door."""
    teacher_noise: float
    """Multiple of the teacher's standard noise."""
    randomization: str
    """What varies from episode to episode."""

    def __str__(self) -> str:
        return (
            f"{self.demonstrations_per_door} demonstrations per door, teacher noise "
            f"× {self.teacher_noise:g}, randomization {self.randomization}"
        )


def checked(settings: StudySettings) -> StudySettings:
    """Return the settings with every name resolved.

    Raises:
        ValueError: A name is unknown or given twice, a number out of range, or nothing
            is left to do.
    """
    from experiments.commands.run import named_doors
    from gplfd_env.randomization import door_randomization
    from policies.registry import policy_named

    settings = dataclasses.replace(settings, policies=_policies(settings.policies))
    for policy in settings.policies:
        policy_named(policy)
    named_doors(settings.doors)
    for name in settings.randomizations:
        door_randomization(name)
    for field in dataclasses.fields(settings):
        values = getattr(settings, field.name)
        if isinstance(values, tuple):
            _check_list(field.name.replace("_", "-"), values)
    _check_range("seeds", [settings.seeds], 1, math.inf)
    _check_range(
        "demonstrations-per-door", settings.demonstrations_per_door, 1, math.inf
    )
    _check_range("teacher-noise", settings.teacher_noise, 0.0, _LARGEST_NOISE)
    return settings


def _policies(names: Sequence[str]) -> tuple[str, ...]:
    if TABLE_1_NAME not in names:
        return tuple(names)
    from policies.registry import TABLE_1

    return tuple(
        policy
        for name in names
        for policy in (TABLE_1 if name == TABLE_1_NAME else (name,))
    )


def _check_list(option: str, values: Sequence[object]) -> None:
    if not values:
        raise ValueError(f"--{option} needs at least one value")
    for value in values:
        if values.count(value) > 1:
            raise ValueError(f"{value} is given twice in --{option}")


def _check_range(option: str, values: Sequence[float], low: float, high: float) -> None:
    for value in values:
        if not low <= value <= high:
            allowed = f"{low:g} or more" if high == math.inf else f"{low:g} to {high:g}"
            raise ValueError(f"--{option} {value} must be {allowed}")


def conditions(settings: StudySettings) -> Iterator[Condition]:
    """Yield what is varied besides policies, doors and seeds."""
    for number, noise, randomization in itertools.product(
        settings.demonstrations_per_door,
        settings.teacher_noise,
        settings.randomizations,
    ):
        yield Condition(
            demonstrations_per_door=number,
            teacher_noise=noise,
            randomization=randomization,
        )


def episodes(
    settings: StudySettings, condition: Condition, seeds: Sequence[int]
) -> Iterator[EpisodeTask]:
    """Yield policies × doors × seeds under one condition, the seed slowest."""
    from experiments.commands.run import named_doors

    doors = named_doors(settings.doors)
    teacher = noisy_teacher(condition.teacher_noise)
    for seed, policy, door in itertools.product(seeds, settings.policies, doors):
        yield EpisodeTask(
            policy=policy,
            door=door,
            door_config=dataclasses.asdict(doors[door]),
            seed=seed,
            demonstrations_per_door=condition.demonstrations_per_door,
            teacher=teacher,
            randomization=condition.randomization,
        )


def learning_tests(settings: StudySettings, seed: int) -> Iterator[SkillTask]:
    """Yield the tests of what is learned, of policies that learn."""
    from policies.registry import policy_named

    held_out: tuple[HeldOut, ...] = get_args(HeldOut)
    for number, noise, policy, left_out in itertools.product(
        settings.demonstrations_per_door,
        settings.teacher_noise,
        settings.policies,
        held_out,
    ):
        if policy_named(policy).method is not None:
            yield SkillTask(
                policy=policy,
                seed=seed,
                demonstrations_per_door=number,
                teacher=noisy_teacher(noise),
                held_out=left_out,
            )


def tasks(settings: StudySettings) -> tuple[Task, ...]:
    """Return all tasks of a study; seed after seed, so that any part compares all."""

    def each() -> Iterator[Task]:
        for seed in range(settings.seeds):
            for condition in conditions(settings):
                yield from episodes(settings, condition, [seed])
            if settings.skill:
                yield from learning_tests(settings, seed)

    return tuple(each())


def noisy_teacher(level: float) -> dict[str, float]:
    """Return the standard teacher with its noise multiplied by a level."""
    teacher = standard_teacher()
    return teacher | {name: level * teacher[name] for name in _NOISY}


PRESETS: Final[Mapping[str, StudySettings]] = MappingProxyType(
    {
        TABLE_1_NAME: StudySettings(),
        "small": StudySettings(
            policies=("promp", "gp-fixed", "gp"),
            doors=("small", "medium", "large"),
            seeds=3,
        ),
    }
)
"""Studies by name: the whole comparison, and one of two minutes."""
