"""Draws the paper's figures from runs of this project."""

import contextlib
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.figures.drawing import FIGURES, draw_figure
from gplfd_experiments.analysis.figures.style import POLICY, Material
from gplfd_experiments.console import arguments, progress
from gplfd_experiments.episodes import build
from gplfd_experiments.episodes.rollout import rollout
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.registry.catalogue import policy_named


def draw_figures(
    folder: Path, only: Sequence[str], *, seed: int, options: Mapping[str, Any]
) -> int:
    """Make the runs of some or all figures, draw them, and return their number."""
    if unknown := sorted(set(only) - set(FIGURES)):
        raise ValueError(
            f"there is no figure {unknown[0]!r}; figures: {', '.join(FIGURES)}"
        )
    arguments.check_least("--seed", seed, 0)
    arguments.check_folder(folder)
    write_json(folder / "figures.json", provenance(options))
    chosen = [name for name in FIGURES if not only or name in only]
    runs = material([door for name in chosen for door in FIGURES[name].doors], seed)
    bar = progress.progress_bar(chosen, desc="figures", unit="figure")
    for name in bar:
        bar.set_postfix_str(name)
        draw_figure(name, runs, folder)
    return len(chosen)


def material(doors: Iterable[str], seed: int) -> Material:
    """Return demonstrations, two per door as in Section IV-A, and episodes by door."""
    names = list(dict.fromkeys(doors))
    named = named_doors(names).items() if names else ()
    tasks = [episode_task(*door, policy=POLICY, seed=seed) for door in named]
    plain = episode_task("medium", DoorConfig(), policy=POLICY, seed=seed)
    demonstrations, logs = build.demonstrations_of(plain), {}
    if tasks:
        learned = build.learned_agents(tasks[0], policy_named(POLICY), demonstrations)
    for task in progress.progress_bar(tasks, desc="episodes", unit="door"):
        agent = learned()
        with contextlib.closing(build.make_environment(task, agent.control)) as env:
            logs[task.door] = rollout(
                env, agent, policy=POLICY, door=task.door, seed=task.reset_seed
            )
    return Material(seed=seed, demonstrations=demonstrations, episodes=logs)
