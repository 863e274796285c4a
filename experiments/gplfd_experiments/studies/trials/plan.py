"""Makes the tasks of trials: policies × levels × doors × seeds."""

import itertools
from collections.abc import Sequence
from typing import Any

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.data.teacher import standard_teacher
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.studies.sources import chosen, policy_fields
from gplfd_experiments.studies.trials.protocol import PARTS, TRIALS, TUNED, ProtocolPart
from gplfd_experiments.studies.trials.records import Trial


def named_trials(
    names: Sequence[str], part: ProtocolPart = "whole"
) -> dict[str, Trial]:
    """Return trials by name; without names, all trials of a part of the protocol."""
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
    part: ProtocolPart = "whole",
    only: Sequence[str] = (),
    seeds: int | None = None,
    robot: str = "tiago-like",
) -> tuple[EpisodeTask, ...]:
    """Return the episodes of trials; the seed varies slowest.

    ``only`` replaces the policies, without levels in which one of them cannot take
    part. ``seeds`` replaces the number of seeds of the part. Another `robot` opens the
    same doors.
    """
    plan = PARTS[part]
    tuned = TUNED if part == "whole" else ()
    doors = {
        (name, title): {
            door: config.replaced(level.door)
            for door, config in named_doors(level.doors, robot=robot).items()
        }
        for name, trial in trials.items()
        for title, level in trial.levels.items()
    }
    tasks: list[EpisodeTask] = []
    numbers = range(plan.seeds if seeds is None else seeds)
    for seed, (name, trial) in itertools.product(numbers, trials.items()):
        variants = plan.variants.get(name, trial.own)
        everywhere: Sequence[str] = plan.everywhere
        if part == "whole" and trial.only_policies:
            everywhere = trial.only_policies
        competing = (*everywhere, *variants, *(tuned if trial.tuned else ()), *policies)
        every = dict.fromkeys(only or competing)
        for policy, (title, level) in itertools.product(every, trial.levels.items()):
            rivals = [chosen(rival) for rival in only or (policy,)]
            methods = [rival.method for rival in rivals]
            if level.prior_radius is not None and not all(
                method and method.accepts_prior_mean for method in methods
            ):
                continue
            if level.corrections and not all(rival.correctable for rival in rivals):
                continue
            opened = doors[name, title]
            fields: dict[str, Any] = {}
            if level.demonstrated_radii is not None:
                fields["demonstrated_radii"] = level.demonstrated_radii
                fields["demonstrated_hardware"] = level.demonstrated_hardware
            if level.demonstrated_kind is not None:
                fields["demonstrated_kind"] = level.demonstrated_kind
            if level.corrections:
                fields["practice"] = {
                    "corrections": level.corrections,
                    "doors": [config.as_dict() for config in opened.values()],
                    "randomization": level.randomization,
                    "demonstrated": level.demonstrated,
                }
            tasks += [
                episode_task(
                    door,
                    config,
                    **policy_fields(policy),
                    seed=seed,
                    demonstrations_per_door=level.demonstrations_per_door,
                    teacher=standard_teacher() | dict(level.teacher),
                    randomization=level.randomization,
                    disturbance=level.disturbance,
                    start=level.start,
                    robot=robot,
                    habits=level.habits,
                    demonstrated_forces=level.demonstrated_forces,
                    prior_radius=level.prior_radius,
                    trial=name,
                    level=title,
                    **fields,
                )
                for door, config in opened.items()
            ]
    return tuple(tasks)
