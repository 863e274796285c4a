"""All figures by name; draws one of them with its caption."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path
from typing import Final, NamedTuple

from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import learned, openings, style, synthetic
from gplfd_policies.arrays.storage import complete_or_absent


class PaperFigure(NamedTuple):
    """A figure of the paper; drawing simulates nothing."""

    title: str
    draw: Callable[[style.Material], tuple[Figure, str]]
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

CAPTIONS: Final = "captions.md"


def draw_figure(name: str, material: style.Material, folder: Path) -> None:
    """Draw one of `FIGURES`; write NAME.png, NAME.svg and its section of captions."""
    with style.paper_style():
        figure, caption = FIGURES[name].draw(material)
        style.write_figure(figure, folder, name)
    head = f"## {name}: {FIGURES[name].title} (seed {material.seed})"
    update_captions(folder, name, f"{head}\n\n{caption}\n")


def update_captions(folder: Path, name: str, section: str) -> None:
    """Write a figure's section to the captions, in the order of `FIGURES`."""
    path = folder / CAPTIONS
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
