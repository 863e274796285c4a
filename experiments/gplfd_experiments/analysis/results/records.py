"""Results of a study as records: episodes, learning tests, errors."""

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, Final

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.results.statistics import Key
from gplfd_experiments.episodes.failures import failure_name
from gplfd_experiments.episodes.task import EpisodeTask, Task
from gplfd_experiments.studies.settings import Condition
from gplfd_experiments.studies.tasks import RecordedTask, SkillTask

DEMONSTRATED: Final = "demonstrated radii"
UNDEMONSTRATED: Final = "new radii"
NON_STANDARD: Final = "other doors"
"""Doors that differ in more than the radius: more friction, a closer, another mass."""
SPLITS: Final = (DEMONSTRATED, UNDEMONSTRATED, NON_STANDARD)
"""How doors relate to the demonstrated ones of their kind, in the order shown."""


def door_kind(door: DoorConfig) -> str:
    """Return the kind of a door in words: all that decides by which motion it opens."""
    latch = "" if door.latch == "none" else f" with {door.latch} latch"
    side = "" if door.hinge_side == "right" else f", hinge {_WHERE[door.hinge_side]}"
    motion = "" if door.motion == "hinged" else f"{door.motion}, "
    return f"{motion}{door.handle}{latch}, {door.swing}{side}"


_WHERE: Final = {"left": "on the left", "bottom": "at the bottom", "top": "at the top"}


@dataclass(frozen=True, kw_only=True, slots=True)
class TaskResult:
    """What is known of one task after it ran."""

    task: Task
    pair: str
    """Key of the task without its policy: results with the same key are a pair."""
    metrics: Mapping[str, Any]
    """Numbers are finite or None; an older result lacks what was added since."""
    error: str
    """Why nothing was measured; "" if something was."""
    lost: bool
    """Whether the machine failed, not the policy: such a task counts nowhere."""
    code: str
    machine: str
    """CPU and libraries that determine the last bits of the result; "" if unknown."""
    policy_source: str
    """Where the policy came from, for one that is not this project's; else ""."""

    @property
    def policy(self) -> str:
        """Name of the policy."""
        return self.task.policy

    @property
    def key(self) -> Key:
        """Seed, and what names the task among those of all policies."""
        return self.task.seed, self.pair

    @property
    def counts(self) -> bool:
        """Whether it is part of rates, medians and comparisons."""
        return not self.error

    def number(self, name: str) -> float | None:
        """Return a metric; None where it is missing."""
        value: float | None = self.metrics.get(name)
        return value


@dataclass(frozen=True, kw_only=True, slots=True)
class TaughtResult(TaskResult):
    """What is known of a task whose policy learned from the synthetic human."""

    condition: Condition
    """What this task shares with others of the same table."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeResult(TaughtResult):
    """What is known of an episode.

    Where the policy raised an error, in learning or acting, the door was not opened:
    the episode counts as a failure, ``policy_error``, with a door that is closed.
    """

    task: EpisodeTask
    radius: float
    """Distance from hinge to handle [m], as drawn."""
    demonstrations: str
    """Hash of what was learned from, to a micrometre; "" if unknown."""
    drawn: bool
    """Whether the radius is drawn at random."""
    split: str
    """How the door relates to the demonstrated ones, one of `SPLITS`."""
    door_kind: str

    @property
    def counts(self) -> bool:
        """Whether it is part of rates and comparisons: unless the machine failed."""
        return not self.lost

    def opened(self, angle: int = 60) -> bool:
        """Return whether the door was ever open by 15, 30 or 60 degrees."""
        return self.number(f"time_to_{angle}_deg") is not None

    @property
    def solved(self) -> bool:
        """Whether the door was held open by 60 degrees, the handle in the hand."""
        return bool(self.metrics.get("success"))

    @property
    def failure(self) -> str:
        """Why the task was not solved, as the environment names it."""
        return failure_name(str(self.metrics["failure"]), "no reason given")


@dataclass(frozen=True, kw_only=True, slots=True)
class LearningTestResult(TaughtResult):
    """How well a policy predicted demonstrations that it did not see."""

    task: SkillTask
    outputs_cpu_s: Mapping[int, float]
    """CPU time to learn by number of outputs [s]; empty where it was not measured."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedResult(TaskResult):
    """How well a policy predicted a recording that it did not see."""

    task: RecordedTask


@dataclass(frozen=True, kw_only=True, slots=True)
class StudyResults:
    """All that a folder holds, in the order of policies, conditions, doors, seeds."""

    study: Mapping[str, Any]
    """What study.json says; empty without one."""
    episodes: tuple[EpisodeResult, ...]
    tests: tuple[LearningTestResult, ...]
    recorded: tuple[RecordedResult, ...]
    unreadable: tuple[str, ...]
    """Names of files that hold no result, with the reason."""

    @property
    def all(self) -> tuple[TaskResult, ...]:
        """Episodes, learning tests, and recordings left out."""
        return (*self.episodes, *self.tests, *self.recorded)
