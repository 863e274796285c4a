"""``gplfd figures``: the paper's figures, from this project's own runs."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from experiments.commands.complaint import complain

if TYPE_CHECKING:
    from experiments.figures.material import Entry, Material

PROVENANCE, LOGS = "figures.json", "logs"


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

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from experiments.figures.catalogue import chosen
        from experiments.files.plain_data import write_json
        from experiments.files.provenance import provenance

        try:
            entries = chosen(self.only)
            self._check()
            settings = dataclasses.asdict(self) | {"out": str(self.out)}
            write_json(self.out / PROVENANCE, provenance(settings))
            _draw(self.out, entries, _material(self, entries))
        except (ValueError, OSError) as error:
            return complain(error)
        print(f"{len(entries)} figures and captions.md in {self.out}")
        return 0

    def _check(self) -> None:
        if self.seed < 0:
            raise ValueError(f"--seed {self.seed} must be 0 or more")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file; give a folder")


def _material(figures: Figures, entries: Mapping[str, Entry]) -> Material:
    """Make or read the runs that the figures need, showing progress."""
    from tqdm import tqdm

    from experiments.figures.episodes import material

    doors = list(dict.fromkeys(d for entry in entries.values() for d in entry.doors))
    with tqdm(
        desc="episodes", total=len(doors), unit="door", leave=False, disable=None
    ) as bar:

        def show(door: str) -> None:
            bar.set_postfix_str(door, refresh=False)
            bar.update()

        return material(figures.out / LOGS, doors, seed=figures.seed, on_episode=show)


def _draw(folder: Path, entries: Mapping[str, Entry], shown: Material) -> None:
    """Draw, write and describe figure after figure."""
    from tqdm import tqdm

    from experiments.figures.captions import section, update_captions
    from experiments.figures.catalogue import FIGURES
    from experiments.figures.style import paper_style, write_figure

    bar = tqdm(entries.items(), desc="figures", unit="figure", disable=None)
    for name, entry in bar:
        bar.set_postfix_str(name)
        with paper_style():
            drawing = entry.make(shown)
            write_figure(drawing.figure, folder, name)
        text = section(name, entry.title, shown.seed, drawing.caption)
        update_captions(folder, {name: text}, list(FIGURES))
