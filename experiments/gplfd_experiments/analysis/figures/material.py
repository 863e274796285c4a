"""What figures are made from: demonstrations, and episodes that are kept with them."""

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Final

import gplfd_env
import gplfd_policies
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments import episodes
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.data import teacher
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, standard_teacher
from gplfd_experiments.episodes.build import (
    demonstrations_of,
    learned_agents,
    make_environment,
)
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import versions
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.npz import (
    LabelledDemonstrations,
    load_demonstrations,
    save_demonstrations,
)
from gplfd_policies.registry.catalogue import policy_named

POLICY: Final = "gp"
"""Policy whose episodes figures show; others are shown the same observations."""

DEMONSTRATIONS_PER_DOOR: Final = 2
"""As in the paper, Section IV-A."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Episodes by door, what their policy learned from, and the seed of everything."""

    seed: int
    demonstrations: LabelledDemonstrations
    episodes: Mapping[str, EpisodeLog]


def material(folder: Path, doors: Iterable[str], *, seed: int) -> Material:
    """Return demonstrations and an episode per door, kept in a folder per setting."""
    task = partial(
        episode_task,
        policy=POLICY,
        seed=seed,
        demonstrations_per_door=DEMONSTRATIONS_PER_DOOR,
    )
    wanted = list(dict.fromkeys(doors))
    configs = named_doors(wanted) if wanted else {}
    # Everything that a run depends on, beside the door.
    settings = {
        "policy": POLICY,
        "seed": seed,
        "radii": list(DEMONSTRATED_RADII),
        "demonstrations_per_door": DEMONSTRATIONS_PER_DOOR,
        "teacher": standard_teacher(),
        "versions": dict(versions()),
        "source": source_digest(),
    }
    text = json.dumps(settings, sort_keys=True)
    digest = hashlib.sha256(text.encode()).hexdigest()[:12]
    kept = folder / f"seed{seed}-{digest}"
    path = kept / "demonstrations.npz"
    if not path.is_file():
        given = demonstrations_of(task("medium", DoorConfig()))
        write_json(kept / "settings.json", settings)
        save_demonstrations(path, given.demonstrations, given.radii)
    demonstrations = load_demonstrations(path)
    logs = {}
    learned: Callable[[], Agent] | None = None
    for door, config in progress_bar(configs.items(), desc="episodes", unit="door"):
        path = kept / f"{POLICY}-{door}.npz"
        if path.is_file():
            logs[door] = EpisodeLog.load(path)
            continue
        one = task(door, config)
        if learned is None:
            learned = learned_agents(one, policy_named(POLICY), demonstrations)
        agent = learned()
        with contextlib.closing(make_environment(one, agent.control)) as env:
            log = rollout(env, agent, policy=POLICY, door=door, seed=one.reset_seed)
        log.save(path)
        logs[door] = log
    return Material(seed=seed, demonstrations=demonstrations, episodes=logs)


def source_digest() -> str:
    """Hash of the code that acts in a run: a changed policy makes old runs stale."""
    digest = hashlib.sha256()
    for package in (gplfd_env, gplfd_policies, teacher, episodes):
        for file in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
