"""From trials to their tasks: policies × levels × doors × seeds."""

import dataclasses
import itertools
from collections.abc import Iterator, Sequence

from gplfd_env.doors.config import DoorConfig
from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.episodes.doors import named_doors
from gplfd_experiments.episodes.task import EpisodeTask, episode_task
from gplfd_experiments.studies.sources import chosen, source_of
from gplfd_experiments.studies.trials.protocol import PARTS, TRIALS, TUNED, Part
from gplfd_experiments.studies.trials.records import Level, Trial


def named_trials(names: Sequence[str], part: Part = "whole") -> dict[str, Trial]:
    """Return trials by name; without a name all that a part of the protocol has.

    Raises:
        ValueError: An unknown name, or one given twice.
    """
    for name in names:
        if name not in TRIALS:
            raise ValueError(
                f"unknown trial {name!r}{nearest_name(name, TRIALS)}; trials: "
                f"{', '.join(TRIALS)}"
            )
        if list(names).count(name) > 1:
            raise ValueError(f"trial {name} is given twice")
    return {name: TRIALS[name] for name in names or PARTS[part].variants or TRIALS}


def trial_tasks(
    trials: dict[str, Trial],
    *,
    policies: Sequence[str] = (),
    part: Part = "whole",
) -> tuple[EpisodeTask, ...]:
    """Return the episodes of trials; seed after seed, so that any part compares all.

    Args:
        trials: By name.
        policies: Names of policies that take part in every trial beside the protocol's.
        part: Of the protocol.

    Raises:
        ValueError: An unknown policy.
    """
    plan = PARTS[part]
    tuned = TUNED if part == "whole" else ()
    return tuple(
        task
        for seed, (name, trial) in itertools.product(range(plan.seeds), trials.items())
        for policy in dict.fromkeys(
            (
                *plan.everywhere,
                *plan.variants.get(name, trial.also),
                *(tuned if trial.tuned else ()),
                *policies,
            )
        )
        for task in _tasks(name, trial, policy, seed)
    )


def _tasks(name: str, trial: Trial, policy: str, seed: int) -> Iterator[EpisodeTask]:
    for title, level in trial.levels.items():
        if level.prior_radius is not None and not _takes_prior_mean(policy):
            continue
        for door, config in _doors(level).items():
            yield episode_task(
                door,
                config,
                policy=policy,
                policy_source=source_of(chosen(policy)),
                seed=seed,
                demonstrations_per_door=level.demonstrations_per_door,
                teacher=standard_teacher() | dict(level.teacher),
                randomization=level.randomization,
                disturbance=level.disturbance,
                demonstrated_radii=level.demonstrated_radii,
                habits=level.habits,
                prior_radius=level.prior_radius,
                trial=name,
                level=title,
            )


def _takes_prior_mean(policy: str) -> bool:
    method = chosen(policy).method
    return method is not None and method.accepts_prior_mean


def _doors(level: Level) -> dict[str, DoorConfig]:
    return {
        name: dataclasses.replace(config, **level.door)
        for name, config in named_doors(level.doors).items()
    }
