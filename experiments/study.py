"""A study: every policy on every door with every seed, one result file per task.

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
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from experiments.atomic_write import write_json
from experiments.provenance import code_state

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Doors that the synthetic human opens [m]."""


def _standard_teacher() -> dict[str, float]:
    from experiments.teacher import TeacherConfig

    return dataclasses.asdict(TeacherConfig())


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """One episode of a study."""

    policy: str
    """Name of the policy."""
    door: str
    """Name of the door."""
    door_config: Mapping[str, float]
    """Fields of `gplfd_env.config.DoorConfig`."""
    seed: int
    """Seed of teacher, policy and environment."""
    demonstrations_per_door: int = 2
    """How often the teacher opens each of the three demonstrated doors."""
    teacher: Mapping[str, float] = field(default_factory=_standard_teacher)
    """Fields of `experiments.teacher.TeacherConfig`."""

    @property
    def key(self) -> str:
        """Hash of everything that defines the task."""
        text = json.dumps(dataclasses.asdict(self), sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


def tasks(
    policies: Sequence[str],
    doors: Mapping[str, Mapping[str, float]],
    seeds: Sequence[int],
    demonstrations_per_door: int = 2,
) -> tuple[Task, ...]:
    """Return policies × doors × seeds, the seed running slowest."""
    return tuple(
        Task(
            policy=policy,
            door=door,
            door_config=dict(doors[door]),
            seed=seed,
            demonstrations_per_door=demonstrations_per_door,
        )
        for seed, policy, door in itertools.product(seeds, policies, doors)
    )


def run_study(folder: Path, study: Sequence[Task]) -> Iterator[Mapping[str, Any]]:
    """Run the tasks without a result or with an error; yield all results in order.

    Args:
        folder: Results are kept in ``folder/tasks/<key>.json``.
        study: What to run.

    Yields:
        A result per task: ``task``, the ``versions`` and ``git`` of the code that made
        it, and either ``metrics`` or, where the task itself failed, ``error``.
    """
    for task in study:
        kept = _kept_result(folder, task)
        if kept is None:
            write_json(_path(folder, task), _result(task))
            kept = _stored(folder, task)
        yield kept


def made_by_other_code(folder: Path, study: Sequence[Task]) -> int:
    """Count the results that `run_study` would keep although other code made them.

    Other code is another git commit, a checkout with edits where this one has none or
    the reverse, or other package versions. Two different edits of one commit cannot be
    told apart.
    """
    kept = (_kept_result(folder, task) for task in study)
    return sum(
        any(result.get(name) != state for name, state in code_state().items())
        for result in kept
        if result is not None
    )


def _path(folder: Path, task: Task) -> Path:
    return folder / "tasks" / f"{task.key}.json"


def _stored(folder: Path, task: Task) -> dict[str, Any]:
    result: dict[str, Any] = json.loads(_path(folder, task).read_text(encoding="utf-8"))
    return result


def _kept_result(folder: Path, task: Task) -> dict[str, Any] | None:
    """Return the stored result unless it is missing or an error."""
    if not _path(folder, task).is_file():
        return None
    result = _stored(folder, task)
    return None if "error" in result else result


def _result(task: Task) -> dict[str, Any]:
    origin = {"task": dataclasses.asdict(task), **code_state()}
    try:
        return {**origin, "metrics": run_task(task)}
    except (ValueError, ArithmeticError) as error:
        # A policy that cannot learn or act is a finding of the study, not its end.
        return {**origin, "error": f"{type(error).__name__}: {error}"}


def run_task(task: Task) -> dict[str, Any]:
    """Learn, open the door once, and return the episode's metrics as plain data."""
    import gymnasium as gym
    import numpy as np

    from experiments.metrics import episode_metrics
    from experiments.rollout import rollout
    from experiments.teacher import Teacher, TeacherConfig
    from gplfd_env import ENVIRONMENT_ID
    from policies.registry import make_agent

    teacher = Teacher(TeacherConfig(**task.teacher))
    demonstrations = teacher.demonstrate_doors(
        DEMONSTRATED_RADII,
        task.demonstrations_per_door,
        rng=np.random.default_rng(task.seed),
    )
    agent = make_agent(
        task.policy,
        demonstrations,
        seed=task.seed,
        radius=task.door_config["radius"],
    )
    door_config = dict(task.door_config)
    with contextlib.closing(gym.make(ENVIRONMENT_ID, door=door_config)) as env:
        log = rollout(
            env,
            agent,
            policy=task.policy,
            door=task.door,
            door_config=door_config,
            seed=task.seed,
        )
    return episode_metrics(log).as_json()
