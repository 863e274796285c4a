"""Settings of a run by a user; has no slow imports, for ``--help``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeSettings:
    """Policy, doors and circumstances of episodes."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters."""

    policy: str = "gp"
    """Policy to use: a name from `gplfd list`, or module:function for your own."""

    seed: int = 0
    """Seed of teacher, policy and environment, 0 or more."""

    randomization: str = "none"
    """Quantities that are drawn at random for each episode: none, mild, hard,
    standard, or detector (with start approach); see `gplfd list`."""

    start: Literal["grasped", "approach"] = "grasped"
    """State at the start: the hand holds the handle, or the open hand is 10 to 20 cm
    in front of it and first reaches for it."""

    robot: str = "tiago-like"
    """Robot that opens the door: tiago-like, panda-like, ur5e-like, or a .urdf or
    .json of an arm (docs/environment.md), on a stand or, if needed, a mobile base."""

    demonstrations_per_door: int = 2
    """Number of demonstrations by the synthetic human on each of the three
    demonstrated doors."""

    demonstrated_forces: bool = False
    """Demonstrations of the synthetic human include forces and moments of the hand."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSettings(EpisodeSettings):
    """What a run opens, what its policy learns from, and what it draws."""

    disturbance: str = "none"
    """Disturbance during the episode: none, push, person, ...; see `gplfd list`."""

    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = None
    """Learn from this .npz file of demonstrations instead of the synthetic human."""

    skill: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Use this skill, a file written by `gplfd learn`, instead of learning one."""

    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Also write a video of the episode in real time; for several doors, one file per
    door, FILE-DOOR.mp4. Needs pip install 'gplfd[video]'."""
