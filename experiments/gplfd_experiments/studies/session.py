"""Run or resume a study: keep its settings, run missing tasks, report what is wrong."""

import contextlib
import json
import queue
import sys
import threading
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG, counter
from gplfd_experiments.episodes.task import Task
from gplfd_experiments.files.provenance import provenance
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_study
from gplfd_experiments.studies.store import (
    PLANNED,
    STUDY,
    damaged_results,
    is_finished,
    made_by_other_code,
    made_elsewhere,
    stored_result,
    write_study,
)
from gplfd_experiments.studies.tasks import Result
from gplfd_policies.demonstrations.demonstration import Demonstration

_PATIENCE: Final = 600.0
"""After how long without a result a warning says what is waited for [s]."""


def carry_out(
    study: Sequence[Task],
    options: Mapping[str, Any],
    folder: Path,
    engine: Engine,
    recordings: Sequence[Demonstration] = (),
) -> int:
    """Run the tasks of a study that have no complete result yet, or an error.

    In the end every task must have a complete result on the disk, and the study its
    study.json: files may have been deleted or changed meanwhile.

    Args:
        study: All its tasks.
        options: The command's, for the record; JSON-able.
        folder: Of the study; may have results already.
        engine: Where to run.
        recordings: All that its `RecordedTask`s learn from.

    Returns:
        How many things are wrong: tasks that ended in an error or have no result, and
        study.json if it is gone.

    Raises:
        ValueError: A later version of this package wrote a file of the study.
        OSError: A file cannot be written, or the engine not be reached.
    """
    check_folder(folder)
    sources = {task.policy: task.policy_source for task in study}
    config = dict(options)
    if own := {name: source for name, source in sources.items() if source}:
        config["policy_sources"] = own
    damaged = damaged_results(folder, study)
    write_study(folder, {**provenance(config), PLANNED: len(study)})
    for reason in damaged:
        LOG.warning("warning: %s; its task is run again", reason)
    others = made_by_other_code(folder, study)
    _warn_of_other_code(others, len(study), folder)
    _run(study, folder, engine, recordings)
    # Workers elsewhere may have another version of this package.
    if (others_now := made_by_other_code(folder, study)) > others:
        _warn_of_other_code(others_now, len(study), folder)
    if elsewhere := made_elsewhere(folder, study):
        LOG.warning(
            "warning: %d of %d results were made on another machine: they equal those "
            "made here to a tolerance only, see docs/reproducibility.md",
            elsewhere,
            len(study),
        )
    return _report(study, folder)


def _run(
    study: Sequence[Task],
    folder: Path,
    engine: Engine,
    recordings: Sequence[Demonstration],
) -> None:
    """Run what is missing behind a progress bar that counts tasks."""
    waiting = [task for task in study if not is_finished(stored_result(folder, task))]
    with (
        contextlib.closing(run_study(folder, study, engine, recordings)) as results,
        counter("task", len(study), len(study) - len(waiting)) as bar,
        _warnings_of_silence(waiting) as finished,
        # What a policy prints is no part of the table or JSON on standard output.
        contextlib.redirect_stdout(sys.stderr),
    ):
        for result in results:
            bar.update()
            finished.put(json.dumps(result["task"], sort_keys=True))


@contextlib.contextmanager
def _warnings_of_silence(study: Sequence[Task]) -> Iterator["queue.SimpleQueue[str]"]:
    """Say what is waited for when no task finishes for long; a policy may hang.

    Yields:
        Takes the definitions of tasks that are finished, as JSON with sorted keys.
    """
    finished: queue.SimpleQueue[str] = queue.SimpleQueue()
    waiting = {json.dumps(task.definition, sort_keys=True): task for task in study}

    def watch() -> None:
        while waiting:
            try:
                waiting.pop(finished.get(timeout=_PATIENCE), None)
            except queue.Empty:
                first = next(iter(waiting.values()))
                LOG.warning(
                    "warning: no task has finished for %g minutes. Perhaps a policy "
                    "hangs; the first task without a result is: %s. Ctrl-C ends the "
                    "study and keeps what is finished",
                    _PATIENCE / 60.0,
                    _named(first.definition),
                )

    watcher = threading.Thread(target=watch, daemon=True)
    watcher.start()
    try:
        yield finished
    finally:
        for definition in list(waiting):
            finished.put(definition)
        watcher.join()


def _report(study: Sequence[Task], folder: Path) -> int:
    """Say what is wrong with a study that has run, and return how many things."""
    results = [stored_result(folder, task) for task in study]
    failed = [one for one in results if one is not None and not is_finished(one)]
    missing = results.count(None)
    lacks_study = not (folder / STUDY).is_file()
    if failed:
        LOG.error(
            "%d of %d tasks ended in errors, kept in %s; the same command tries them "
            "again",
            len(failed),
            len(results),
            folder / "tasks",
        )
    if missing:
        LOG.error(
            "%d of %d tasks have no complete result in %s: files were deleted or "
            "changed while the study ran; the same command runs these tasks again",
            missing,
            len(results),
            folder / "tasks",
        )
        for reason in damaged_results(folder, study):
            LOG.error(reason)
    if lacks_study:
        LOG.error(
            "%s is gone: it was deleted while the study ran; the same command writes "
            "it again",
            folder / STUDY,
        )
    first: dict[str, Result] = {}
    for result in failed:
        first.setdefault(result["task"]["policy"], result)
    for result in first.values():
        LOG.error("%s: %s", _named(result["task"]), result["error"])
        LOG.debug("%s", result.get("traceback") or "no traceback")
    return len(failed) + missing + lacks_study


def _named(task: Mapping[str, Any]) -> str:
    """Name a task by its definition."""
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
