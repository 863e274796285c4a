"""The runs that figures read: made once, kept with the figures, used again.

This is the only module beside the figures that simulates.
"""

from __future__ import annotations

import dataclasses
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import numpy as np

import experiments.episodes
import experiments.teacher
import gplfd_env
import policies
from experiments.datasets.npz import (
    LabelledDemonstrations,
    load_demonstrations,
    save_demonstrations,
)
from experiments.episodes.log import EpisodeLog
from experiments.episodes.rollout import rollout
from experiments.figures.material import Material
from experiments.files.plain_data import write_json
from experiments.files.provenance import versions
from experiments.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_env import ENVIRONMENT_ID
from gplfd_env.config import DoorConfig, door_config
from policies.registry import make_agent

POLICY: Final = "gp"
"""Policy whose episodes figures show; others are shown the same observations."""

DEMONSTRATIONS_PER_DOOR: Final = 2
"""As in the paper, Section IV-A."""


def material(
    folder: Path,
    doors: Iterable[str],
    *,
    seed: int,
    on_episode: Callable[[str], None] = lambda door: None,
) -> Material:
    """Demonstrations, and an episode per door: from the folder, or else made now.

    Args:
        folder: Where runs are kept, in one folder per setting: another seed, version
            or door configuration finds nothing to use again.
        doors: Names of doors, or radii [m] as text.
        seed: Seed of teacher, policy and environment.
        on_episode: Called with the door's name after each.

    Raises:
        ValueError: An unknown door.
        OSError: A file cannot be read or written.
    """
    configs = {door: _config(door) for door in doors}
    kept = folder / f"seed{seed}-{_digest(_settings(seed))}"
    demonstrations = _demonstrations(kept, seed)
    episodes = {}
    for door, config in configs.items():
        episodes[door] = _episode(kept, door, config, demonstrations, seed)
        on_episode(door)
    return Material(seed=seed, demonstrations=demonstrations, episodes=episodes)


def _config(door: str) -> DoorConfig:
    try:
        return door_config(float(door))
    except ValueError:
        return door_config(door)


def _settings(seed: int) -> dict[str, Any]:
    """Everything that a run depends on, beside the door."""
    return {
        "policy": POLICY,
        "seed": seed,
        "radii": list(DEMONSTRATED_RADII),
        "demonstrations_per_door": DEMONSTRATIONS_PER_DOOR,
        "teacher": dataclasses.asdict(Teacher().config),
        "versions": dict(versions()),
        "source": _source_digest(),
    }


def _digest(settings: Mapping[str, Any]) -> str:
    text = json.dumps(settings, sort_keys=True)
    return hashlib.sha256(text.encode()).hexdigest()[:12]


def _source_digest() -> str:
    """Hash of the code that acts in a run: a changed policy makes old runs stale."""
    digest = hashlib.sha256()
    for package in (gplfd_env, policies, experiments.teacher, experiments.episodes):
        for file in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _demonstrations(kept: Path, seed: int) -> LabelledDemonstrations:
    path = kept / "demonstrations.npz"
    if not path.is_file():
        each = DEMONSTRATIONS_PER_DOOR
        given = Teacher().demonstrate_doors(
            DEMONSTRATED_RADII, each, rng=np.random.default_rng(seed)
        )
        radii = [radius for radius in DEMONSTRATED_RADII for _ in range(each)]
        write_json(kept / "settings.json", _settings(seed))
        save_demonstrations(path, given, radii)
    return load_demonstrations(path)


def _episode(
    kept: Path,
    door: str,
    config: DoorConfig,
    learned: LabelledDemonstrations,
    seed: int,
) -> EpisodeLog:
    """Read a door's log, or open the door and write it."""
    path = kept / f"{POLICY}-{door}.npz"
    if path.is_file():
        return EpisodeLog.load(path)
    agent = make_agent(POLICY, learned.demonstrations, seed=seed)
    env = gym.make(ENVIRONMENT_ID, door=config)
    log = rollout(
        env,
        agent,
        policy=POLICY,
        door=door,
        door_config=dataclasses.asdict(config),
        seed=seed,
    )
    env.close()
    log.save(path)
    return log
