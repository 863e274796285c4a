"""Read the results of a study from its files, and list those without a result."""

import json
import math
import typing
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any, Final

from gplfd_env.doors import config, disturbance, randomization
from gplfd_experiments.analysis.results.statistics import Key
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.teacher import Habits, TeacherConfig
from gplfd_experiments.episodes.task import EpisodeTask, Task, TaughtTask
from gplfd_experiments.files.plain_data import entry, read_json
from gplfd_experiments.studies import settings, tasks
from gplfd_experiments.studies.store import POLICY_ERROR, STUDY, outcome, read_study

TASKS: Final = "tasks"

DEMONSTRATED, UNDEMONSTRATED = "demonstrated radii", "new radii"
NON_STANDARD: Final = "other doors"
"""Doors that differ in more than the radius: friction, closer or mass."""
SPLITS: Final = (DEMONSTRATED, UNDEMONSTRATED, NON_STANDARD)
"""Relations of doors to the demonstrated ones of their kind, in display order."""

_TYPES: Final = {kind: typing.get_type_hints(kind) for kind in tasks.KINDS.values()}
_SAME_RADIUS: Final = 1e-3  # Radii that differ by less count as equal [m].
_BAND: Final = 0.1  # Width of a band of random radii [m].
_CLOSED_BY_ERROR: Final[Mapping[str, Any]] = {
    "success": False,
    "failure": POLICY_ERROR,
    "final_angle_deg": 0.0,
    "forecast_progress": (),
    "forecast_error_mm": (),
}
"""Metrics of an episode in which the policy raised an error."""


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """The result of one task: of an episode, or of a learning test."""

    task: Task
    policy: str
    """Name of the policy."""
    pair: str
    """Key of the task without its policy: results with the same key are a pair."""
    key: Key
    """Seed, and the key of the task among those of all policies."""
    left_out: str
    """What a learning test left out: demonstration, radius or recording."""
    metrics: Mapping[str, Any]
    """Numbers are finite or None."""
    error: str
    """Why there is no measurement; "" if there is one."""
    lost: bool
    """Whether the machine failed, not the policy; it is excluded everywhere."""
    counts: bool
    """Whether it is part of rates, medians and comparisons: neither lost, nor a
    learning test with an error."""
    code: str
    machine: str
    """CPU and libraries that determine the last bits of the result; "" if unknown."""
    policy_source: str
    """Source of a policy that is not part of this project; else ""."""
    condition: settings.Condition | None
    """Condition that this task shares with others in the same table; None for a
    learning test on the user's recordings."""

    def number(self, name: str) -> float | None:
        """Return a metric or None; a policy that raises an error keeps no grasp."""
        if name == "grasp_kept" and "failure" in self.metrics:
            return float(self.metrics["failure"] not in ("grasp_lost", POLICY_ERROR))
        value: float | None = self.metrics.get(name)
        return value


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeResult(TaskResult):
    """The result of an episode; an error of the policy counts as a closed door."""

    task: EpisodeTask
    radius: float
    """Distance from hinge to handle [m], as drawn."""
    demonstrations: str
    """Hash of the demonstrations, rounded to a micrometre; "" if unknown."""
    drawn: bool
    """Whether the radius is drawn at random."""
    split: str
    """Relation of the door to the demonstrated ones, one of `SPLITS`."""
    door_kind: str
    door: str
    """Name of the door with its radius; for a random radius, with its band."""
    solved: bool
    """Whether the door was held at 60 degrees with the handle in the hand."""

    def opened(self, angle: int = 60) -> bool:
        """Return whether the door ever reached 15, 30 or 60 degrees."""
        return self.number(f"time_to_{angle}_deg") is not None

    @property
    def failure(self) -> str:
        """Why the task was not solved, as the environment names it."""
        return str(self.metrics["failure"]).replace("_", " ") or "no reason given"


@dataclass(frozen=True, kw_only=True, slots=True)
class StudyResults:
    """All results of a folder, ordered by policies, conditions, doors, seeds."""

    study: Mapping[str, Any]
    """Content of study.json; empty without the file."""
    episodes: tuple[EpisodeResult, ...]
    tests: tuple[TaskResult, ...]
    """Learning tests on left-out demonstrations of the synthetic human."""
    recorded: tuple[TaskResult, ...]
    """Learning tests on left-out recordings of the user."""
    unreadable: tuple[str, ...]
    """Names of files without a result, with the reason."""
    all: tuple[TaskResult, ...]
    """Episodes, learning tests, and recordings left out."""


