"""All figures by name; some or all of them drawn, with their runs and captions."""

import re
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import ModuleType
from typing import Any, Final

from gplfd_experiments.analysis.figures import (
    fig02_heteroscedastic,
    fig03_alignment,
    fig04_via_points,
    fig06_policy,
    fig07_region,
    fig09_adaptation,
    fig10_stiffness,
    forecasts,
)
from gplfd_experiments.analysis.figures.material import material
from gplfd_experiments.analysis.figures.style import paper_style, write_figure
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance
from gplfd_policies.arrays.storage import complete_or_absent

FIGURES: Final[Mapping[str, ModuleType]] = {
    "fig02": fig02_heteroscedastic,
    "fig03": fig03_alignment,
    "fig04": fig04_via_points,
    "fig06": fig06_policy,
    "fig07": fig07_region,
    "fig09": fig09_adaptation,
    "fig10": fig10_stiffness,
    "forecasts": forecasts,
}
"""Figures of the paper by their number, and one of our own."""

PROVENANCE: Final = "figures.json"
CAPTIONS: Final = "captions.md"
LOGS: Final = "logs"


def draw_figures(
    folder: Path, only: Sequence[str], *, seed: int, options: Mapping[str, Any]
) -> int:
    """Make or read the runs of some figures, or of all, draw them and count them.

    The seed is that of teacher, policy, environment and synthetic sets; the options of
    the command are kept for the record.
    """
    if unknown := sorted(set(only) - set(FIGURES)):
        raise ValueError(
            f"there is no figure {unknown[0]!r}; figures: {', '.join(FIGURES)}"
        )
    check_least("--seed", seed, 0)
    check_folder(folder)
    write_json(folder / PROVENANCE, provenance(options))
    chosen = {name: one for name, one in FIGURES.items() if not only or name in only}
    doors = [door for figure in chosen.values() for door in figure.DOORS]
    given = material(folder / LOGS, doors, seed=seed)
    bar = progress_bar(chosen.items(), desc="figures", unit="figure")
    for name, figure in bar:
        bar.set_postfix_str(name)
        shown = figure.measure(given)
        with paper_style():
            write_figure(figure.draw(shown), folder, name)
        head = f"## {name}: {figure.TITLE} (seed {seed})"
        update_captions(folder, name, f"{head}\n\n{figure.caption(shown)}\n")
    return len(chosen)


def update_captions(folder: Path, name: str, section: str) -> None:
    """Write a figure's section to the captions, keeping those of `FIGURES` in order."""
    path = folder / CAPTIONS
    there = path.read_text(encoding="utf-8") if path.is_file() else ""
    _, *parts = re.split(r"^(?=## (\S+): )", there, flags=re.MULTILINE)
    kept = {
        old_name: old.rstrip("\n") + "\n"
        for old_name, old in zip(parts[::2], parts[1::2], strict=True)
    }
    kept[name] = section
    text = "\n".join(kept[each] for each in FIGURES if each in kept)
    with complete_or_absent(path) as temporary:
        temporary.write_text(text, encoding="utf-8")
