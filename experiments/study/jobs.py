"""What a worker does with a job: learn once, open all its doors in lockstep."""

from __future__ import annotations

import contextlib
import dataclasses
import json
import math
import numbers
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final, TypeVar

import gymnasium as gym
import numpy as np
from threadpoolctl import threadpool_limits

from experiments.episodes.agents import learned
from experiments.episodes.log import EpisodeLog
from experiments.episodes.metrics import episode_metrics
from experiments.episodes.rollouts import rollouts
from experiments.files.provenance import code_state
from experiments.learning_tests.methods import method_named
from experiments.learning_tests.scores import method_metrics
from experiments.study.tasks import EpisodeTask, Job, Result, SkillTask, Task
from experiments.teacher import DEMONSTRATED_RADII, Teacher, TeacherConfig
from gplfd_env import ENVIRONMENT_ID
from policies.agent import Agent
from policies.lockstep import batch_agents
from policies.method import TrainingInput
from policies.registry import policy_named

FORECAST_PERIOD: Final = 0.05
"""Simulated time between forecasts [s]: at most a degree of a demonstrated opening."""

TaskT = TypeVar("TaskT", bound=Task)


def run_job(job: Job) -> list[Result]:
    """Return a result per task; whatever goes wrong in a task is its result.

    BLAS runs on one thread, for the same sums in the same order everywhere.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        episodes = [task for task in job if isinstance(task, EpisodeTask)]
        results = dict(
            zip(
                (task.key for task in episodes), _episode_results(episodes), strict=True
            )
        )
        for task in job:
            if isinstance(task, SkillTask):
                results[task.key] = _attempt([task], _skill_metrics)[0]
    return [results[task.key] for task in job]


def failed(task: Task, reason: str, trace: str = "") -> Result:
    """Return the result of a task that came to nothing.

    Args:
        task: Which.
        reason: Why, in a sentence.
        trace: Where in the code; "" when the worker is gone.
    """
    return {**_origin(task), "error": reason, "traceback": trace}


def episode_logs(tasks: Sequence[EpisodeTask]) -> tuple[EpisodeLog, ...]:
    """Learn once and open the doors of these tasks.

    Args:
        tasks: Differ in their doors only; at least one.

    Returns:
        The logs from which the tasks' metrics come.
    """
    return _open(tasks, _learned(tasks[0]))


def _origin(task: Task) -> Result:
    return {"task": dataclasses.asdict(task), **code_state()}


def _attempt(
    tasks: Sequence[TaskT],
    measure: Callable[[Sequence[TaskT]], Sequence[Mapping[str, Any]]],
) -> list[Result]:
    """Measure some tasks; the same error for all of them if it fails."""
    try:
        return [
            {**_origin(task), "metrics": _plain(metrics)}
            for task, metrics in zip(tasks, measure(tasks), strict=True)
        ]
    # Anything: a policy that cannot learn or act is a finding of the study, and one
    # with a mistake in its code must not take the other policies' results along.
    except Exception as error:
        reason, trace = f"{type(error).__name__}: {error}", traceback.format_exc()
        return [failed(task, reason, trace) for task in tasks]


def _episode_results(tasks: Sequence[EpisodeTask]) -> list[Result]:
    if not tasks:
        return []
    try:
        agent_for = _learned(tasks[0])
    except Exception as error:
        reason, trace = f"{type(error).__name__}: {error}", traceback.format_exc()
        return [failed(task, reason, trace) for task in tasks]

    def measure(some: Sequence[EpisodeTask]) -> list[dict[str, Any]]:
        return _episode_metrics(some, agent_for)

    results = _attempt(tasks, measure)
    if len(tasks) > 1 and "error" in results[0]:
        # One door's error ends the lockstep of all: alone, the others are measured.
        results = [_attempt([task], measure)[0] for task in tasks]
    return results


def _episode_metrics(
    tasks: Sequence[EpisodeTask], agent_for: Callable[[float], Agent]
) -> list[dict[str, Any]]:
    return [
        episode_metrics(log, demonstrated_angle=task.teacher["angle_mean"]).as_json()
        for task, log in zip(tasks, _open(tasks, agent_for), strict=True)
    ]


def _skill_metrics(tasks: Sequence[SkillTask]) -> list[Mapping[str, Any]]:
    return [
        method_metrics(
            method_named(task.policy),
            seed=task.seed,
            demonstrations_per_door=task.demonstrations_per_door,
            teacher=task.teacher,
            held_out=task.held_out,
        )
        for task in tasks
    ]


def _learned(task: EpisodeTask) -> Callable[[float], Agent]:
    """Learn the task's policy; return what makes an agent for a door's radius [m]."""
    training = TrainingInput(
        demonstrations=Teacher(TeacherConfig(**task.teacher)).demonstrate_doors(
            DEMONSTRATED_RADII,
            task.demonstrations_per_door,
            rng=np.random.default_rng(task.seed),
        ),
        seed=task.seed,
    )
    return learned(policy_named(task.policy), training)


def _open(
    tasks: Sequence[EpisodeTask], agent_for: Callable[[float], Agent]
) -> tuple[EpisodeLog, ...]:
    agents = [agent_for(task.door_config["radius"]) for task in tasks]
    envs: Any = gym.make_vec(
        ENVIRONMENT_ID,
        num_envs=len(tasks),
        door=[dict(task.door_config) for task in tasks],
        randomization=tasks[0].randomization,
        autoreset_mode="Disabled",
        num_threads=1,
    )
    with contextlib.closing(envs):
        return rollouts(
            envs,
            batch_agents(agents),
            policy=tasks[0].policy,
            doors=[task.door for task in tasks],
            seeds=[task.seed for task in tasks],
            forecast_period=FORECAST_PERIOD,
        )


def _plain(value: Any) -> Any:
    """Return metrics as JSON has them: what is not finite is None.

    Raises:
        TypeError: Something that JSON cannot express.
    """
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, numbers.Integral) and not isinstance(value, bool):
        return int(value)
    if isinstance(value, numbers.Real) and not isinstance(value, bool):
        return float(value) if math.isfinite(value) else None
    json.dumps(value)
    return value