def read_results(*folders: Path) -> StudyResults:
    """Read the results of a study, or of several together.

    A resumed study keeps the files of earlier policies and environments; these results
    are excluded. `StudyResults.study` is that of the first folder.
    """
    results: list[TaskResult] = []
    origins: dict[str, int] = {}
    studies: list[Mapping[str, Any]] = []
    unreadable: list[str] = []
    for number, folder in enumerate(folders):
        if not folder.is_dir():
            raise FileNotFoundError(f"there is no folder {folder}; give a study's")
        # Names of unfinished files begin with a dot.
        files = sorted((folder / TASKS).glob("[!.]*.json"))
        if not files:
            raise ValueError(f"{folder} is not a study: it has no {TASKS}/*.json")
        here, problems = read_files(files)
        if not here:
            raise ValueError(
                f"none of the {len(files)} files in {folder / TASKS} holds a result; "
                f"the first: {problems[0]}"
            )
        unreadable += problems
        sources: dict[str, Any] = {}
        studies.append({})
        try:
            if (file := folder / STUDY).exists():
                studies[-1] = read_study(folder)
                for about in (*studies[-1].get("earlier", ()), studies[-1]):
                    config = entry({"config": {}, **about}, "config", dict[str, Any])
                    sources |= config.get("policy_sources", {})
        except (OSError, ValueError, TypeError) as error:
            unreadable.append(_reason(file, error))
        current = []
        for result in here:
            if (other := origins.setdefault(result.task.key, number)) != number:
                raise ValueError(
                    f"{folders[other]} and {folder} both hold results of "
                    f"{result.policy}; leave out one of the folders"
                )
            source = result.task.policy_source
            if source is None or source == sources.get(result.policy, source):
                current.append(result)
        results += current
        if earlier := len(here) - len(current):
            text = "warning: %s: %d results of policies before a change are left out"
            LOG.warning(text, folder, earlier)
    results.sort(
        key=lambda result: (
            *(result.policy, str(result.condition), getattr(result, "radius", 0.0)),
            *(getattr(result.task, "door", result.left_out), result.key),
        )
    )
    opened = tuple(r for r in results if isinstance(r, EpisodeResult))
    tests = tuple(r for r in results if isinstance(r.task, tasks.SkillTask))
    recorded = tuple(r for r in results if isinstance(r.task, tasks.RecordedTask))
    return StudyResults(
        study=studies[0],
        episodes=opened,
        tests=tests,
        recorded=recorded,
        unreadable=tuple(unreadable),
        all=(*opened, *tests, *recorded),
    )


def read_files(files: Iterable[Path]) -> tuple[list[TaskResult], list[str]]:
    """Read results, and list files without a result, with the reason."""
    results, unreadable = list[TaskResult](), list[str]()
    for file in files:
        try:
            results.append(_result(read_json(file)))
        except (OSError, ValueError, TypeError) as error:
            unreadable.append(_reason(file, error))
    return results, unreadable


def _reason(file: Path, error: Exception) -> str:
    missing = isinstance(error, FileNotFoundError)
    text = "there is no such file" if missing else " ".join(str(error).split())
    return f"{file.name}: {text.replace(str(file), 'it')[:200]}"


def _result(record: Mapping[str, Any]) -> TaskResult:
    """Return the result in a file; raise an error if it is invalid."""
    definition = entry(record, "task", dict[str, Any])
    task = tasks.task_from(definition)
    for name in definition:
        entry(definition, name, _TYPES[type(task)][name])
    metrics: Mapping[str, Any] = outcome(record, task)
    error = str(record.get("error", "")) or ("" if metrics else "no reason given")
    lost = entry({"lost": False, **record}, "lost", bool)
    versions = entry({"versions": {}, **record}, "versions", dict[str, str])
    code = [f"{name} {version}" for name, version in versions.items()]
    git = entry({"git": None, **record}, "git", dict[str, str | bool | None] | None)
    if git is not None:
        edited = " with edits" if git.get("dirty") else ""
        code.insert(0, f"commit {str(git.get('commit'))[:12]}{edited}")
    # What the task shares with others of its table.
    condition, common = None, dict[str, Any](randomization="none")
    if isinstance(task, TaughtTask):
        for field in fields(settings.Condition):
            if (value := getattr(task, field.name, None)) is not None:
                of_file = isinstance(value, Mapping)
                common[field.name] = json.dumps(value) if of_file else value
        noise, usual = TeacherConfig(**task.teacher), TeacherConfig()
        ratio = round(noise.wobble_position_std / usual.wobble_position_std, 6)
        condition = settings.Condition(teacher_noise=ratio, **common)
    pair = replace(task, policy="", policy_source=None).key
    shared: dict[str, Any] = {
        "task": task,
        "policy": task.policy,
        "pair": pair,
        "key": (task.seed, pair),
        "left_out": getattr(task, "held_out", "recording"),
        "error": error,
        "lost": lost,
        "counts": not (lost if isinstance(task, EpisodeTask) else error),
        "code": ", ".join(code) if versions else "unknown code",
        "machine": str(record.get("arithmetic", "")),
        "policy_source": ", ".join(
            f"{name} {value}" for name, value in (task.policy_source or {}).items()
        ),
        "condition": condition,
    }
    if not isinstance(task, EpisodeTask):
        return TaskResult(metrics=metrics, **shared)

    disturbance.disturbance_named(task.disturbance)
    Habits(**(task.habits or {}))
    door = config.door_config(dict(task.door_config))
    if error:
        metrics = {} if lost else _CLOSED_BY_ERROR
    radius = metrics.get("radius", door.radius)
    demonstrated: dict[str, Any] = dict(task.demonstrated_kind or {})
    split = UNDEMONSTRATED
    if door != config.DoorConfig(radius=door.radius, **demonstrated):
        split = NON_STANDARD
    elif any(abs(radius - taught) < _SAME_RADIUS for taught in task.demonstrated_radii):
        split = DEMONSTRATED
    drawn = randomization.door_randomization(task.randomization).radius is not None
    low = _BAND * math.floor(radius / _BAND + 1e-9)
    name = f"{low:.1f}–{low + _BAND:.1f} m" if drawn else task.door
    try:
        float(task.door)
    except ValueError:
        name = name if drawn else f"{name} {radius:g}"
    # All properties of the door that determine its motion.
    latch = "" if door.latch == "none" else f" with {door.latch} latch"
    side = {"right": "", "left": ", hinge on the left"}.get(
        door.hinge_side, f", hinge at the {door.hinge_side}"
    )
    motion = "" if door.motion == "hinged" else f"{door.motion}, "
    return EpisodeResult(
        metrics=metrics,
        radius=radius,
        demonstrations=str(record.get("demonstrations", "")),
        drawn=drawn,
        split=split,
        door_kind=f"{motion}{door.handle}{latch}, {door.swing}{side}",
        door=name,
        solved=bool(metrics.get("success")),
        **shared,
    )
