"""``gplfd figures``: the paper's figures, from this project's own runs."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gplfd_experiments.cli.commands.options import Quiet, recorded
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Figures:
    """Draw the paper's figures from this project's own runs.

    Writes DIR/<figure>.png and .svg, DIR/captions.md (what is seen, and the numbers),
    DIR/figures.json (versions, command, settings) and, in DIR/logs, the runs that the
    figures read; the next call with the same settings reads them again.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/figures")
    """Folder to write to, or to add to."""

    only: tuple[str, ...] = ()
    """Figures to draw, for example fig02 fig09; all by default."""

    seed: int = 0
    """Seed of teacher, policy, environment and synthetic sets, 0 or more."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Draw the figures and print where they are."""
        with postponed_interruption():
            from gplfd_experiments.analysis.figures.drawing import draw_figures

        number = draw_figures(
            self.out, self.only, seed=self.seed, options=recorded(self)
        )
        print(f"{number} figures and captions.md in {self.out}")
        return 0
