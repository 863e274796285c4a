"""From the files of a study to records; a file that cannot be read is named."""

import dataclasses
import json
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

from gplfd_env.conventions.constants import Start
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.doors.disturbance import disturbance_named
from gplfd_env.doors.randomization import door_randomization
from gplfd_experiments.analysis.results.records import (
    DEMONSTRATED,
    NON_STANDARD,
    UNDEMONSTRATED,
    EpisodeResult,
    LearningTestResult,
    RecordedResult,
    StudyResults,
    TaskResult,
    door_kind,
)
from gplfd_experiments.data.teacher import Habits, TeacherConfig
from gplfd_experiments.episodes.task import EpisodeTask, Task, TaughtTask
from gplfd_experiments.files.plain_data import NewerFormatError, entry, read_json
from gplfd_experiments.studies.learning_tests.folds import HELD_OUT
from gplfd_experiments.studies.result_format import POLICY_ERROR, lost, outcome
from gplfd_experiments.studies.settings import Condition
from gplfd_experiments.studies.store import STUDY, read_study
from gplfd_experiments.studies.tasks import RecordedTask, SkillTask, task_from

TASKS: Final = "tasks"

_SAME_RADIUS: Final = 1e-3
"""Doors whose radii differ by less are the same to a hand [m]."""
_LONGEST: Final = 200
"""Characters of a name, and of a reason."""

_RECORDED: Final[Mapping[str, Any]] = {"policy": str, "seed": int, "recordings": str}
_LEARNING_TEST: Final[Mapping[str, Any]] = {
    "policy": str,
    "seed": int,
    "demonstrations_per_door": int,
    "teacher": dict[str, float],
}
_EPISODE: Final = {
    **_LEARNING_TEST,
    "door": str,
    "door_config": dict[str, float | str | None],
    "randomization": str | dict[str, Any],
}
_FIELDS: Final = {
    "episode": _EPISODE,
    "skill": _LEARNING_TEST,
    "recorded": _RECORDED,
}
"""Fields of a task by its kind."""
_SELDOM: Final = {
    "disturbance": str | dict[str, Any],
    "demonstrated_radii": tuple[float, ...],
    "demonstrated_kind": dict[str, str] | None,
    "base": str,
    "environment_version": int,
    "start": Start,
    "habits": dict[str, float] | None,
    "prior_radius": float | None,
    "trial": str,
    "level": str,
}
"""Fields that most episodes' files leave out."""
_SOURCE: Final = dict[str, Any] | None
_CLOSED_BY_ERROR: Final[Mapping[str, Any]] = MappingProxyType(
    {
        "success": False,
        "failure": POLICY_ERROR,
        "final_angle_deg": 0.0,
        "forecast_progress": (),
        "forecast_error_mm": (),
    }
)
"""What counts of an episode in which the policy raised an error."""


def read_results(folder: Path) -> StudyResults:
    """Read a study's folder.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: It holds no result that can be read.
    """
    if not folder.is_dir():
        raise FileNotFoundError(
            f"there is no folder {folder}; `gplfd benchmark --out {folder}` makes one"
        )
    # A file that is being written, or was when its process was killed, has a dot first.
    files = sorted((folder / TASKS).glob("[!.]*.json"))
    if not files:
        raise ValueError(
            f"{folder} is not the folder of a study: it has no {TASKS}/*.json. Give "
            "the --out of a `gplfd benchmark`"
        )
    found, unreadable = read_files(files)
    if not found:
        raise ValueError(
            f"none of the {len(files)} files in {folder / TASKS} holds a result; "
            f"the first: {unreadable[0]}"
        )
    study: dict[str, Any] = {}
    if (folder / STUDY).exists():
        try:
            study = read_study(folder)
        except NewerFormatError:
            raise
        except (OSError, ValueError) as error:
            unreadable.append(_reason(folder / STUDY, error))
    return _of_study(study, found, unreadable)


def _of_study(
    study: Mapping[str, Any], found: Iterable[TaskResult], unreadable: Iterable[str]
) -> StudyResults:
    """Return results by what they are of, in order.

    A resumed study runs episodes of an older environment again and keeps their files:
    these results are left out.
    """
    every = list(found)
    episodes = [one for one in every if isinstance(one, EpisodeResult)]
    again = {
        dataclasses.replace(one.task, environment_version=0).key
        for one in episodes
        if one.task.environment_version > 0
    }
    episodes = [one for one in episodes if one.task.key not in again]
    tests = [one for one in every if isinstance(one, LearningTestResult)]
    recorded = [one for one in every if isinstance(one, RecordedResult)]
    return StudyResults(
        study=study,
        episodes=tuple(sorted(episodes, key=_episode_order)),
        tests=tuple(sorted(tests, key=_test_order)),
        recorded=tuple(sorted(recorded, key=lambda one: (one.policy, one.key))),
        unreadable=tuple(unreadable),
    )


def is_measured(folder: Path) -> bool:
    """Tell whether any task of a study came to more than an error."""
    files = (folder / TASKS).glob("[!.]*.json")
    each = (one for file in files for one in read_files([file])[0])
    return any(not one.error for one in each)


def read_all(folders: Sequence[Path]) -> StudyResults:
    """Read the results of several folders as those of one study.

    Args:
        folders: At least one; `StudyResults.study` is the first's.

    Raises:
        FileNotFoundError: There is no such folder.
        ValueError: One holds no result, or two hold results of the same task.
    """
    each = [read_results(folder) for folder in folders]
    owner: dict[str, Path] = {}
    for folder, results in zip(folders, each, strict=True):
        for one in results.all:
            if (other := owner.setdefault(one.task.key, folder)) != folder:
                raise ValueError(
                    f"{other} and {folder} both hold results of {one.policy}; leave "
                    "out one of the folders"
                )
    return _of_study(
        each[0].study,
        (one for results in each for one in results.all),
        (reason for results in each for reason in results.unreadable),
    )


