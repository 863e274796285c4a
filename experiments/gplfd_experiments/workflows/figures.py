"""Draws the paper's figures from runs of this project, which are made or reused."""

import contextlib
import hashlib
import json
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import gplfd_env
import gplfd_policies
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments import episodes
from gplfd_experiments.analysis.figures.drawing import FIGURES, draw_figure
from gplfd_experiments.analysis.figures.material import POLICY, Material
from gplfd_experiments.console.arguments import check_folder, check_least
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
from gplfd_experiments.files.provenance import provenance, versions
from gplfd_policies.agents.agent import Agent
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations
from gplfd_policies.registry.catalogue import policy_named


def draw_figures(
    folder: Path, only: Sequence[str], *, seed: int, options: Mapping[str, Any]
) -> int:
    """Make or read the runs of some or all figures, draw them, return their number.

    The seed is that of teacher, policy, environment and synthetic sets; the options of
    the command are stored as metadata.
    """
    if unknown := sorted(set(only) - set(FIGURES)):
        raise ValueError(
            f"there is no figure {unknown[0]!r}; figures: {', '.join(FIGURES)}"
        )
    check_least("--seed", seed, 0)
    check_folder(folder)
    write_json(folder / "figures.json", provenance(options))
    chosen = [name for name in FIGURES if not only or name in only]
    doors = [door for name in chosen for door in FIGURES[name].doors]
    runs = material(folder / "logs", doors, seed=seed)
    bar = progress_bar(chosen, desc="figures", unit="figure")
    for name in bar:
        bar.set_postfix_str(name)
        draw_figure(name, runs, folder)
    return len(chosen)


def material(folder: Path, doors: Iterable[str], *, seed: int) -> Material:
    """Return demonstrations and an episode per door, stored in a folder per setting."""
    options: dict[str, Any] = {
        "policy": POLICY,
        "seed": seed,
        "demonstrations_per_door": 2,  # As in the paper, Section IV-A.
    }
    wanted = list(dict.fromkeys(doors))
    tasks = [
        episode_task(*door, **options)
        for door in (named_doors(wanted) if wanted else {}).items()
    ]
    # All properties that determine a run, except the door.
    settings = options | {
        "radii": list(DEMONSTRATED_RADII),
        "teacher": standard_teacher(),
        "versions": dict(versions()),
        "source": source_digest(),
    }
    text = json.dumps(settings, sort_keys=True)
    kept = folder / f"seed{seed}-{hashlib.sha256(text.encode()).hexdigest()[:12]}"
    path = kept / "demonstrations.npz"
    if not path.is_file():
        labelled = demonstrations_of(episode_task("medium", DoorConfig(), **options))
        write_json(kept / "settings.json", settings)
        save_demonstrations(path, labelled.demonstrations, labelled.radii)
    demonstrations = load_demonstrations(path)
    logs = {}
    learned: Callable[[], Agent] | None = None
    for task in progress_bar(tasks, desc="episodes", unit="door"):
        path = kept / f"{POLICY}-{task.door}.npz"
        if not path.is_file():
            if learned is None:
                learned = learned_agents(task, policy_named(POLICY), demonstrations)
            agent = learned()
            with contextlib.closing(make_environment(task, agent.control)) as env:
                names = {"policy": POLICY, "door": task.door}
                rollout(env, agent, **names, seed=task.reset_seed).save(path)
        logs[task.door] = EpisodeLog.load(path)
    return Material(seed=seed, demonstrations=demonstrations, episodes=logs)


def source_digest() -> str:
    """Hash of the code of a run; a changed policy makes old runs invalid."""
    digest = hashlib.sha256()
    for package in (gplfd_env, gplfd_policies, teacher, episodes):
        for file in sorted(Path(package.__path__[0]).rglob("*.py")):
            digest.update(file.read_bytes())
    return digest.hexdigest()[:16]
