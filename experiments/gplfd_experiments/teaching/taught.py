"""Taught demonstrations and a corrected skill on disk, saved when a person keeps them.

A set of demonstrations is a folder with `demonstrations.npz`, like every set, and the
folder `taught` with the complete recordings. Demonstrations that are missing in the
file are added when the set is next opened, so that no kept demonstration is lost.
"""

import json
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
from jaxtyping import Float

from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.files.plain_data import entry
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.arrays.storage import Members, read_archive, settings, write_archive
from gplfd_policies.demonstrations.alignment import without_rests
from gplfd_policies.demonstrations.demonstration import Correction, Demonstration
from gplfd_policies.demonstrations.npz import FILE, save_demonstrations
from gplfd_policies.movements.movement import Movement
from gplfd_policies.movements.skill import Skill
from gplfd_policies.registry.method import Method

_FOLDER: Final = "taught"  # Folder of a set with a file per demonstration.
_KIND: Final = "a gplfd taught demonstration"
_VERSION: Final = 1


@dataclass(frozen=True, kw_only=True, slots=True)
class Taught:
    """A demonstration of a person at a door, with the inputs."""

    name: str
    """Name of the door."""
    door: DoorConfig
    inputs: Float[np.ndarray, "N 9"]
    """A sample of the device per control period, `teaching.lead.INPUTS`."""
    recorded: Demonstration
    """Motion and wrenches of the hand, N + 1 samples from the closed handle on."""
    among: tuple[str, ...] = ()
    """Doors as given by ``--doors``; stored with a kept demonstration."""

    @property
    def demonstration(self) -> Demonstration:
        """Demonstration for learning: without pauses, relative to its first pose."""
        return without_rests(self.recorded)[0].relative_to_first()


class TaughtSet:
    """The demonstrations in a folder, to which more are added.

    Raises ValueError if the folder holds something else or a file is damaged, and
    OSError if it cannot be written.
    """

    def __init__(self, folder: Path, options: Mapping[str, Any]) -> None:
        check_folder(folder)
        if (
            folder.exists()
            and any(folder.iterdir())
            and not (folder / _FOLDER).exists()
        ):
            raise ValueError(
                f"{folder} exists and is no set of gplfd demos teach; give another "
                "folder"
            )
        self.place, self._options = folder, options
        self.kept = read_taught(folder)
        if self.kept:
            self._write_index()

    def keep(self, taught: Taught) -> None:
        """Save a demonstration."""
        numbers = [int(file.stem) for file in _files(self.place)]
        arrays = {
            "door": np.array(json.dumps({taught.name: taught.door.as_dict()})),
            "origin": np.array(json.dumps(provenance(self._options))),
            "inputs": taught.inputs,
            "times": taught.recorded.times,
            "poses": taught.recorded.poses,
            "wrenches": taught.recorded.wrenches,
        }
        file = self.place / _FOLDER / f"{max(numbers, default=0) + 1:04d}.npz"
        write_archive(file, kind=_KIND, version=_VERSION, arrays=arrays)
        self.kept.append(taught)
        try:
            self._write_index()
        except OSError:  # It can be kept again, but not stored twice.
            self.kept.pop()
            file.unlink()
            raise

    def _write_index(self) -> None:
        save_demonstrations(
            self.place / FILE,
            [taught.demonstration for taught in self.kept],
            [taught.door.radius for taught in self.kept],
        )


def read_taught(folder: Path) -> list[Taught]:
    """Return the demonstrations of a set, in the order in which they were kept.

    Raises a ValueError that names the file if one is damaged.
    """
    return [
        read_archive(file, kind=_KIND, version=_VERSION, build=_taught)
        for file in _files(folder)
    ]


def _files(folder: Path) -> list[Path]:
    return sorted((folder / _FOLDER).glob("[0-9]*.npz"))


def _taught(members: Members) -> Taught:
    [(name, door)] = settings(members["door"]).items()
    config = entry(settings(members["origin"]), "config", dict[str, Any])
    among = entry({"doors": []} | config, "doors", tuple[str, ...])
    inputs = members["inputs"]
    times, poses, wrenches = map(members.__getitem__, ("times", "poses", "wrenches"))
    if inputs.shape != (len(times) - 1, 9):
        raise ValueError(f"inputs have shape {inputs.shape} for {len(times)} poses")
    return Taught(
        name=name,
        door=door_config(door),
        inputs=inputs,
        recorded=Demonstration(times=times, poses=poses, wrenches=wrenches),
        among=among,
    )


class CorrectedSkill:
    """A skill that learns from corrections, and its file."""

    def __init__(self, method: Method, skill: Skill, place: Path) -> None:
        self.method, self.place = method, place
        self.skill: Movement = skill
        self.kept: list[Correction] = []

    def keep(self, correction: Correction) -> None:
        """Learn from a correction, and save skill and correction."""
        skill = self.method.update(self.skill, correction)
        if isinstance(skill, Skill):
            skill.save(self.place)
        self.skill = skill
        self.kept.append(correction)
