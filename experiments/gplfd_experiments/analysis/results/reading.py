"""Read the files of a study as records; a file that cannot be read is named."""

import dataclasses
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
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
from gplfd_experiments.studies.tasks import SkillTask, task_from

TASKS: Final = "tasks"

_SAME_RADIUS: Final = 1e-3
"""Doors whose radii differ by less are the same to a hand [m]."""
_LONGEST: Final = 200
"""Characters of a name, and of a reason."""

_TAUGHT: Final[Mapping[str, Any]] = {
    "policy": str,
    "seed": int,
    "demonstrations_per_door": int,
    "teacher": dict[str, float],
}
_REQUIRED: Final[Mapping[str, Mapping[str, Any]]] = {
    "episode": {
        **_TAUGHT,
        "door": str,
        "door_config": dict[str, float | str | None],
        "randomization": str | dict[str, Any],
    },
    "skill": _TAUGHT,
    "recorded": {"policy": str, "seed": int, "recordings": str},
}
"""Fields that a task must have, by its kind."""
_OPTIONAL: Final = {
    "disturbance": str | dict[str, Any],
    "demonstrated_radii": tuple[float, ...],
    "demonstrated_kind": dict[str, str] | None,
    "demonstrated_hardware": tuple[dict[str, float | str], ...],
    "base": str,
    "robot": str,
    "environment_version": int,
    "start": Start,
    "habits": dict[str, float] | None,
    "demonstrated_forces": bool,
    "prior_radius": float | None,
    "trial": str,
    "level": str,
}
"""Fields that most episodes' files leave out."""
_CLOSED_BY_ERROR: Final[Mapping[str, Any]] = {
    "success": False,
    "failure": POLICY_ERROR,
    "final_angle_deg": 0.0,
    "forecast_progress": (),
    "forecast_error_mm": (),
}
"""What counts of an episode in which the policy raised an error."""


