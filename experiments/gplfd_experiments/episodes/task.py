"""What defines an episode: policy, demonstrations, door, circumstances and seed.

A task is named by the hash of its definition, so that a study can be interrupted,
resumed and extended without repeating a task. The code is no part of the name.
`gplfd_experiments.episodes.build` makes environment and agents from it.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final, Literal

from gplfd_env.conventions.constants import Base, Start
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.stance import base_for
from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    doors_like,
    standard_teacher,
)
from gplfd_experiments.episodes.doors import reset_seed

PolicySource = Mapping[str, str]
"""``kind`` ("module" or "package"), ``distribution`` and ``version`` of a package, name
and ``sha256`` of the ``file``."""


_OMIT_DEFAULT: Final = "omit_default"
"""Key of the metadata of fields that are left out of a definition at their default."""


def omit_default(default: Any) -> Any:
    """Return a field that a task's definition holds only where it is not the default.

    A field that is added later must be one: tasks of earlier versions keep their hash.
    """
    return field(default=default, metadata={_OMIT_DEFAULT: True})


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """The smallest part of a study; what all kinds of tasks have in common."""

    policy: str
    """Name of the policy."""
    seed: int
    """Seed of everything that is drawn."""
    policy_source: PolicySource | None = omit_default(None)
    """What names the content of a policy that is not this project's."""

    @property
    def definition(self) -> dict[str, Any]:
        """Everything that defines the task, as a result file has it."""
        optional = {
            one.name: one.default
            for one in dataclasses.fields(self)
            if one.metadata.get(_OMIT_DEFAULT)
        }
        return {
            name: value
            for name, value in dataclasses.asdict(self).items()
            if name not in optional or value != optional[name]
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
    """Fields of `gplfd_experiments.data.teacher.TeacherConfig`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTask(TaughtTask):
    """One door opened once."""

    door: str
    """Name of the door."""
    door_config: Mapping[str, Any]
    """Of the door, `gplfd_env.doors.config.DoorConfig.as_dict`."""
    randomization: str | Mapping[str, Any] = "none"
    """What `gplfd_env.doors.randomization.door_randomization` takes."""
    disturbance: str | Mapping[str, Any] = omit_default("none")
    """What `gplfd_env.doors.disturbance.disturbance_named` takes."""
    demonstrated_radii: Sequence[float] = omit_default(DEMONSTRATED_RADII)
    """Radii of the doors that the teacher opens [m]."""
    demonstrated_kind: Mapping[str, str] | None = omit_default(None)
    """`DoorConfig.kind` of those; None for furniture doors with a bar."""
    base: Base = omit_default("fixed")
    """Whether the robot drives."""
    environment_version: int = omit_default(0)
    """Version of the environment's physics; 0 for a fixed base, whose physics are the
    same in all versions."""
    start: Start = omit_default("grasped")
    """Whether the hand holds the handle at the start or has to reach for it."""
    habits: Mapping[str, Any] | None = omit_default(None)
    """Fields of `gplfd_experiments.data.teacher.Habits`; None for a tidy teacher."""
    prior_radius: float | None = omit_default(None)
    """Radius of the arc that is given as a prior mean [m]; None for none."""
    trial: str = omit_default("")
    """Name of the trial that it belongs to; "" for none."""
    level: str = omit_default("")
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


def episode_task(door: str, config: DoorConfig, **fields: Any) -> EpisodeTask:
    """Return the task to open a door with the robot and the demonstrations it needs.

    The base drives where a fixed one does not reach, and three doors of the same kind
    (handle, latch, swing, hinge side) are demonstrated.

    Args:
        door: Name of the door.
        config: The door.
        fields: Other fields of `EpisodeTask`; they win over what suits the door.

    Raises:
        ValueError: No such task.
    """
    suitable: dict[str, Any] = {"base": base_for(config)}
    if fields.get("base", suitable["base"]) == "mobile":
        suitable["environment_version"] = 1
    if config.kind != DoorConfig().kind:
        suitable["demonstrated_radii"] = [one.radius for one in doors_like(config)]
        suitable["demonstrated_kind"] = config.kind
    return EpisodeTask(
        door=door, door_config=config.as_dict(), **{**suitable, **fields}
    )


_DEMONSTRATED_BY: Final = (
    "seed",
    "demonstrations_per_door",
    "teacher",
    "demonstrated_radii",
    "demonstrated_kind",
    "habits",
    "start",
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
