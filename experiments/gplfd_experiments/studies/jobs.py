"""What a worker does with a job: learn once, open all its doors in lockstep."""

import errno
import json
import math
import numbers
import traceback
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

from gplfd_experiments.episodes.agents import where
from gplfd_experiments.episodes.build import (
    demonstrations_hash,
    learned_agents,
    open_together,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.learning_tests.recorded import recorded_metrics
from gplfd_experiments.studies.learning_tests.scores import method_metrics
from gplfd_experiments.studies.result_format import STAMP
from gplfd_experiments.studies.sources import NO_FILES, Files, policy_of
from gplfd_experiments.studies.tasks import Job, Result, SkillTask
from gplfd_policies.agents.agent import Agent
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.registry.policy import Policy

_EXHAUSTED: Final = frozenset(
    {errno.ENOSPC, errno.EDQUOT, errno.ENOMEM, errno.EMFILE, errno.ENFILE}
)
"""What a machine says whose disk, memory or table of files is full."""

FORECAST_PERIOD: Final = 0.05
"""Simulated time between forecasts [s]: at most a degree of a demonstrated opening."""


def run_job(
    job: Job,
    files: Files = NO_FILES,
    recordings: Sequence[Demonstration] = (),
) -> list[Result]:
    """Return a result per task; whatever goes wrong in a task is its result.

    BLAS runs on one thread, for the same sums in the same order everywhere.

    Args:
        job: Tasks of one policy.
        files: Of policies that this machine may lack.
        recordings: All that `RecordedTask`s learn from.
    """
    with one_thread:
        try:
            policy = policy_of(job[0], files)
        except ValueError as error:
            return _all_failed(job, error)
        episodes = [task for task in job if isinstance(task, EpisodeTask)]
        opened = iter(_episode_results(episodes, policy))
        return [
            next(opened)
            if isinstance(task, EpisodeTask)
            else _learning_result(task, policy, recordings)
            for task in job
        ]


def failed(task: Task, reason: str, trace: str = "", *, lost: bool = False) -> Result:
    """Return the result of a task that ended in an error.

    Args:
        task: Which.
        reason: Why, in a sentence.
        trace: Where in the code; "" when the worker is gone.
        lost: Whether the error is the machine's. Without, it is the policy's, and
            counts as a failure of the policy.
    """
    result = {**_origin(task), "error": reason, "traceback": trace}
    return {**result, "lost": True} if lost else result


def episode_logs(tasks: Sequence[EpisodeTask]) -> tuple[EpisodeLog, ...]:
    """Learn once and open the doors of these tasks.

    Args:
        tasks: Learn from the same; at least one.

    Returns:
        The logs from which the tasks' metrics come.

    Raises:
        ValueError: The policy is not here, or another one.
    """
    make = learned_agents(tasks[0], policy_of(tasks[0], NO_FILES))
    agents = [make() for _ in tasks]
    return open_together(tasks, agents, forecast_period=FORECAST_PERIOD)


def _origin(task: Task) -> Result:
    return {**STAMP, "task": task.definition, **code_state()}


def _seen(task: Task) -> Result:
    if not isinstance(task, EpisodeTask):
        return {}
    return {"demonstrations": demonstrations_hash(task)}


def _all_failed(
    tasks: Sequence[Task], error: BaseException, policy: Policy | None = None
) -> list[Result]:
    """Return an error as the result of some tasks, with the place in the policy."""
    reason, trace = f"{type(error).__name__}: {error}", traceback.format_exc()
    if policy is not None and (place := where(error, policy)):
        reason = f"{reason} ({place})"
    # A worker that cannot load the policy, or has no memory, says nothing about it.
    lost = policy is None or _is_of_machine(error)
    return [failed(task, reason, trace, lost=lost) for task in tasks]


def _is_of_machine(error: BaseException) -> bool:
    full = isinstance(error, OSError) and error.errno in _EXHAUSTED
    return full or isinstance(error, MemoryError)


def _attempt(
    tasks: Sequence[Task],
    policy: Policy,
    measure: Callable[[], Sequence[Mapping[str, Any]]],
) -> list[Result]:
    """Measure some tasks; the same error for all of them if it fails."""
    try:
        return [
            {**_origin(task), **_seen(task), "metrics": _plain(metrics)}
            for task, metrics in zip(tasks, measure(), strict=True)
        ]
    # Anything: a policy that cannot learn or act is a finding of the study, and one
    # with a mistake in its code must not take the other policies' results along.
    except (Exception, SystemExit) as error:
        return _all_failed(tasks, error, policy)


def _episode_results(tasks: Sequence[EpisodeTask], policy: Policy) -> list[Result]:
    if not tasks:
        return []
    try:
        make = learned_agents(tasks[0], policy)
    except (Exception, SystemExit) as error:
        return _all_failed(tasks, error, policy)

    def together(some: Sequence[EpisodeTask]) -> list[Result]:
        return _attempt(some, policy, lambda: _episode_metrics(some, make))

    results = together(tasks)
    if len(tasks) > 1 and "error" in results[0]:
        # One door's error ends the lockstep of all: alone, the others are measured.
        results = [result for task in tasks for result in together([task])]
    return results


def _episode_metrics(
    tasks: Sequence[EpisodeTask], make: Callable[[], Agent]
) -> list[dict[str, Any]]:
    agents = [make() for _ in tasks]
    logs = open_together(tasks, agents, forecast_period=FORECAST_PERIOD)
    return [
        episode_metrics(log, demonstrated_angle=task.teacher["angle_mean"]).as_json()
        for task, log in zip(tasks, logs, strict=True)
    ]


def _learning_result(
    task: Task, policy: Policy, recordings: Sequence[Demonstration]
) -> Result:
    def measure() -> list[Mapping[str, Any]]:
        if policy.method is None:
            raise ValueError(
                f"policy {task.policy!r} learns no movement, so that there is nothing "
                "to measure"
            )
        if isinstance(task, SkillTask):
            return [
                method_metrics(
                    policy.method,
                    seed=task.seed,
                    demonstrations_per_door=task.demonstrations_per_door,
                    teacher=task.teacher,
                    held_out=task.held_out,
                )
            ]
        return [recorded_metrics(policy.method, recordings, task.seed)]

    return _attempt([task], policy, measure)[0]


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
