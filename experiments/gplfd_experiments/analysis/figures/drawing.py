"""All figures by name; draws one of them with its caption."""

import re
from collections.abc import Mapping
from pathlib import Path
from types import ModuleType
from typing import Final

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
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.analysis.figures.style import paper_style, write_figure
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
"""Figures of the paper by their number, and one additional figure."""

CAPTIONS: Final = "captions.md"


def draw_figure(name: str, given: Material, folder: Path) -> None:
    """Draw one of `FIGURES`; write NAME.png, NAME.svg and its section of captions."""
    figure = FIGURES[name]
    shown = figure.measure(given)
    with paper_style():
        write_figure(figure.draw(shown), folder, name)
    head = f"## {name}: {figure.TITLE} (seed {given.seed})"
    update_captions(folder, name, f"{head}\n\n{figure.caption(shown)}\n")


def update_captions(folder: Path, name: str, section: str) -> None:
    """Write a figure's section to the captions, in the order of `FIGURES`."""
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
