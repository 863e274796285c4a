"""The command that lets a person teach: demos teach."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gplfd_experiments.cli.commands.options import (
    Device,
    PageOptions,
    next_command,
    recorded,
)
from gplfd_experiments.cli.commands.run import draw_without_screen
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Teach(PageOptions):
    """Lead the simulated hand yourself, in a web page of this machine, and record it.

    Motion and forces are recorded, pauses are cut, and what you showed is played back
    before you keep, repeat or discard it. SET can be given to `gplfd learn` and
    `gplfd run --demonstrations`. Each demonstration is on the disk as soon as it is
    kept; the same command adds more. See docs/teaching.md.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="SET")]
    """Folder to write, or one of this command to which more is added."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to teach at, one after the other: names (see `gplfd list`), radii in
    metres, or .json files of door parameters."""

    device: Device = "mouse"
    """What leads the hand. A SpaceMouse needs Chrome or Edge."""

    def execute(self) -> int:
        """Serve the page until the person finishes, and say what to do next."""
        draw_without_screen()
        with postponed_interruption():
            from gplfd_experiments.teaching.page import teach

        number = teach(
            self.doors,
            self.out,
            device=self.device,
            options=recorded(self),
            **self.address(),
        )
        print(f"{number} demonstration{'s' * (number != 1)} in {self.out}")
        if number:
            out = self.out.with_name(f"{self.out.name}-skill.npz")
            print(f"learn from them:  {next_command('learn', self.out, '--out', out)}")
        return 0
