"""Run or resume a study: one result file per task, on any engine."""

import contextlib
import json
import queue
import sys
import threading
from collections.abc import Generator, Iterator, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.episodes.task import Task
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.studies.engines import Engine, Lost, Serial
from gplfd_experiments.studies.jobs import failed, run_job
from gplfd_experiments.studies.sources import files_of
from gplfd_experiments.studies.store import (
    PLANNED,
    STUDY,
    result_path,
    stored_results,
    write_study,
)
from gplfd_experiments.studies.tasks import Job, Result, jobs_of
from gplfd_policies.demonstrations.demonstration import Demonstration

_PATIENCE: Final = 600.0
"""Time without a result after which a warning names the first unfinished task [s]."""


def run_or_resume(
    study: Sequence[Task],
    options: Mapping[str, Any],
    folder: Path,
    engine: Engine,
    recordings: Sequence[Demonstration] = (),
) -> int:
    """Run the tasks of a study that have no complete result yet, or an error.

    At the end every task must have a complete result on the disk, and the study its
    study.json: files may have been deleted or changed meanwhile.

    Args:
        study: All tasks of the study.
        options: The command's options, for the record; JSON-able.
        folder: Folder of the study; may hold results already.
        engine: Where to run.
        recordings: All recordings that its `RecordedTask`s learn from.

    Returns:
        The number of problems: tasks that ended in an error or have no result, and
        study.json if it is gone.

    Raises:
        ValueError: A later version of this package wrote a file of the study.
        OSError: A file cannot be written, or the engine cannot be reached.
    """
    check_folder(folder)
    sources = {task.policy: task.policy_source for task in study if task.policy_source}
    config = dict(options) | ({"policy_sources": sources} if sources else {})
    stored = stored_results(folder, study)
    write_study(folder, {**provenance(config), PLANNED: len(study)})
    for reason in stored.damaged:
        LOG.warning("warning: %s; its task is run again", reason)
    others = stored.from_other_code
    _warn_of_other_code(others, len(study), folder)
    with (
        contextlib.closing(run_study(folder, study, engine, recordings)) as results,
        counter("task", len(study), len(stored.finished)) as bar,
        _warnings_of_silence(stored.unfinished) as finished,
        # What a policy prints is no part of the table or JSON on standard output.
        contextlib.redirect_stdout(sys.stderr),
    ):
        for result in results:
            bar.update()
            finished.put(_text(result["task"]))

    # Read the files again: they, and not what the engine returned, are the results.
    stored = stored_results(folder, study)
    # Workers on other machines may have another version of this package.
    if stored.from_other_code > others:
        _warn_of_other_code(stored.from_other_code, len(study), folder)
    if elsewhere := stored.from_other_machines:
        LOG.warning(
            "warning: %d of %d results were made on another machine: they equal those "
            "made here to a tolerance only, see docs/reproducibility.md",
            elsewhere,
            len(study),
        )
    if stored.failed:
        LOG.error(
            "%d of %d tasks ended in errors, kept in %s; the same command tries them "
            "again",
            len(stored.failed),
            len(study),
            folder / "tasks",
        )
    if missing := len(stored.unfinished) - len(stored.failed):
        LOG.error(
            "%d of %d tasks have no complete result in %s: files were deleted or "
            "changed while the study ran; the same command runs these tasks again",
            missing,
            len(study),
            folder / "tasks",
        )
        for reason in stored.damaged:
            LOG.error(reason)
    lacks_study = not (folder / STUDY).is_file()
    if lacks_study:
        LOG.error(
            "%s is gone: it was deleted while the study ran; the same command writes "
            "it again",
            folder / STUDY,
        )
    # One error of each policy is shown.
    first: dict[str, Result] = {}
    for result in stored.failed:
        first.setdefault(result["task"]["policy"], result)
    for result in first.values():
        LOG.error("%s: %s", _title(result["task"]), result["error"])
        LOG.debug("%s", result.get("traceback") or "no traceback")
    return len(stored.failed) + missing + lacks_study


def run_study(
    folder: Path,
    study: Sequence[Task],
    engine: Engine | None = None,
    recordings: Sequence[Demonstration] = (),
) -> Generator[Result, None, None]:
    """Run the tasks without a result or with an error.

    Only this process writes files; engines return the results as small records.

    Args:
        folder: Results are kept in ``folder/tasks/<key>.json``.
        study: The tasks.
        engine: Where to run; in this process if None.
        recordings: All recordings that `RecordedTask`s learn from; they are sent with
            every job.

    Yields:
        A result per task that ran, in the order in which they finish, when its file
        is written.

    Raises:
        ValueError: A file that a policy comes from has just changed.
        OSError: A file cannot be read or written, or the engine cannot be reached.
    """
    missing = stored_results(folder, study).unfinished
    work = partial(run_job, files=files_of(missing), recordings=tuple(recordings))
    jobs = jobs_of(missing)
    while jobs:
        alone: list[Job] = []
        finished = (engine or Serial()).run(work, jobs)
        # Closed at once when the reader stops, so that no worker outlives an
        # interruption.
        with contextlib.closing(finished):
            for job, outcome in finished:
                if isinstance(outcome, Lost) and len(job) > 1:
                    # One task may have ended the worker of all: run each alone.
                    alone += [(task,) for task in job]
                    continue
                results = (
                    [failed(job[0], outcome.reason, lost=not outcome.crashed)]
                    if isinstance(outcome, Lost)
                    else outcome
                )
                for task, result in zip(job, results, strict=True):
                    write_json(result_path(folder, task), result)
                    yield result
        jobs = tuple(alone)


@contextlib.contextmanager
def _warnings_of_silence(study: Sequence[Task]) -> Iterator["queue.SimpleQueue[str]"]:
    """Warn when no task finishes for `_PATIENCE`; a policy may hang.

    Yields:
        A queue of the definitions of finished tasks, as `_text` makes them.
    """
    finished: queue.SimpleQueue[str] = queue.SimpleQueue()
    waiting = {_text(task.definition): task for task in study}

    def watch() -> None:
        while waiting:
            try:
                waiting.pop(finished.get(timeout=_PATIENCE), None)
            except queue.Empty:
                LOG.warning(
                    "warning: no task has finished for %g minutes. Perhaps a policy "
                    "hangs; the first task without a result is: %s. Ctrl-C ends the "
                    "study and keeps what is finished",
                    _PATIENCE / 60.0,
                    _title(next(iter(waiting.values())).definition),
                )

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield finished
    finally:
        for definition in list(waiting):
            finished.put(definition)
        watcher.join()


def _text(definition: Mapping[str, Any]) -> str:
    return json.dumps(definition, sort_keys=True)


def _title(task: Mapping[str, Any]) -> str:
    """Return the title of a task in messages, from its definition."""
    if task["kind"] == "recorded":
        return f"{task['policy']}, recording {task['seed']} left out"
    what = task["door"] if task["kind"] == "episode" else f"{task['held_out']} left out"
    return f"{task['policy']}, {what}, seed {task['seed']}"


def _warn_of_other_code(others: int, total: int, folder: Path) -> None:
    if others:
        LOG.warning(
            "warning: %d of %d results were made by other code (another git state or "
            "other package versions); use another --out or delete %s to have one "
            "version",
            others,
            total,
            folder,
        )
