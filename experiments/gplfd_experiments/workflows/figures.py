"""Draws the paper's figures from runs of this project."""

import re
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

from matplotlib.figure import Figure

from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.analysis.figures import learned, openings, style, synthetic
from gplfd_experiments.analysis.figures.style import POLICY, Material
from gplfd_experiments.console import arguments, progress
from gplfd_experiments.episodes import build
from gplfd_experiments.episodes.task import episode_task, named_doors
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.registry.catalogue import policy_named


class PaperFigure(NamedTuple):
    """A figure of the paper; drawing simulates nothing."""

    title: str
    draw: Callable[[Material], tuple[Figure, str]]
    """Returns the figure, and a paragraph about it, the paper's version and numbers."""
    doors: tuple[str, ...] = ()


FIGURES: Final[Mapping[str, PaperFigure]] = {
    "fig02": PaperFigure("One noise level against a local one", synthetic.fig02),
    "fig03": PaperFigure("Alignment by distance and by completion", synthetic.fig03),
    "fig04": PaperFigure("Strong and weak via-points", synthetic.fig04),
    "fig06": PaperFigure("From demonstrations to a policy", learned.fig06),
    "fig07": PaperFigure("The policy on the plane of the door", learned.fig07),
    "fig09": PaperFigure("Adaptation of a policy", openings.fig09, openings.DOORS),
    "fig10": PaperFigure("Stiffness", openings.fig10, openings.STIFFNESS_DOORS),
}
"""Figures of the paper by their number."""


def draw_figures(
    folder: Path, only: Sequence[str], *, seed: int, options: Mapping[str, Any]
) -> int:
    """Make the runs of some or all figures, draw them, and return their number."""
    if unknown := sorted(set(only) - set(FIGURES)):
        raise ValueError(f"unknown figure {unknown[0]!r}; known: {', '.join(FIGURES)}")
    arguments.check_least("--seed", seed, 0)
    arguments.check_folder(folder)
    write_json(folder / "figures.json", provenance(options))
    chosen = [name for name in FIGURES if not only or name in only]
    runs = material([door for name in chosen for door in FIGURES[name].doors], seed)
    bar = progress.progress_bar(chosen, desc="figures", unit="figure")
    for name in bar:
        bar.set_postfix_str(name)
        with style.paper_style():
            figure, caption = FIGURES[name].draw(runs)
            style.write_figure(figure, folder, name)
        head = f"## {name}: {FIGURES[name].title} (seed {seed})"
        update_captions(folder, name, f"{head}\n\n{caption}\n")
    return len(chosen)


def update_captions(folder: Path, name: str, section: str) -> None:
    """Write a figure's section to the captions, in the order of `FIGURES`."""
    path = folder / "captions.md"
    written = path.read_text(encoding="utf-8") if path.is_file() else ""
    _, *parts = re.split(r"^(?=## (\S+): )", written, flags=re.MULTILINE)
    sections = {
        other: text.rstrip("\n") + "\n"
        for other, text in zip(parts[::2], parts[1::2], strict=True)
    }
    sections[name] = section
    text = "\n".join(sections[figure] for figure in FIGURES if figure in sections)
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")


def material(doors: Iterable[str], seed: int) -> Material:
    """Return demonstrations, two per door as in Section IV-A, and episodes by door."""
    names = list(dict.fromkeys(doors))
    named = named_doors(names).items() if names else ()
    tasks = [episode_task(*door, policy=POLICY, seed=seed) for door in named]
    plain = episode_task("medium", DoorConfig(), policy=POLICY, seed=seed)
    demonstrations, logs = build.demonstrations_of(plain), {}
    if tasks:
        learned = build.learned_agents(tasks[0], policy_named(POLICY), demonstrations)
        agents = [learned() for _ in tasks]
        opened = build.open_together(tasks, agents, forecast_period=0.35)
        logs = {log.door: log for log in opened}
    return Material(seed=seed, demonstrations=demonstrations, episodes=logs)
