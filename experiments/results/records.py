"""What a study left in its folder, as records: episodes, learning tests, errors.

Only result files are read. Fields that an older study does not have are taken to be
those of the standard study, and a file that cannot be read is named, not fatal.
"""

from __future__ import annotations

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, cast

from experiments.study.settings import Condition
from experiments.teacher import DEMONSTRATED_RADII, standard_teacher
from gplfd_env.config import DoorConfig

STUDY, TASKS = "study.json", "tasks"

_SAME_RADIUS: Final = 1e-3
"""Doors whose radii differ by less are the same to a hand [m]."""
_NOISE: Final = "wobble_position_std"
"""The teacher's noise that tells its level."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Outcome:
    """What one task came to."""

    policy: str
    """Name of the policy."""
    seed: int
    """Seed of teacher, policy and environment."""
    condition: Condition
    """What this task shares with others of the same table."""
    pair: str
    """What the task was, whatever the policy: two outcomes with the same text are a
    pair."""
    task: Mapping[str, Any]
    """The task as the file has it."""
    metrics: Mapping[str, Any] | None
    """What was measured; None for an error."""
    error: str
    """Why nothing was measured; "" if something was."""
    code: str
    """Which code made the result."""

    def number(self, name: str) -> float | None:
        """Return a metric; None where it is missing or not a finite number."""
        return _number((self.metrics or {}).get(name))

    def numbers(self, name: str) -> list[float | None]:
        """Return a metric that is a list; empty where it is missing."""
        values = (self.metrics or {}).get(name)
        return [_number(value) for value in values] if isinstance(values, list) else []


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode(Outcome):
    """One door opened once, or not."""

    door: str
    """Name of the door."""
    radius: float
    """Distance from hinge to handle [m], as drawn."""
    drawn: bool
    """Whether the radius was drawn at random."""
    demonstrated: bool
    """Whether the teacher opened a door of this radius."""
    ordinary: bool
    """Whether the door turns as easily as the demonstrated ones."""

    def opened(self, angle: int = 60) -> bool:
        """Tell whether the door was ever open by 15, 30 or 60 degrees."""
        return self.number(f"time_to_{angle}_deg") is not None

    @property
    def solved(self) -> bool:
        """Whether the door was held open by 60 degrees, the handle in the hand."""
        told = (self.metrics or {}).get("success")
        return self.opened() if told is None and self.metrics else bool(told)


@dataclass(frozen=True, kw_only=True, slots=True)
class LearningTest(Outcome):
    """What a policy learned, held against what it did not see."""

    held_out: str
    """What that was: "demonstration" or "radius"."""


@dataclass(frozen=True, kw_only=True, slots=True)
class StudyResults:
    """All that a folder holds."""

    study: Mapping[str, Any]
    """What study.json says; empty without one."""
    episodes: tuple[Episode, ...]
    """In the order of policies, conditions, doors and seeds."""
    tests: tuple[LearningTest, ...]
    """In the order of policies and seeds."""
    unreadable: tuple[str, ...]
    """Names of files that hold no result, with the reason."""

    @property
    def outcomes(self) -> tuple[Outcome, ...]:
        """Episodes and learning tests."""
        return (*self.episodes, *self.tests)


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
    files = sorted((folder / TASKS).glob("*.json"))
    if not files:
        raise ValueError(
            f"{folder} is not the folder of a study: it has no {TASKS}/*.json. Give "
            "the --out of a `gplfd benchmark`"
        )
    outcomes, unreadable = _outcomes(files)
    if not outcomes:
        raise ValueError(
            f"none of the {len(files)} files in {folder / TASKS} holds a result; "
            f"the first: {unreadable[0]}"
        )
    return StudyResults(
        study=_study(folder / STUDY),
        episodes=tuple(sorted(_of(Episode, outcomes), key=_episode_order)),
        tests=tuple(sorted(_of(LearningTest, outcomes), key=_test_order)),
        unreadable=tuple(unreadable),
    )


def _of(kind: type[Any], outcomes: Sequence[Outcome]) -> list[Any]:
    return [outcome for outcome in outcomes if isinstance(outcome, kind)]


def _episode_order(one: Episode) -> tuple[Any, ...]:
    return one.policy, str(one.condition), one.radius, one.door, one.seed, one.pair


def _test_order(one: LearningTest) -> tuple[Any, ...]:
    return one.policy, str(one.condition), one.held_out, one.seed, one.pair


def _study(path: Path) -> Mapping[str, Any]:
    try:
        study = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError):
        return {}
    return study if isinstance(study, dict) else {}


def _outcomes(files: Sequence[Path]) -> tuple[list[Outcome], list[str]]:
    outcomes: list[Outcome] = []
    unreadable: list[str] = []
    for file in files:
        try:
            outcomes.append(_outcome(json.loads(file.read_text(encoding="utf-8"))))
        except (OSError, ValueError, TypeError, KeyError, AttributeError) as error:
            unreadable.append(f"{file.name}: {type(error).__name__}: {error}")
    return outcomes, unreadable


def _outcome(result: Mapping[str, Any]) -> Outcome:
    task, metrics = result["task"], result.get("metrics")
    if "error" not in result and not isinstance(metrics, dict):
        raise ValueError("neither metrics nor an error")
    shared: dict[str, Any] = {
        "policy": str(task["policy"]),
        "seed": int(task["seed"]),
        "condition": _condition(task),
        "pair": _pair(task),
        "task": task,
        "metrics": None if "error" in result else metrics,
        "error": str(result.get("error", "")),
        "code": _code(result),
    }
    if task.get("kind", "episode") == "skill":
        return LearningTest(held_out=str(task["held_out"]), **shared)
    nominal = float(task["door_config"]["radius"])
    radius = _number((shared["metrics"] or {}).get("radius"))
    radius = nominal if radius is None else radius
    return Episode(
        door=str(task["door"]),
        radius=radius,
        drawn=abs(radius - nominal) > _SAME_RADIUS,
        demonstrated=any(abs(radius - r) < _SAME_RADIUS for r in DEMONSTRATED_RADII),
        ordinary=_ordinary(task["door_config"]),
        **shared,
    )


def _condition(task: Mapping[str, Any]) -> Condition:
    standard = standard_teacher()
    noise = task.get("teacher", {}).get(_NOISE, standard[_NOISE]) / standard[_NOISE]
    return Condition(
        demonstrations_per_door=int(task.get("demonstrations_per_door", 2)),
        teacher_noise=round(float(noise), 6),
        randomization=str(task.get("randomization", "none")),
    )


def _pair(task: Mapping[str, Any]) -> str:
    shared = {"kind": "episode", "randomization": "none", **task}
    del shared["policy"]
    return json.dumps(shared, sort_keys=True)


def _ordinary(config: Mapping[str, float]) -> bool:
    standard = DoorConfig()
    return all(
        value == getattr(standard, name, value)
        for name, value in config.items()
        if name != "radius"
    )


def _code(result: Mapping[str, Any]) -> str:
    git = result.get("git")
    versions = result.get("versions") or {}
    packages = ", ".join(f"{name} {version}" for name, version in versions.items())
    if not git:
        return packages or "unknown code"
    edited = " with edits" if git.get("dirty") else ""
    return f"commit {str(git.get('commit'))[:12]}{edited}, {packages}"


def _number(value: object) -> float | None:
    if not isinstance(value, int | float) or not math.isfinite(value):
        return None
    return float(cast("float", value))
