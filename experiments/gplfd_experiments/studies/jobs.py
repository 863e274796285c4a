"""Run a job: learn once, open all its doors in lockstep, or do a learning test."""

import errno
import json
import math
import pickle
import traceback
from collections.abc import Callable, Hashable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_experiments.episodes.build import (
    Movements,
    demonstrations_hash,
    learned_agents,
    open_together,
    place_in_policy,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import PROGRESS, episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.learning_tests.scores import (
    method_metrics,
    recorded_metrics,
)
from gplfd_experiments.studies.sources import (
    LEARNING_LIMIT,
    NO_FILES,
    STEP_LIMIT,
    Files,
    ProcessEndedError,
    call_apart,
    in_own_process,
    policy_of,
)
from gplfd_experiments.studies.store import RESULT_STAMP
from gplfd_experiments.studies.tasks import TOGETHER, Job, Result, SkillTask
from gplfd_policies.agents.agent import shared_in_batch
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.method import Policy

_EXHAUSTED: Final = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EMFILE, errno.ENFILE}
)
"""Errors of a machine with a full disk, memory or table of open files."""

FORECAST_PERIOD: Final = 0.05
"""Simulated time between forecasts [s]; at most a degree of a demonstrated opening."""


def run_job(
    job: Job, files: Files = NO_FILES, recordings: Sequence[Demonstration] = ()
) -> list[Result]:
    """Return a result per task of one policy; an error in a task is its result.

    A user's policy runs in a process of its own. The files contain policies that this
    machine may lack; the recordings are for `RecordedTask`s.
    """
    if not in_own_process(job[0]):
        return _run(job, files, recordings)
    try:
        policy = job[0].policy, Path.cwd(), repr(job[0].policy_source)
        results: list[Result] = call_apart(policy, _run, job, dict(files), recordings)
        return results
    except ProcessEndedError as error:
        if len(job) == 1:
            reason, status = error.args
            return [failed(job[0], reason, lost=status == -9)]
    return [result for task in job for result in run_job((task,), files, recordings)]


def _run(
    job: Job,
    files: Files,
    recordings: Sequence[Demonstration],
    allow: Callable[[float], None] = lambda seconds: None,
) -> list[Result]:
    """Run a job in this process, with time limits of its learnings and steps."""
    # In the process of a user's policy, an interruption is the policy's, too.
    errors = (BaseException,) if in_own_process(job[0]) else (Exception, SystemExit)
    policies: dict[str, Policy] = {}
    results: dict[str, Result] = {}
    for name in dict.fromkeys(task.policy for task in job):
        tasks = [task for task in job if task.policy == name]
        policy: Policy | None = None
        try:
            policy = policies[name] = policy_of(tasks[0], files)
            if not isinstance(tasks[0], EpisodeTask):
                metrics = _learning_metrics(tasks[0], policy, recordings)
                return [{**_origin(tasks[0]), "metrics": _plain(metrics)}]
        except errors as error:
            results |= {task.key: _error_result(task, error, policy) for task in tasks}
    learnable = [t for t in job if isinstance(t, EpisodeTask) and t.policy in policies]
    results |= _opened(learnable, policies, errors, allow)
    return [results[task.key] for task in job]


def _learning_metrics(
    test: Task, policy: Policy, recordings: Sequence[Demonstration]
) -> Mapping[str, Any]:
    """Return the metrics of a learning test."""
    if (method := policy.method) is None:
        raise ValueError(
            f"policy {test.policy!r} learns no movement, so there is nothing to measure"
        )
    if not isinstance(test, SkillTask):
        return recorded_metrics(method, recordings, test.seed)
    names = ["seed", "demonstrations_per_door", "teacher"]
    names += ["demonstrated_forces", "held_out"]
    return method_metrics(method, **{name: getattr(test, name) for name in names})


