"""Commands in which a person leads the hand in a web page: demos teach, correct."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, Literal

import tyro

from gplfd_experiments.cli.commands import options

Device = Literal["mouse", "keyboard", "spacemouse"]
"""Input device of a person who leads the hand in the browser."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PageOptions:
    """Where a page is served."""

    host: str = "127.0.0.1"
    """Address of the page. With any other address, other machines can lead the hand."""

    port: int = 0
    """Port of the page; 0 selects a free port."""

    def page(self, device: Device) -> dict[str, Any]:
        """Return the page's device, host and port."""
        if not 0 <= self.port <= 65535:
            raise ValueError(f"--port {self.port} must be 0 to 65535")
        return {"device": device, "host": self.host, "port": self.port}


@dataclass(frozen=True, kw_only=True, slots=True)
class Teach(PageOptions):
    """Lead the simulated hand yourself, in a web page of this machine, and record it.

    Motion and forces are recorded and pauses are cut. The demonstration is played back
    before you keep, repeat or discard it. SET can be given to `gplfd learn` and `gplfd
    run --demonstrations`. Each kept demonstration is saved at once; the same command
    adds more. See docs/your-data.md.
    """

    out: Annotated[Path, tyro.conf.arg(metavar="SET")]
    """Folder to write, or an existing set of this command to which more is added."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to teach at, in turn: names, radii [m], or .json files."""

    device: Device = "mouse"
    """Input device that leads the hand. A SpaceMouse needs Chrome or Edge."""

    def execute(self) -> int:
        """Serve the page until the person finishes, and print the next commands."""
        page = self.page(self.device)
        from gplfd_experiments.teaching.page import teach

        number = teach(self.doors, self.out, page, options.recorded(self))
        print(f"{number} demonstration{'s' * (number != 1)} in {self.out}")
        if number:
            print(f"learn from them:  {options.learn_command(self.out)}")
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Correct(PageOptions):
    """Correct a skill: lead its hand where it fails, or let a program do so.

    A synthetic corrector watches the skill open doors, one after the other. If the
    commanded pose leaves the handle's path or the door stalls, it leads the hand.
    With --device you lead the hand, in a web page of this machine. The skill stores the
    motion and learns from it. See docs/your-data.md.
    """

    skill: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="SKILL.npz")]
    """Skill to correct, a file written by `gplfd learn`; it is not changed."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open, of the kind that the skill was learned for."""

    device: Device | None = None
    """Your input device; without it, a synthetic corrector leads the hand."""

    policy: str = "gp"
    """Policy that follows the skill and is corrected: gp or one of its variants."""

    seed: int = 0
    """Seed of the corrector and the episodes, 0 or more."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """New file of the corrected skill, SKILL-corrected.npz by default."""

    quiet: options.Quiet = False

    def execute(self) -> int:
        """Correct the skill, and print what changed."""
        page = None if self.device is None else self.page(self.device)
        from gplfd_experiments.files.table import Table, text_table
        from gplfd_experiments.workflows.skills import correct_skill

        out = self.out or self.skill.with_name(f"{self.skill.stem}-corrected.npz")
        skill, rows = correct_skill(
            self.skill,
            out,
            doors=self.doors,
            policy=self.policy,
            seed=self.seed,
            page=page,
        )
        if rows:
            print(text_table(dataclasses.replace(Table.of(rows), left=True)))
        if all(row["then"] == "-" for row in rows):
            print("\nnothing was corrected, and nothing written")
            return 0
        print(f"\n{out}: {skill}")
        again = options.open_command(out, self.doors, self.policy)
        print(f"open them with it:  {again}")
        return 0
