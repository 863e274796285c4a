"""Files of a study: the result of every task, and how the results were made."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final

from gplfd_env.doors.config import door_config
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.files.plain_data import (
    check_stamp,
    entry,
    json_text,
    naming,
    read_json,
    stamp,
    write_json,
)
from gplfd_experiments.studies.tasks import Result, task_from

STUDY: Final = "study.json"
"""Name of the file that states how the results of a folder were made."""
PLANNED: Final = "tasks"
"""Entry of that file: number of tasks of the study."""
_STUDY, _RESULT = ("gplfd study", 1), ("gplfd result", 1)  # Kind and version.
STUDY_STAMP, RESULT_STAMP = stamp(*_STUDY), stamp(*_RESULT)
"""First entries of that file, and of a result file."""

POLICY_ERROR: Final = "policy_error"
"""Failure of an episode in which the policy raised an error, in learning or acting."""

_KINDS: Final[Mapping[str, Any]] = {
    **dict.fromkeys(("policy", "door", "failure", "reason", "stage"), str),
    "forecast_progress": tuple[float | None, ...],
    "forecast_error_mm": tuple[float | None, ...],
    **dict.fromkeys(("stiffness_min", "stiffness_max"), tuple[float, ...] | None),
    "success": bool,
    "radius": float,
}
"""Types of the metrics of an episode that are not a number or None."""


def write_study(folder: Path, about: Mapping[str, Any]) -> None:
    """Write study.json; that of commands with other settings stays in "earlier".

    A file that is damaged, or of a later version, is not replaced.
    """
    about = {**STUDY_STAMP, **about}
    if (folder / STUDY).exists():
        before = read_study(folder)
        earlier = before.pop("earlier", [])
        if json_text(before.get("config")) != json_text(about["config"]):
            earlier.append(before)
        about |= {"earlier": earlier} if earlier else {}
    write_json(folder / STUDY, about)


def read_study(folder: Path) -> dict[str, Any]:
    """Return the content of study.json."""
    about = read_json(folder / STUDY)
    with naming(folder / STUDY):
        check_stamp(about, *_STUDY)
    return about


def result_path(folder: Path, task: Task) -> Path:
    """Return the path of a task's result."""
    return folder / "tasks" / f"{task.key}.json"


def outcome(record: Mapping[str, Any], task: Task) -> dict[str, Any]:
    """Return the metrics of a result; none if it is an error."""
    check_stamp(record, *_RESULT)
    if "error" in record:
        entry(record, "error", str)
        return {}
    metrics: dict[str, Any] = entry(record, "metrics", dict[str, Any])
    kinds = _KINDS if isinstance(task, EpisodeTask) else {"nlpd": float | None}
    for name in {**kinds, **metrics}:
        entry(metrics, name, kinds.get(name, float | None))
    if isinstance(task, EpisodeTask):
        door_config(dict(task.door_config)).replaced({"radius": metrics["radius"]})
    return metrics


@dataclass(kw_only=True, slots=True)
class StoredResults:
    """The results of a study in a folder."""

    finished: list[Result] = field(default_factory=list)
    """Complete results without an error."""
    failed: list[Result] = field(default_factory=list)
    """Results that are an error."""
    unfinished: list[Task] = field(default_factory=list)
    """Tasks without a complete result, or with an error; these are run."""
    damaged: list[str] = field(default_factory=list)
    """Problem of each file without a complete result."""


def stored_results(folder: Path, study: Iterable[Task]) -> StoredResults:
    """Read the result of every task of a study."""
    stored = StoredResults()
    for task in study:
        path = result_path(folder, task)
        try:
            result = read_json(path)
            with naming(path):
                outcome(result, task)
                if task_from(entry(result, "task", dict[str, Any])).key != task.key:
                    raise ValueError("it holds the result of another task")
            if "error" not in result:
                stored.finished.append(result)
                continue
            stored.failed.append(result)
        except FileNotFoundError:
            pass
        except (OSError, ValueError) as error:
            stored.damaged.append(str(error))
        stored.unfinished.append(task)
    return stored
