"""Run or resume a study: one result file per task, on any engine."""

import contextlib
import sys
from collections.abc import Generator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.episodes.task import Task
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.jobs import failed, run_job
from gplfd_experiments.studies.sources import files_of
from gplfd_experiments.studies.store import (
    PLANNED,
    result_path,
    stored_results,
    write_study,
)
from gplfd_experiments.studies.tasks import Job, Result, jobs_of
from gplfd_policies.demonstrations.demonstration import Demonstration


def run_or_resume(
    study: Sequence[Task],
    options: Mapping[str, Any],
    folder: Path,
    engine: Engine,
    recordings: Sequence[Demonstration] = (),
) -> int:
    """Run the tasks of a study without a complete result, or with an error.

    Returns the number of tasks with an error or, at the end, without a result.
    """
    sources = {task.policy: task.policy_source for task in study if task.policy_source}
    config = dict(options) | ({"policy_sources": sources} if sources else {})
    stored, total = stored_results(folder, study), len(study)
    write_study(folder, {**provenance(config), PLANNED: total})
    for reason in stored.damaged:
        LOG.warning("warning: %s; its task is run again", reason)
    with (
        contextlib.closing(run_study(folder, study, engine, recordings)) as results,
        counter("task", total, len(stored.finished)) as bar,
        # Output of a policy is kept out of the table or JSON on standard output.
        contextlib.redirect_stdout(sys.stderr),
    ):
        try:
            for _ in results:
                bar.update()
        except KeyboardInterrupt:
            raise KeyboardInterrupt("run the same command again to go on") from None

    # The results are the files, not the return values of the engine.
    stored = stored_results(folder, study)
    if errors := len(stored.failed):
        LOG.error(
            f"{errors} of {total} tasks ended in errors, kept in {folder / 'tasks'}; "
            "the same command tries them again"
        )
    if missing := len(stored.unfinished) - errors:
        LOG.error(
            f"{missing} of {total} tasks have no complete result in "
            f"{folder / 'tasks'}; the same command runs these tasks again"
        )
        for reason in stored.damaged:
            LOG.error(reason)
    # One error of each policy is shown.
    first: dict[str, Result] = {}
    for result in stored.failed:
        first.setdefault(result["task"]["policy"], result)
    for result in first.values():
        task = result["task"]
        what = task.get("door") or f"{task.get('held_out')} left out"
        what = f"{what}, seed {task['seed']}"
        if task["kind"] == "recorded":
            what = f"recording {task['seed']} left out"
        LOG.error("%s, %s: %s", task["policy"], what, result["error"])
        LOG.debug("%s", result.get("traceback") or "no traceback")
    return errors + missing


def run_study(
    folder: Path,
    study: Sequence[Task],
    engine: Engine | None = None,
    recordings: Sequence[Demonstration] = (),
) -> Generator[Result, None, None]:
    """Run the tasks without a result or with an error; yield the written results.

    Only this process writes files; engines return the results as small records.
    """
    folder = folder.absolute()
    missing = stored_results(folder, study).unfinished
    work = partial(run_job, files=files_of(missing), recordings=tuple(recordings))
    jobs = jobs_of(missing)
    while jobs:
        halves: list[Job] = []
        # Closed at once if the reader stops, so that workers end with an interruption.
        with contextlib.closing(
            (engine or Engine(engine="serial")).run(work, jobs)
        ) as finished:
            for job, outcome in finished:
                if not isinstance(outcome, Lost):
                    results = outcome
                elif len(job) == 1:
                    results = [failed(job[0], str(outcome), lost=True)]
                else:  # One task may have ended the worker of all.
                    halves += [job[: len(job) // 2], job[len(job) // 2 :]]
                    continue
                for task, result in zip(job, results, strict=True):
                    write_json(result_path(folder, task), result)
                    yield result
        jobs = tuple(halves)
