"""Tasks: policy, demonstrations, door, circumstances and seed of an episode.

A task is named by the hash of its definition, so that a study can be interrupted,
resumed and extended without repeating a task. The name does not depend on the code.
`gplfd_experiments.episodes.build` makes environment and agents from a task.
"""

import dataclasses
import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, Final, Literal

from gplfd_env.conventions.constants import Base, Start
from gplfd_env.doors.config import DOORS, DoorConfig, door_config
from gplfd_env.doors.randomization import door_randomization, seed_of_door
from gplfd_env.robot.placement import base_for, check_reach
from gplfd_env.robot.robots import RobotSpec, robot_named
from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    doors_like,
    standard_teacher,
)
from gplfd_experiments.files.plain_data import read_json

PolicySource = Mapping[str, str]
"""``kind`` ("module" or "package"), ``distribution`` and ``version`` of a package, name
and ``sha256`` of the ``file``."""


def omit_default(default: Any) -> Any:
    """Return a field that a task's definition omits if it has its default.

    New fields must be of this kind, so that earlier tasks keep their hash.
    """
    return field(default=default, metadata={"omitted": default})


_DEMONSTRATED_BY: Final = (
    *("seed", "demonstrations_per_door", "teacher", "demonstrated_radii"),
    *("demonstrated_kind", "demonstrated_hardware", "habits", "demonstrated_forces"),
    *("start", "taught_by"),
)
"""Fields of an episode that determine the demonstrations."""

_OF_THE_DOOR: Final = (
    *("door", "door_config", "trial", "level", "randomization", "disturbance"),
)
"""Fields of an episode that do not affect learning."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Task:
    """Smallest part of a study; the fields that all kinds of tasks have."""

    policy: str
    seed: int
    """Seed of all random numbers."""
    policy_source: PolicySource | None = omit_default(None)
    """Identification of the source of a policy from outside this project; else None."""

    @property
    def definition(self) -> dict[str, Any]:
        """Everything that defines the task, as in a result file."""
        # Not `asdict`, because its copies take most of the start time of a study.
        return {
            item.name: value
            for item in dataclasses.fields(type(self))
            if (value := getattr(self, item.name)) != item.default
            or "omitted" not in item.metadata
        }

    @property
    def training_key(self) -> str:
        """Policy and its demonstrations as JSON; equal texts mean equal learning."""
        fields = self.definition
        learned = {name: fields[name] for name in fields if name not in _OF_THE_DOOR}
        return json.dumps(learned, sort_keys=True)

    @property
    def key(self) -> str:
        """Hash of the definition, which names its result file."""
        text = json.dumps(self.definition, sort_keys=True)
        return hashlib.sha256(text.encode()).hexdigest()[:16]


@dataclass(frozen=True, kw_only=True, slots=True)
class TaughtTask(Task):
    """A task whose policy learns from the synthetic human."""

    demonstrations_per_door: int = 2
    """Number of demonstrations at each of the three demonstrated doors."""
    teacher: Mapping[str, float] = field(default_factory=standard_teacher)
    """Fields of `gplfd_experiments.data.teacher.TeacherConfig`."""
    demonstrated_forces: bool = omit_default(False)
    """Whether the demonstrations have wrenches by the standard
    `gplfd_experiments.data.teacher.ForceConfig`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeTask(TaughtTask):
    """One door opened once."""

    door: str
    door_config: Mapping[str, Any]
    """The door, as `gplfd_env.doors.config.DoorConfig.as_dict` gives it."""
    randomization: str | Mapping[str, Any] = "none"
    """Argument of `gplfd_env.doors.randomization.door_randomization`."""
    disturbance: str | Mapping[str, Any] = omit_default("none")
    """Argument of `gplfd_env.doors.disturbance.disturbance_named`."""
    demonstrated_radii: Sequence[float] = omit_default(DEMONSTRATED_RADII)
    """Radii of the doors that the teacher opens [m]."""
    demonstrated_kind: Mapping[str, str] | None = omit_default(None)
    """`DoorConfig.kind` of these doors; None for furniture doors with a bar."""
    demonstrated_hardware: Sequence[Mapping[str, Any]] = omit_default(())
    """For each of these doors, fields of `DoorConfig` that differ from the default and
    from `demonstrated_kind`; () for none."""
    base: Base = omit_default("fixed")
    robot: str = omit_default("tiago-like")
    """Name of a robot, or path of the URDF of an arm."""
    robot_content: str = omit_default("")
    """Hash of the files of a robot that is not built in."""
    start: Start = omit_default("grasped")
    """Whether the hand holds the handle at the start or has to reach for it."""
    habits: Mapping[str, Any] | None = omit_default(None)
    """Fields of `gplfd_experiments.data.teacher.Habits`; None for a regular teacher."""
    taught_by: Literal["first", "second"] = omit_default("first")
    """The second synthetic human, of `data.teacher.second`, neither reaches for handles
    nor records forces, and has no `habits`; of `teacher` it takes `angle_mean`."""
    prior_radius: float | None = omit_default(None)
    """Radius of the arc that is given as a prior mean [m]; None for none."""
    practice: Mapping[str, Any] | None = omit_default(None)
    """`gplfd_experiments.episodes.leading.Practice` before this episode, or None."""
    trial: str = omit_default("")
    """Name of the trial that it belongs to; "" for none."""
    level: str = omit_default("")
    kind: Literal["episode"] = field(default="episode", init=False)

    def __post_init__(self) -> None:
        # A file contains a list.
        for name in ("demonstrated_radii", "demonstrated_hardware"):
            object.__setattr__(self, name, tuple(getattr(self, name)))

    @property
    def training_key(self) -> str:
        """As for every task, and the error of the handle pose that agents are given."""
        told = door_randomization(self.randomization).perception
        learned = super(EpisodeTask, self).training_key
        return f"{learned} {told}" if any(told) else learned

    @property
    def learner_key(self) -> str:
        """Key of tasks whose policies may learn the same, in scenes of one kind."""
        learner, practises = self.policy.partition("@")[0], self.practice is not None
        scene = self.base, self.robot, self.robot_content, self.start
        return json.dumps([learner, self.policy_source, practises, *scene])

    @property
    def demonstrations_key(self) -> str:
        """Key of the demonstrations as JSON; equal texts mean equal demonstrations."""
        fields = {name: getattr(self, name) for name in _DEMONSTRATED_BY}
        return json.dumps(fields, sort_keys=True)

    @property
    def reset_seed(self) -> int:
        """Seed of the environment's reset.

        If anything is drawn, each door of a seed draws anew, equally for all policies.
        """
        if self.randomization == self.disturbance == "none":
            return self.seed
        return seed_of_door(self.seed, self.door)


