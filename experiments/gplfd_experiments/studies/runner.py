"""Running a study: one result file per task, on any engine, resumable."""

import contextlib
from collections.abc import Generator, Sequence
from functools import partial
from pathlib import Path
from typing import Any

from gplfd_experiments.episodes.task import Task
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.studies.engines import Engine, Lost
from gplfd_experiments.studies.engines.serial import Serial
from gplfd_experiments.studies.jobs import failed, run_job
from gplfd_experiments.studies.sources import files_of
from gplfd_experiments.studies.store import is_finished, result_path, stored_result
from gplfd_experiments.studies.tasks import Job, Result, jobs_of
from gplfd_policies.demonstrations.demonstration import Demonstration


def run_study(
    folder: Path,
    study: Sequence[Task],
    engine: Engine | None = None,
    recordings: Sequence[Demonstration] = (),
) -> Generator[Result, None, None]:
    """Run the tasks without a result or with an error.

    Only this process writes files; engines bring it the results as small records.

    Args:
        folder: Results are kept in ``folder/tasks/<key>.json``.
        study: What to run.
        engine: Where to run it; in this process if None.
        recordings: All that `RecordedTask`s learn from; they go with every job.

    Yields:
        A result per task that ran, in the order in which they finish, when its file
        is written.

    Raises:
        ValueError: A file that a policy comes from has just changed.
        OSError: A file cannot be read or written, or the engine not be reached.
    """
    missing = [task for task in study if not is_finished(stored_result(folder, task))]
    files = files_of(missing)
    sent: dict[str, Any] = {"files": files} if files else {}
    if recordings:
        sent["recordings"] = tuple(recordings)
    work = partial(run_job, **sent) if sent else run_job
    jobs = jobs_of(missing)
    while jobs:
        alone: list[Job] = []
        finished = (engine or Serial()).run(work, jobs)
        # Closed at once when the reader stops, so that no worker outlives an
        # interruption.
        with contextlib.closing(finished):
            for job, outcome in finished:
                if isinstance(outcome, Lost) and len(job) > 1:
                    # One task may end the worker of all: alone, the others are run.
                    alone += [(task,) for task in job]
                    continue
                yield from _written(folder, job, outcome)
        jobs = tuple(alone)


def _written(
    folder: Path, job: Job, outcome: Sequence[Result] | Lost
) -> Generator[Result, None, None]:
    results = (
        [failed(job[0], outcome.reason, lost=not outcome.crashed)]
        if isinstance(outcome, Lost)
        else outcome
    )
    for task, result in zip(job, results, strict=True):
        write_json(result_path(folder, task), result)
        yield result
