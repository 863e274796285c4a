"""Files of a study: the result of every task, and how the results were made.

A result is complete if it has every metric of its kind of task.
"""

import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

from gplfd_env.doors.config import door_config
from gplfd_experiments.episodes.metrics import EpisodeMetrics
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.files.plain_data import (
    NewerFormatError,
    check_stamp,
    entry,
    naming,
    read_json,
    refuse_newer,
    stamp,
    write_json,
)
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies.tasks import RecordedTask, Result, task_from

STUDY: Final = "study.json"
"""Name of the file that states how the results of a folder were made."""
PLANNED: Final = "tasks"
"""Entry of that file: number of tasks of the study."""
STUDY_KIND: Final = "gplfd study"
STUDY_VERSION: Final = 1
STUDY_STAMP: Final[Mapping[str, Any]] = stamp(STUDY_KIND, STUDY_VERSION)
"""First entries of that file."""

RESULT_KIND: Final = "gplfd result"
RESULT_VERSION: Final = 1
"""Version of the layout and the required metrics of result files."""
RESULT_STAMP: Final[Mapping[str, Any]] = stamp(RESULT_KIND, RESULT_VERSION)
"""First entries of a result file."""

POLICY_ERROR: Final = "policy_error"
"""Failure of an episode in which the policy raised an error, in learning or acting."""

# The runner writes None for numbers that are not finite.
_NUMBER: Final[Any] = float | None
_EPISODE_METRICS: Final[Mapping[str, Any]] = {
    name: _NUMBER if kind is float else kind
    for name, kind in typing.get_type_hints(EpisodeMetrics).items()
} | {"radius": float}
"""Type of each metric of an episode."""

LEARNING_METRICS: Final = frozenset(
    {
        *("rmse_position_m", "rmse_rotation_rad", "nlpd"),
        *("coverage_50", "coverage_90", "coverage_95", "log_dimensionless_jerk"),
        *("via_error_position_m", "via_far_change"),
        *("cpu_fit_s", "cpu_predict_s", "cpu_adapt_s"),
    }
)
"""Metrics of every complete learning test."""

FORECAST_METRICS: Final = frozenset(
    f"{kind}_{share}_{quantity}"
    for share in (10, 25, 50)
    for kind in ("forecast", "online")
    for quantity in ("position_m", "rotation_rad", "nlpd", "coverage_95")
) | {f"online_{share}_path_m" for share in (10, 25, 50)}
"""Further metrics of a complete test on a recording."""

_LARGEST: Final = 1e9
"""Largest magnitude of a metric, so that computed values stay finite."""


def write_study(folder: Path, about: Mapping[str, Any]) -> None:
    """Write study.json, unless a later version wrote it."""
    refuse_newer(read_study, folder)
    write_json(folder / STUDY, {**STUDY_STAMP, **about})


def read_study(folder: Path) -> dict[str, Any]:
    """Return the content of study.json."""
    about = read_json(folder / STUDY)
    with naming(folder / STUDY):
        check_stamp(about, STUDY_KIND, STUDY_VERSION)
    return about


def result_path(folder: Path, task: Task) -> Path:
    """Return the path of a task's result."""
    return folder / "tasks" / f"{task.key}.json"


def outcome(record: Mapping[str, Any], task: Task) -> dict[str, Any]:
    """Return the metrics of a result; none if it is an error."""
    check_stamp(record, RESULT_KIND, RESULT_VERSION)
    if "error" in record:
        entry(record, "error", str)
        return {}
    metrics: dict[str, Any] = entry(record, "metrics", dict[str, Any])
    if isinstance(task, EpisodeTask):
        kinds = dict(_EPISODE_METRICS)
    else:
        further = FORECAST_METRICS if isinstance(task, RecordedTask) else frozenset()
        names = (*metrics, *sorted(LEARNING_METRICS | further))
        kinds = dict.fromkeys(names, _NUMBER)
    for name, kind in kinds.items():
        value = entry(metrics, name, kind)
        low = 0.0 if name.startswith("prediction_error") else -_LARGEST
        for number in value if isinstance(value, tuple) else [value]:
            plausible = not isinstance(number, int | float) or low <= number <= _LARGEST
            if not plausible and name != "seed":
                raise ValueError(f"{name} = {number:g} is no plausible measurement")
    if isinstance(task, EpisodeTask):
        door_config(dict(task.door_config)).replaced({"radius": metrics["radius"]})
        if len(metrics["forecast_progress"]) != len(metrics["forecast_error_mm"]):
            raise ValueError("forecast_progress and forecast_error_mm differ in length")
    return metrics


@dataclass(frozen=True, kw_only=True, slots=True)
class StoredResults:
    """The results of a study in a folder."""

    finished: tuple[Result, ...]
    """Complete results without an error."""
    failed: tuple[Result, ...]
    """Results that are an error."""
    unfinished: tuple[Task, ...]
    """Tasks without a complete result, or with an error; these are run."""
    damaged: tuple[str, ...]
    """Problem of each file without a complete result."""

    @property
    def from_other_code(self) -> int:
        """Number of finished results that other code made.

        Other code is another git commit, a checkout with edits where this one has none
        or the reverse, or other package versions. Two different edits of one commit
        count as the same code.
        """
        here = {name: code_state()[name] for name in ("versions", "git")}
        return sum(
            any(result.get(name) != state for name, state in here.items())
            for result in self.finished
        )

    @property
    def from_other_machines(self) -> int:
        """Number of finished results from another kind of machine.

        They equal results of this machine only up to a tolerance; see
        docs/reproducibility.md.
        """
        here = code_state().get("arithmetic")
        return sum(result.get("arithmetic") != here for result in self.finished)


def stored_results(folder: Path, study: Iterable[Task]) -> StoredResults:
    """Read the result of every task of a study."""
    finished, failed, unfinished, damaged = [], [], [], []
    for task in study:
        path = result_path(folder, task)
        try:
            result = read_json(path)
            with naming(path):
                outcome(result, task)
                if task_from(entry(result, "task", dict[str, Any])).key != task.key:
                    raise ValueError("it holds the result of another task")
        except NewerFormatError:
            raise
        except FileNotFoundError:
            unfinished.append(task)
        except (OSError, ValueError) as error:
            unfinished.append(task)
            damaged.append(str(error))
        else:
            if "error" in result:
                failed.append(result)
                unfinished.append(task)
            else:
                finished.append(result)
    return StoredResults(
        finished=tuple(finished),
        failed=tuple(failed),
        unfinished=tuple(unfinished),
        damaged=tuple(damaged),
    )
