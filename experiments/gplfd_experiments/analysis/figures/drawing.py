"""All figures, or some of them: their runs, their pictures and their captions."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any, Final

from gplfd_experiments.analysis.figures.captions import section, update_captions
from gplfd_experiments.analysis.figures.catalogue import FIGURES, chosen
from gplfd_experiments.analysis.figures.episodes import material
from gplfd_experiments.analysis.figures.style import paper_style, write_figure
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import progress_bar
from gplfd_experiments.files.plain_data import write_json
from gplfd_experiments.files.provenance import provenance

PROVENANCE: Final = "figures.json"
LOGS: Final = "logs"


def draw_figures(
    folder: Path, only: Sequence[str], *, seed: int, options: Mapping[str, Any]
) -> int:
    """Make or read the runs that the figures need, then draw figure after figure.

    Args:
        folder: Where to write.
        only: Names of figures; none for all.
        seed: Seed of teacher, policy, environment and synthetic sets.
        options: The command's, for the record; JSON-able.

    Returns:
        The number of figures.

    Raises:
        ValueError: An argument is wrong.
        OSError: A file cannot be read or written.
    """
    figures = chosen(only)
    check_least("--seed", seed, 0)
    check_folder(folder)
    write_json(folder / PROVENANCE, provenance(options))
    doors = [door for figure in figures.values() for door in figure.DOORS]
    given = material(folder / LOGS, doors, seed=seed)
    bar = progress_bar(figures.items(), desc="figures", unit="figure")
    for name, figure in bar:
        bar.set_postfix_str(name)
        shown = figure.measure(given)
        with paper_style():
            write_figure(figure.draw(shown), folder, name)
        text = section(name, figure.TITLE, seed, figure.caption(shown))
        update_captions(folder, {name: text}, list(FIGURES))
    return len(figures)
