"""A study: every policy on every door with every seed, one result file per task.

A task is named by the hash of what defines it, so a study that was interrupted goes on
where it stopped, and one that is finished can be given more seeds, doors or policies
without repeating a task.
"""

from __future__ import annotations

import dataclasses
import hashlib
import itertools
import json
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from experiments.atomic_write import write_json

DEMONSTRATED_RADII: Final = (0.35, 0.50, 0.65)
"""Doors that the synthetic human opens [m]."""


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
    """Run the tasks that have no result yet; yield every result in order.

    Args:
        folder: Results are kept in ``folder/tasks/<key>.json``.
        study: What to run.

    Yields:
        A result per task: ``task`` and either ``metrics`` or, where the task itself
        failed, ``error``.
    """
    for task in study:
        path = folder / "tasks" / f"{task.key}.json"
        if not path.is_file():
            write_json(path, _result(task))
        yield json.loads(path.read_text(encoding="utf-8"))


def _result(task: Task) -> dict[str, Any]:
    definition = dataclasses.asdict(task)
    try:
        return {"task": definition, "metrics": run_task(task)}
    except (ValueError, ArithmeticError) as error:
        # A policy that cannot learn or act is a finding of the study, not its end.
        return {"task": definition, "error": f"{type(error).__name__}: {error}"}


def run_task(task: Task) -> dict[str, Any]:
    """Learn, open the door once, and return the episode's metrics as plain data."""
    import gymnasium as gym
    import numpy as np

    from experiments.metrics import episode_metrics
    from experiments.rollout import rollout
    from experiments.teacher import Teacher
    from gplfd_env import ENVIRONMENT_ID
    from policies.registry import make_agent

    demonstrations = Teacher().demonstrate_doors(
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
    env = gym.make(ENVIRONMENT_ID, door=dict(task.door_config))
    log = rollout(
        env,
        agent,
        policy=task.policy,
        door=task.door,
        door_config=dict(task.door_config),
        seed=task.seed,
    )
    env.close()
    return episode_metrics(log).as_json()
