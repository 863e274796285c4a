"""What a study consists of: episodes and learning tests, each named by its hash.

A task is named by the hash of what defines it, so that a study can be interrupted,
resumed and extended without repeating a task. The code is no part of the name.
"""

import dataclasses
import hashlib
import json
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from gplfd.experiments.episodes.doors import reset_seed
from gplfd.experiments.learning_tests.folds import HeldOut
from gplfd.experiments.teacher import DEMONSTRATED_RADII, standard_teacher
from gplfd_env.task import Base

Result = dict[str, Any]
"""What a task came to: the ``format`` and ``format_version`` of the file, ``task``, the
``versions`` and ``git`` of the code that made it, and ``metrics`` or, where the task
failed, ``error``, ``traceback`` and, where the machine failed it, ``lost``."""


PolicySource = Mapping[str, str]
"""``kind`` ("module" or "package"), ``distribution`` and ``version`` of a package, name
and ``sha256`` of the ``file``."""


_SELDOM: Final = "seldom"
"""Key of the metadata of fields that most tasks leave at their default."""


def _seldom(default: Any) -> Any:
    return field(default=default, metadata={_SELDOM: True})


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The smallest part of a study; what all kinds of tasks have in common."""

    policy: str
    """Name of the policy."""
    seed: int
    """Seed of everything that is drawn."""
    policy_source: PolicySource | None = _seldom(None)
    """What names the content of a policy that is not this project's."""

    @property
    def definition(self) -> dict[str, Any]:
        """Everything that defines the task, as a result file has it.

        What most tasks have not is left out of the others.
        """
        seldom = {
            one.name: one.default
            for one in dataclasses.fields(self)
            if one.metadata.get(_SELDOM)
        }
        return {
            name: value
            for name, value in dataclasses.asdict(self).items()
            if name not in seldom or value != seldom[name]
        }

    @property
    def training(self) -> str:
        """What the policy learns from, and which policy: equal texts learn the same."""
        fields = self.definition
        for name in _OF_THE_DOOR:
            fields.pop(name, None)
        return json.dumps(fields, sort_keys=True)

    @property
    def key(self) -> str:
        """Hash of the definition."""
        text = json.dumps(self.definition, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True, slots=True)
class TaughtTask(Task):
    """A task whose policy learns from the synthetic human."""

    demonstrations_per_door: int = 2
    """How often the teacher opens each of the three demonstrated doors."""
    teacher: Mapping[str, float] = field(default_factory=standard_teacher)
    """Fields of `gplfd.experiments.teacher.TeacherConfig`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTask(TaughtTask):
    """One door opened once."""

    door: str
    """Name of the door."""
    door_config: Mapping[str, Any]
    """Of the door, `gplfd_env.config.DoorConfig.as_dict`."""
    randomization: str | Mapping[str, Any] = "none"
    """What `gplfd_env.randomization.door_randomization` takes."""
    disturbance: str | Mapping[str, Any] = _seldom("none")
    """What `gplfd_env.disturbance.disturbance_named` takes."""
    demonstrated_radii: Sequence[float] = _seldom(DEMONSTRATED_RADII)
    """Radii of the doors that the teacher opens [m]."""
    demonstrated_kind: Mapping[str, str] | None = _seldom(None)
    """`DoorConfig.kind` of those; None for furniture doors with a bar."""
    base: Base = _seldom("fixed")
    """Whether the robot drives."""
    habits: Mapping[str, Any] | None = _seldom(None)
    """Fields of `gplfd.experiments.teacher.Habits`; None for a tidy teacher."""
    prior_radius: float | None = _seldom(None)
    """Radius of the arc that is given as a prior mean [m]; None for none."""
    trial: str = _seldom("")
    """Name of the trial that it belongs to; "" for none."""
    level: str = _seldom("")
    """Level of the trial."""
    kind: Literal["episode"] = field(default="episode", init=False)
    """What tells it from other tasks in a file."""

    def __post_init__(self) -> None:
        # A file has a list.
        radii = tuple(self.demonstrated_radii)
        object.__setattr__(self, "demonstrated_radii", radii)

    @property
    def shown(self) -> str:
        """What is demonstrated, as JSON: equal texts, equal demonstrations."""
        fields = {name: getattr(self, name) for name in _DEMONSTRATED_BY}
        return json.dumps(fields, sort_keys=True)

    @property
    def reset_seed(self) -> int:
        """Seed of the environment's reset."""
        drawn = not self.randomization == self.disturbance == "none"
        return reset_seed(self.seed, self.door, drawn=drawn)


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTask(TaughtTask):
    """What a policy learned, held against demonstrations it did not see; no robot."""

    held_out: HeldOut
    """What the policy does not see."""
    kind: Literal["skill"] = field(default="skill", init=False)
    """What tells it from other tasks in a file."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordedTask(Task):
    """What a policy learned from recordings, held against the one it did not see.

    The recording with the number `seed` is left out.
    """

    recordings: str
    """Hash of all of them, `gplfd.experiments.datasets.npz.hash_of`."""
    kind: Literal["recorded"] = field(default="recorded", init=False)
    """What tells it from other tasks in a file."""


_DEMONSTRATED_BY: Final = (
    "seed",
    "demonstrations_per_door",
    "teacher",
    "demonstrated_radii",
    "demonstrated_kind",
    "habits",
)
"""Fields of an episode that say what is demonstrated."""

_OF_THE_DOOR: Final = (
    "door",
    "door_config",
    "randomization",
    "disturbance",
    "trial",
    "level",
)
"""Fields of an episode that are no matter of learning."""

Job = tuple[Task, ...]
"""Tasks that one worker runs together: episodes of one policy that learned once, or a
single learning test."""

_KINDS: Final[Mapping[str, type[Task]]] = {
    "episode": EpisodeTask,
    "skill": SkillTask,
    "recorded": RecordedTask,
}


def task_from(record: Mapping[str, Any]) -> Task:
    """Return the task of a result: the inverse of `Task.definition`.

    Raises:
        ValueError: The record is not that of a task.
    """
    fields = dict(record)
    try:
        kind = _KINDS[fields.pop("kind")]
        known = {field.name for field in dataclasses.fields(kind)}
        if unknown := sorted(fields.keys() - known):
            raise ValueError(
                f"not a task of a study: unknown field {unknown[0]!r:.40}; perhaps a "
                "later version of gplfd wrote it"
            )
        return kind(**fields)
    except (KeyError, TypeError) as error:
        reason = f"not a task of a study: {error!r:.100} in {record!r:.200}"
        raise ValueError(reason) from error


def jobs_of(study: Iterable[Task]) -> tuple[Job, ...]:
    """Group tasks by what they learn from, in the order in which they come.

    What a task comes to does not depend on the others of its job.
    """
    groups: dict[str, dict[str, Task]] = {}
    for task in study:
        groups.setdefault(task.training, {})[task.key] = task
    return tuple(tuple(group.values()) for group in groups.values())