def read_results(*folders: Path) -> StudyResults:
    """Read the results of a study, or of several together.

    A resumed study runs episodes of an older environment again and keeps their files:
    these results are left out. `StudyResults.study` is the first folder's.
    """
    results: list[tuple[Path, TaskResult]] = []
    studies: list[Mapping[str, Any]] = []
    unreadable: list[str] = []
    for folder in folders:
        if not folder.is_dir():
            raise FileNotFoundError(
                f"there is no folder {folder}; `gplfd benchmark --out {folder}` makes "
                "one"
            )
        # A file that is being written has a name that begins with a dot.
        files = sorted((folder / TASKS).glob("[!.]*.json"))
        if not files:
            raise ValueError(
                f"{folder} is not the folder of a study: it has no {TASKS}/*.json. "
                "Give the --out of a `gplfd benchmark`"
            )
        found, problems = read_files(files)
        if not found:
            raise ValueError(
                f"none of the {len(files)} files in {folder / TASKS} holds a result; "
                f"the first: {problems[0]}"
            )
        results += [(folder, one) for one in found]
        unreadable += problems
        studies.append({})
        if (folder / STUDY).exists():
            try:
                studies[-1] = read_study(folder)
            except NewerFormatError:
                raise
            except (OSError, ValueError) as error:
                unreadable.append(_reason(folder / STUDY, error))

    repeated = {
        dataclasses.replace(one.task, environment_version=0).key
        for _, one in results
        if isinstance(one, EpisodeResult) and one.task.environment_version > 0
    }
    results = [each for each in results if each[1].task.key not in repeated]
    owner: dict[str, Path] = {}
    for folder, one in results:
        if (other := owner.setdefault(one.task.key, folder)) != folder:
            raise ValueError(
                f"{other} and {folder} both hold results of {one.policy}; leave out "
                "one of the folders"
            )

    def episode_order(one: EpisodeResult) -> tuple[Any, ...]:
        task, condition = one.task, str(one.condition)
        return one.policy, condition, one.radius, task.door, task.seed, one.pair

    def test_order(one: LearningTestResult) -> tuple[Any, ...]:
        task = one.task
        return one.policy, str(one.condition), task.held_out, task.seed, one.pair

    every = [one for _, one in results]
    episodes = (one for one in every if isinstance(one, EpisodeResult))
    tests = (one for one in every if isinstance(one, LearningTestResult))
    recorded = (one for one in every if isinstance(one, RecordedResult))
    return StudyResults(
        study=studies[0],
        episodes=tuple(sorted(episodes, key=episode_order)),
        tests=tuple(sorted(tests, key=test_order)),
        recorded=tuple(sorted(recorded, key=lambda one: (one.policy, one.key))),
        unreadable=tuple(unreadable),
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


def _result(record: Mapping[str, Any]) -> TaskResult:
    """Return what a file says; raises what is wrong with it."""
    fields = {"policy_source": None, **entry(record, "task", dict[str, Any])}
    source = entry(fields, "policy_source", dict[str, Any] | None) or {}
    task = _task(fields)
    metrics = outcome(record, task)
    code = "unknown code"
    if "versions" in record:
        versions = entry(record, "versions", dict[str, str])
        code = ", ".join(f"{name} {version}" for name, version in versions.items())
        git = entry({"git": None, **record}, "git", dict[str, str | bool | None] | None)
        if git is not None:
            edited = " with edits" if git.get("dirty") else ""
            code = f"commit {str(git.get('commit'))[:12]}{edited}, {code}"
    shared: dict[str, Any] = {
        "task": task,
        "pair": dataclasses.replace(task, policy="", policy_source=None).key,
        "metrics": metrics,
        "error": str(record.get("error", "")) or ("" if metrics else "no reason given"),
        "lost": lost(record),
        "code": code,
        "machine": str(record.get("arithmetic", "")),
        "policy_source": ", ".join(f"{k} {v}" for k, v in source.items()),
    }
    if not isinstance(task, TaughtTask):
        return RecordedResult(**shared)
    shared["condition"] = _condition(task)
    if not isinstance(task, EpisodeTask):
        outputs = metrics.get("outputs_cpu_s") or {}
        seconds = {int(n): float(s) for n, s in outputs.items() if s is not None}
        return LearningTestResult(outputs_cpu_s=seconds, **shared)

    door = door_config(dict(task.door_config))
    if shared["error"]:
        shared["metrics"] = {} if shared["lost"] else _CLOSED_BY_ERROR
    radius = shared["metrics"].get("radius", door.radius)
    shown: dict[str, Any] = dict(task.demonstrated_kind or {})
    if door != DoorConfig(radius=door.radius, **shown):
        split = NON_STANDARD
    elif any(abs(radius - each) < _SAME_RADIUS for each in task.demonstrated_radii):
        split = DEMONSTRATED
    else:
        split = UNDEMONSTRATED
    return EpisodeResult(
        radius=radius,
        demonstrations=str(record.get("demonstrations", "")),
        drawn=door_randomization(task.randomization).radius is not None,
        split=split,
        door_kind=door_kind(door),
        **shared,
    )


def _task(fields: Mapping[str, Any]) -> Task:
    """Return the task of a file whose every field has been checked."""
    kind = entry(fields, "kind", str)
    if kind not in _REQUIRED:
        raise ValueError(f"kind = {kind[:_LONGEST]!r} must be one of {[*_REQUIRED]}")
    for name, type_ in _REQUIRED[kind].items():
        value = entry(fields, name, type_)
        if type_ is str and not (value.isprintable() and 0 < len(value) <= _LONGEST):
            raise ValueError(f"{name} = {value[:_LONGEST]!r} is not a name in one line")
        if type_ is int and value < 0:
            raise ValueError(f"{name} = {value} must be 0 or more")
    for name in _OPTIONAL.keys() & fields.keys():
        entry(fields, name, _OPTIONAL[name])
    task = task_from(fields)
    if isinstance(task, EpisodeTask):
        door_randomization(task.randomization)
        disturbance_named(task.disturbance)
        Habits(**(task.habits or {}))
    elif isinstance(task, SkillTask) and task.held_out not in HELD_OUT:
        raise ValueError(f"held_out must be one of {HELD_OUT}, got {task.held_out!r}")
    return task


def _condition(task: TaughtTask) -> Condition:
    """Return what a task shares with others of its table."""
    noise = TeacherConfig(**task.teacher).wobble_position_std
    taught = Condition(
        demonstrations_per_door=task.demonstrations_per_door,
        teacher_noise=round(noise / TeacherConfig().wobble_position_std, 6),
        randomization="none",
        demonstrated_forces=task.demonstrated_forces,
    )
    if not isinstance(task, EpisodeTask):
        return taught

    def named(spec: str | Mapping[str, Any]) -> str:
        return spec if isinstance(spec, str) else json.dumps(spec)

    return dataclasses.replace(
        taught,
        randomization=named(task.randomization),
        disturbance=named(task.disturbance),
        start=task.start,
        robot=task.robot,
        trial=task.trial,
        level=task.level,
    )
