"""The command that corrects a skill."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Any

import tyro

from gplfd_experiments.cli.commands.options import (
    Device,
    PageOptions,
    Quiet,
    open_command,
)
from gplfd_experiments.cli.commands.run import draw_without_screen
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Correct(PageOptions):
    """Correct a skill: lead its hand where it fails, or let a program do so.

    A synthetic corrector watches the skill open doors, one after the other. Where the
    command leaves the handle's path or the door stalls, it leads the hand. With
    --device you do, in a web page of this machine. The motion is kept in the skill and
    learned from. See docs/corrections.md.
    """

    skill: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SKILL.npz")]
    """Skill to correct, a file written by `gplfd learn`; it stays as it is."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`), radii in metres, or .json files of door
    parameters, of the kind that the skill was learned for."""

    device: Device | None = None
    """What you lead the hand with; a synthetic corrector leads it without. A SpaceMouse
    needs Chrome or Edge."""

    policy: str = "gp"
    """Policy that follows the skill and is corrected: gp or one of its variants."""

    seed: int = 0
    """Seed of the corrector and the episodes, 0 or more."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File of the corrected skill, SKILL-corrected.npz by default; one that is there
    already is replaced, and refused with --device."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Correct the skill, and print what changed."""
        if self.device is not None:
            draw_without_screen()
        with postponed_interruption():
            from gplfd_experiments.files.table import Table, text_table
            from gplfd_experiments.workflows.corrections import (
                correct_by_hand,
                correct_skill,
            )

        out = self.out or self.skill.with_name(f"{self.skill.stem}-corrected.npz")
        correct: Any = correct_skill
        if self.device is not None:
            correct = partial(correct_by_hand, device=self.device, **self.address())
        skill, rows = correct(
            self.skill, out, doors=self.doors, policy=self.policy, seed=self.seed
        )
        if rows:
            print(text_table(dataclasses.replace(Table.of(rows), left=True)))
        if all(row["then"] == "-" for row in rows):
            print("\nnothing was corrected, and nothing written")
            return 0
        print(f"\n{out}: {skill}")
        again = open_command(out, self.doors, self.policy)
        print(f"open them with it:  {again}")
        return 0
