"""Settings of a run by a user; has no slow imports, for ``--help``."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodeSettings:
    """Policy, doors and circumstances of episodes."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (`gplfd list`), radii [m], or .json files."""

    policy: str = "gp"
    """Policy: a name from `gplfd list`, module:function for your own, or
    ws://HOST:PORT of a server (openpi protocol)."""

    seed: int = 0
    """Seed of teacher, policy and environment, 0 or more."""

    randomization: str = "none"
    """What is drawn at random for each episode; see `gplfd list`."""

    start: Literal["grasped", "approach"] = "grasped"
    """The hand holds the handle, or the open hand first reaches for it."""

    robot: str = "tiago-like"
    """Robot: tiago-like, panda-like, ur5e-like, or a .urdf or .json of an arm
    (docs/environment.md)."""

    demonstrations_per_door: int = 2
    """Demonstrations by the synthetic human on each of three doors."""

    demonstrated_forces: bool = False
    """The synthetic human's demonstrations include forces and moments."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RunSettings(EpisodeSettings):
    """What a run opens, what its policy learns from, and what it draws."""

    disturbance: str = "none"
    """Disturbance during the episode: none, push, person, ...; see `gplfd list`."""

    demonstrations: Annotated[Path | None, tyro.conf.arg(metavar="FILE.npz")] = None
    """Learn from this set, or its .npz file, instead of the synthetic human."""

    skill: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """Use this skill, a file written by `gplfd learn`, instead of learning one."""

    video: Annotated[Path | None, tyro.conf.arg(metavar="FILE.mp4")] = None
    """Also write a video of the episode in real time; for several doors, one file per
    door, FILE-DOOR.mp4. Needs pip install 'gplfd[video]'."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RecordSettings(EpisodeSettings):
    """What is recorded as a data set."""

    episodes: int = 1
    """Episodes per door, 1 or more."""

    seed: int = 0
    """First seed, 0 or more."""

    max_steps: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Truncate episodes after N steps; the environment's limit by default."""

    overwrite: tyro.conf.FlagCreatePairsOff[bool] = False
    """Replace an existing data set."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Card:
    """What a submission states of itself: all of it, by options or by a file."""

    authors: tuple[str, ...] = ()
    """Names of the authors."""

    code: str = ""
    """Where code and weights are published: an address, and a commit."""

    training_data: str = ""
    """What the policy was trained with, and for how long."""

    knowledge: tuple[
        Literal["demonstrations", "data", "simulator", "mechanism", "door"], ...
    ] = ()
    """What it has learned from or knows: demonstrations (those of the trial), data
    (others), simulator (trained or tuned in it), mechanism (that doors turn about a
    hinge), door (the true door)."""
