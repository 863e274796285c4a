"""Settings of a study by a user, and the TOML file with them.

Imports of NumPy are in functions, so that ``--help`` is fast.
"""

import dataclasses
import json
import typing
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final, Literal

TABLE_1_NAME: Final = "table-1"
"""Name that stands for the policies of the paper's Table 1."""

# Kind of the file, and version of its keys.
KIND, VERSION = "gplfd study settings", 1


@dataclass(frozen=True, kw_only=True, slots=True)
class StudySettings:
    """Settings that determine the tasks of a study."""

    policies: tuple[str, ...] = (TABLE_1_NAME, "mean", "hinge-fit")
    """Policies to compare: names from `gplfd list`, module:function for your own, or
    ws://HOST:PORT of a server (openpi protocol).
    "table-1" stands for gp and the eight of the paper's Table 1, "table-1@published"
    for the same methods as published. mean and hinge-fit, which learn next to nothing,
    are what a learner has to beat."""

    doors: tuple[str, ...] = ("small", "medium", "large", "0.3", "0.42", "0.58", "0.62")
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters. Small, medium and large (0.35, 0.50, 0.65) are demonstrated."""

    seeds: int = 20
    """Number of seeds: 0, 1, ... Each seed has its own demonstrations."""

    demonstrations_per_door: tuple[int, ...] = (2,)
    """Demonstrations by the synthetic human on each of three doors."""

    teacher_noise: tuple[float, ...] = (1.0,)
    """Noise levels of the synthetic human: multiples of its standard variation in
    motion, grasp offset, drift and sensor noise."""

    demonstrated_forces: bool = False
    """The synthetic human's demonstrations include forces and moments."""

    randomizations: tuple[str, ...] = ("none",)
    """What is drawn at random for each episode; see `gplfd list`."""

    disturbances: tuple[str, ...] = ("none",)
    """Disturbances during episodes; see `gplfd list`."""

    start: Literal["grasped", "approach"] = "grasped"
    """The hand holds the handle, or the open hand first reaches for it."""

    robot: str = "tiago-like"
    """Robot: tiago-like, panda-like, ur5e-like, or a .urdf or .json of an arm
    (docs/environment.md)."""

    skill: bool = True
    """Also predict left-out demonstrations of furniture doors, without a robot."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Condition:
    """The common conditions of all policies, doors and seeds of a table.

    The fields are as in `StudySettings` and, for trials, in a task.
    """

    demonstrations_per_door: int
    teacher_noise: float
    randomization: str
    disturbance: str = "none"
    start: str = "grasped"
    demonstrated_forces: bool = False
    robot: str = "tiago-like"
    robot_content: str = ""
    trial: str = ""
    level: str = ""

    @property
    def teaching(self) -> str:
        """Description of the demonstrations."""
        forces = " with forces" if self.demonstrated_forces else ""
        number = f"{self.demonstrations_per_door} demonstrations{forces} per door"
        return f"{number}, teacher noise × {self.teacher_noise:g}"

    def __str__(self) -> str:
        if self.trial:
            return f"trial {self.trial}, {self.level}"
        text = f"{self.teaching}, randomization {self.randomization}"
        usual = {"disturbance": "none", "start": "grasped", "robot": "tiago-like"}
        for name, value in (*usual.items(), ("robot_content", "")):
            if getattr(self, name) != value:
                text += f", {name} {getattr(self, name)}"
        return text


PRESETS: Final[Mapping[str, StudySettings]] = {
    TABLE_1_NAME: StudySettings(),
    "small": StudySettings(
        policies=("promp", "mean", "gp"), doors=("small", "medium", "large"), seeds=3
    ),
}
"""Studies by name: the whole comparison, and one that takes a minute."""


def settings_named(name: str) -> StudySettings:
    """Return the settings of a preset, or those in a file."""
    # Loads NumPy, which the help of a command does not need.
    from gplfd_env.validation.named import nearest_name

    if name in PRESETS:
        return PRESETS[name]
    if not Path(name).is_file():
        raise ValueError(
            f"--config {name}: there is no such file and no such study"
            f"{nearest_name(name, PRESETS)}; studies: {', '.join(PRESETS)}, or a file"
        )
    return read_settings(Path(name))


def read_settings(path: Path) -> StudySettings:
    """Read settings; missing ones have the defaults of `StudySettings`."""
    from gplfd_env.validation.named import nearest_name
    from gplfd_experiments.files.plain_data import (
        check_stamp,
        entry,
        naming,
        read_toml,
        stamp,
    )

    entries, stamped = read_toml(path), stamp(KIND, VERSION)
    with naming(path):
        check_stamp(stamped | entries, KIND, VERSION)
        # In a file, a radius may be a number.
        kinds = typing.get_type_hints(StudySettings)
        kinds["doors"] = tuple[str | float, ...]
        values: dict[str, Any] = {}
        for name in [name for name in entries if name not in stamped]:
            if name not in kinds:
                raise ValueError(
                    f"unknown key {name!r:.80}{nearest_name(name, kinds)}; keys: "
                    f"{', '.join(kinds)}"
                )
            values[name] = entry(entries, name, kinds[name])
        if "doors" in values:
            values["doors"] = tuple(map(str, values["doors"]))
        return StudySettings(**values)


def write_settings(path: Path, settings: StudySettings) -> None:
    """Write all settings, complete or not at all."""
    from gplfd_experiments.files.plain_data import stamp
    from gplfd_policies.arrays.storage import complete_or_absent

    lines = [f"# gplfd benchmark --config {path.name}"]
    for name, value in (stamp(KIND, VERSION) | dataclasses.asdict(settings)).items():
        # As JSON, except for one character that must be escaped in TOML.
        text = json.dumps(value, allow_nan=False, ensure_ascii=False)
        lines.append(f"{name} = {text}".replace("\x7f", "\\u007f"))
    with complete_or_absent(path) as temporary:
        temporary.write_text("\n".join(lines) + "\n", encoding="utf-8")