def _opened(
    episodes: Sequence[EpisodeTask],
    policies: Mapping[str, Policy],
    errors: tuple[type[BaseException], ...],
    allow: Callable[[float], None],
) -> dict[str, Result]:
    """Open the doors of a job's tasks; return the results by the tasks' keys."""
    movements: Movements = {}
    results: dict[str, Result] = {}
    learned: dict[str, Any] = {}  # What makes agents, kind and content, or an error.
    # Tasks of one kind, whatever the policies; those of equal episodes together.
    batches: list[tuple[object, dict[Hashable, list[EpisodeTask]]]] = []
    for task in episodes:
        key, policy = task.training_key, policies[task.policy]
        if key not in learned:
            allow(LEARNING_LIMIT)
            try:
                make = learned_agents(task, policy, movements=movements)
                # Agents that learn when they are made are made once.
                kind = None if policy.method is None else shared_in_batch(make())
                # Most agents that do not learn are equal after any demonstrations.
                ours = policy.kind == "reference" and task.policy_source is None
                content = pickle.dumps(make()) if ours else None
                learned[key] = make, kind or task.policy, content
            except errors as error:
                learned[key] = error
        if isinstance(learned[key], BaseException):
            results[task.key] = _error_result(task, learned[key], policy)
            continue
        _, kind, content = learned[key]
        alike = next((tasks for other, tasks in batches if other == kind), None)
        if alike is None:
            batches.append((kind, alike := {}))
        drawn = task.door_config, task.randomization, task.disturbance, task.reset_seed
        scene = json.dumps([*drawn, task.teacher["angle_mean"]], sort_keys=True)
        alike.setdefault((content, scene if content else task.key), []).append(task)

    def open_doors(groups: Sequence[list[EpisodeTask]]) -> None:
        """Open a door per group in lockstep; if a policy fails, those of each half."""
        allow(LEARNING_LIMIT)
        tasks = [task for task, *_ in groups]
        angles = [task.teacher["angle_mean"] for task in tasks]
        try:
            logs = open_together(
                tasks,
                [learned[task.training_key][0]() for task in tasks],
                forecast_period=FORECAST_PERIOD,
                # Others are not scored.
                forecast_angles=np.outer(angles, PROGRESS),
                before_step=partial(allow, STEP_LIMIT),
            )
            for group, log, angle in zip(groups, logs, angles, strict=True):
                metrics = _plain(episode_metrics(log, demonstrated_angle=angle))
                for task in group:
                    results[task.key] = {
                        **_origin(task),
                        "demonstrations": demonstrations_hash(task),
                        "metrics": {**metrics, "door": task.door},
                    }
        except errors as error:
            if len(groups) == 1:
                for task in groups[0]:
                    policy = policies[task.policy]
                    results[task.key] = _error_result(task, error, policy)
                return
            half = len(groups) // 2
            open_doors(groups[:half])
            open_doors(groups[half:])

    for _, alike in batches:
        # Episodes of a trial are of about one length.
        groups = sorted(alike.values(), key=lambda group: group[0].trial)
        for first in range(0, len(groups), TOGETHER):
            open_doors(groups[first : first + TOGETHER])
    return results


def failed(task: Task, reason: str, trace: str = "", *, lost: bool = False) -> Result:
    """Return the result of a task that ended in an error.

    If the machine caused it, the task is lost; else it is a failure of the policy.
    """
    result = {**_origin(task), "error": reason, "traceback": trace}
    return {**result, "lost": True} if lost else result


def episode_log(task: EpisodeTask) -> EpisodeLog:
    """Learn, open the door of a task, and return the log."""
    make = learned_agents(task, policy_of(task, NO_FILES))
    (log,) = open_together([task], [make()], forecast_period=FORECAST_PERIOD)
    return log


def _origin(task: Task) -> Result:
    return {**RESULT_STAMP, "task": task.definition, **code_state()}


def _error_result(task: Task, error: BaseException, policy: Policy | None) -> Result:
    """Return an error as the result of a task, with its place in the policy's file."""
    reason = f"{type(error).__name__}: {error}"
    if policy is not None and (place := place_in_policy(error, policy)):
        reason = f"{reason} ({place})"
    full = isinstance(error, OSError) and error.errno in _EXHAUSTED
    # An error of a worker without the policy or memory is no result of the policy.
    lost = policy is None or full or isinstance(error, MemoryError)
    return failed(task, reason, "".join(traceback.format_exception(error)), lost=lost)


def _plain(value: Any) -> Any:
    """Return metrics for JSON; numbers that are not finite become None."""
    if isinstance(value, Mapping):
        return {str(name): _plain(part) for name, part in value.items()}
    if isinstance(value, list | tuple):
        return [_plain(part) for part in value]
    if isinstance(value, float):
        return float(value) if math.isfinite(value) else None
    return value