def read_files(files: Iterable[Path]) -> tuple[list[TaskResult], list[str]]:
    """Read results, and name the files that hold none, with the reason."""
    found, unreadable = list[TaskResult](), list[str]()
    for file in files:
        try:
            found.append(_result(read_json(file)))
        except (OSError, ValueError, TypeError) as error:
            unreadable.append(_reason(file, error))
    return found, unreadable


def _reason(file: Path, error: Exception) -> str:
    if isinstance(error, FileNotFoundError):
        return f"{file.name}: there is no such file"
    text = " ".join(str(error).split()).replace(str(file), "it")
    return f"{file.name}: {text[:_LONGEST]}"


def _episode_order(one: EpisodeResult) -> tuple[Any, ...]:
    task = one.task
    return one.policy, str(one.condition), one.radius, task.door, task.seed, one.pair


def _test_order(one: LearningTestResult) -> tuple[Any, ...]:
    task = one.task
    return one.policy, str(one.condition), task.held_out, task.seed, one.pair


def _result(record: Mapping[str, Any]) -> TaskResult:
    fields = dict(entry(record, "task", dict[str, Any]))
    source = entry({"policy_source": None, **fields}, "policy_source", _SOURCE) or {}
    task = _task(fields)
    metrics = outcome(record, task)
    shared: dict[str, Any] = {
        "task": task,
        "pair": dataclasses.replace(task, policy="", policy_source=None).key,
        "metrics": metrics,
        "error": str(record.get("error", "")) or ("" if metrics else "no reason given"),
        "lost": lost(record),
        "code": _code(record),
        "machine": str(record.get("arithmetic", "")),
        "policy_source": ", ".join(f"{name} {said}" for name, said in source.items()),
    }
    if isinstance(task, RecordedTask):
        return RecordedResult(**shared)
    if isinstance(task, TaughtTask):
        shared["condition"] = _condition(task)
    if isinstance(task, EpisodeTask):
        shown = str(record.get("demonstrations", ""))
        return _episode(task, shared | {"demonstrations": shown})
    return _learning_test(shared)


def _task(fields: Mapping[str, Any]) -> Task:
    named = entry(fields, "kind", str)
    if named not in _FIELDS:
        raise ValueError(f"kind = {named[:_LONGEST]!r} must be one of {[*_FIELDS]}")
    for name, kind in _FIELDS[named].items():
        value = entry(fields, name, kind)
        if kind is str and not (value.isprintable() and 0 < len(value) <= _LONGEST):
            raise ValueError(f"{name} = {value[:_LONGEST]!r} is not a name in one line")
        if kind is int and value < 0:
            raise ValueError(f"{name} = {value} must be 0 or more")
    for name in _SELDOM.keys() & fields.keys():
        entry(fields, name, _SELDOM[name])
    task = task_from(fields)
    if isinstance(task, EpisodeTask):
        door_randomization(task.randomization)
        disturbance_named(task.disturbance)
        Habits(**(task.habits or {}))
    elif isinstance(task, SkillTask) and task.held_out not in HELD_OUT:
        raise ValueError(f"held_out must be one of {HELD_OUT}, got {task.held_out!r}")
    return task


def _condition(task: TaughtTask) -> Condition:
    noise = TeacherConfig(**task.teacher).wobble_position_std
    taught = Condition(
        demonstrations_per_door=task.demonstrations_per_door,
        teacher_noise=round(noise / TeacherConfig().wobble_position_std, 6),
        randomization="none",
    )
    if not isinstance(task, EpisodeTask):
        return taught
    return dataclasses.replace(
        taught,
        randomization=_told(task.randomization),
        disturbance=_told(task.disturbance),
        start=task.start,
        trial=task.trial,
        level=task.level,
    )


def _told(spec: str | Mapping[str, Any]) -> str:
    return spec if isinstance(spec, str) else json.dumps(spec)


def _episode(task: EpisodeTask, shared: Mapping[str, Any]) -> EpisodeResult:
    planned = door_config(dict(task.door_config))
    metrics = shared["metrics"]
    if shared["error"]:
        metrics = {} if shared["lost"] else _CLOSED_BY_ERROR
    radius = metrics.get("radius", planned.radius)
    shown: dict[str, Any] = dict(task.demonstrated_kind or {})
    if planned != DoorConfig(radius=planned.radius, **shown):
        kind = NON_STANDARD
    elif any(abs(radius - each) < _SAME_RADIUS for each in task.demonstrated_radii):
        kind = DEMONSTRATED
    else:
        kind = UNDEMONSTRATED
    return EpisodeResult(
        radius=radius,
        drawn=door_randomization(task.randomization).radius is not None,
        kind=kind,
        door_kind=door_kind(planned),
        **{**shared, "metrics": metrics},
    )


def _learning_test(shared: Mapping[str, Any]) -> LearningTestResult:
    outputs = shared["metrics"].get("outputs_cpu_s") or {}
    seconds = {int(n): float(each) for n, each in outputs.items() if each is not None}
    return LearningTestResult(outputs_cpu_s=seconds, **shared)


def _code(record: Mapping[str, Any]) -> str:
    if "versions" not in record:
        return "unknown code"
    versions = entry(record, "versions", dict[str, str])
    packages = ", ".join(f"{name} {version}" for name, version in versions.items())
    git = entry({"git": None, **record}, "git", dict[str, str | bool | None] | None)
    if git is None:
        return packages
    edited = " with edits" if git.get("dirty") else ""
    return f"commit {str(git.get('commit'))[:12]}{edited}, {packages}"
