"""The runs that figures read: made once, kept with the figures, used again.

This is the only module beside the figures that simulates.
"""

import contextlib
import hashlib
import json
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, Final

import gplfd_env
import gplfd_policies
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments import episodes
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data import teacher
from gplfd_experiments.data.npz import (
    LabelledDemonstrations,
    load_demonstrations,
    save_demonstrations,
)
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, standard_teacher
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    make_environment,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import EpisodeTask, episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import versions
from gplfd_policies.registry.catalogue import policy_named

POLICY: Final = "gp"
"""Policy whose episodes figures show; others are shown the same observations."""

DEMONSTRATIONS_PER_DOOR: Final = 2
"""As in the paper, Section IV-A."""


def material(folder: Path, doors: Iterable[str], *, seed: int) -> Material:
    """Demonstrations, and an episode per door: from the folder, or else made now.

    Args:
        folder: Where runs are kept, in one folder per setting: another seed, version
            or door configuration finds nothing to use again.
        doors: Names of doors, or radii [m] as text.
        seed: Seed of teacher, policy and environment.

    Raises:
        ValueError: An unknown door.
        OSError: A file cannot be read or written.
    """
    wanted = list(dict.fromkeys(doors))
    configs = named_doors(wanted) if wanted else {}
    settings = _settings(seed)
    text = json.dumps(settings, sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    kept = folder / f"seed{seed}-{digest}"
    demonstrations = _demonstrations(kept, settings)
    bar = progress_bar(configs.items(), desc="episodes", unit="door")
    return Material(
        seed=seed,
        demonstrations=demonstrations,
        episodes={
            door: _episode(kept, door, config, demonstrations, seed)
            for door, config in bar
        },
    )


def _settings(seed: int) -> dict[str, Any]:
    """Everything that a run depends on, beside the door."""
    return {
        "policy": POLICY,
        "seed": seed,
        "radii": list(DEMONSTRATED_RADII),
        "demonstrations_per_door": DEMONSTRATIONS_PER_DOOR,
        "teacher": standard_teacher(),
        "versions": dict(versions()),
        "source": _source_digest(),
    }


def _source_digest() -> str:
    """Hash of the code that acts in a run: a changed policy makes old runs stale."""
    digest = hashlib.sha256()
    for package in (gplfd_env, gplfd_policies, teacher, episodes):
        for file in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]


def _demonstrations(kept: Path, settings: Mapping[str, Any]) -> LabelledDemonstrations:
    path = kept / "demonstrations.npz"
    if not path.is_file():
        given = demonstrations_of(_task("medium", DoorConfig(), settings["seed"]))
        write_json(kept / "settings.json", settings)
        save_demonstrations(path, given.demonstrations, given.radii)
    return load_demonstrations(path)


def _task(door: str, config: DoorConfig, seed: int) -> EpisodeTask:
    return episode_task(
        door,
        config,
        policy=POLICY,
        seed=seed,
        demonstrations_per_door=DEMONSTRATIONS_PER_DOOR,
    )


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
    task = _task(door, config, seed)
    agent = learned_agents(task, policy_named(POLICY), learned)()
    with contextlib.closing(make_environment(task, agent.control)) as env:
        log = rollout(env, agent, policy=POLICY, door=door, seed=task.reset_seed)
    log.save(path)
    return log