def episode_task(door: str, config: DoorConfig, **fields: Any) -> EpisodeTask:
    """Return the task to open a door with the robot and the demonstrations it needs.

    Unless other fields are given, the base is mobile if a fixed base does not reach,
    and three doors of the same kind are demonstrated.
    """
    robot = robot_named(fields.get("robot", "tiago-like"))
    fields = {"base": base_for(config, robot)} | fields
    if (file := Path(fields.get("robot", ""))).suffix:
        files = file.read_bytes() + Path(robot.urdf).read_bytes()
        fields["robot_content"] = hashlib.sha256(files).hexdigest()[:16]
    if config.kind != DoorConfig().kind:
        doors, shapes = doors_like(config), []
        for like in doors:
            # Fields beside radius and kind.
            kind: dict[str, Any] = like.kind
            plain = DoorConfig(radius=like.radius, **kind).as_dict().items()
            whole = like.as_dict().items()
            shapes.append({n: v for n, v in whole if (n, v) not in plain})
        demonstrated: dict[str, Any] = {
            "demonstrated_radii": [like.radius for like in doors],
            "demonstrated_kind": config.kind,
        }
        if any(shapes):
            demonstrated["demonstrated_hardware"] = shapes
        fields = demonstrated | fields
    return EpisodeTask(door=door, door_config=config.as_dict(), **fields)


def named_doors(
    doors: Sequence[str], *, start: Start = "grasped", robot: RobotSpec = "tiago-like"
) -> dict[str, DoorConfig]:
    """Return the configurations of doors by name.

    A door is a preset, a radius [m], or FILE.json with the door argument of `gym.make`.
    """
    if not doors:
        raise ValueError("--doors needs a name, a radius [m] or a .json file")
    configs: dict[str, DoorConfig] = {}
    body = robot_named(robot)
    for door in doors:
        if door.endswith(".json"):
            name = Path(door).stem
            if name in DOORS:
                raise ValueError(f"{door}: {name} is a preset; rename the file")
            try:
                config = door_config(read_json(Path(door)))
            except (ValueError, TypeError) as error:
                raise ValueError(f"{door} holds no door: {error}") from error
        else:
            try:
                radius = float(door)
            except ValueError:
                name, config = door, door_config(door)
            else:
                name, config = f"{radius:g}", door_config(radius)
        if name in configs:
            raise ValueError(f"door {name} is given twice in --doors")
        check_reach(config, body.on(base_for(config, body)), start)
        configs[name] = config
    return configs
