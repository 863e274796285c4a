"""Commands for episodes: run and view; and learn, which makes a skill."""

import contextlib
import itertools
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gplfd_experiments.cli.commands import options
from gplfd_experiments.workflows.settings import RunSettings


@dataclass(frozen=True, kw_only=True, slots=True)
class Run(RunSettings):
    """Learn from demonstrations, open doors, and store metrics and recordings.

    Writes DIR/metrics.json (one object per door), DIR/<door>.rrd (Rerun recording),
    DIR/<door>.npz (the complete log), DIR/demonstrations.npz and
    DIR/run.json (versions, command, settings).
    Files of these names that exist are kept, and the run is refused.
    """

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; by default results/POLICY-seedSEED, or with a number behind
    it if that exists."""

    all: options.All = False
    json: options.Json = False
    quiet: options.Quiet = False

    def execute(self) -> int:
        """Open the doors and print a table; `FAILED` if the policy raised an error."""
        from gplfd_experiments.analysis.results.measures import run_table
        from gplfd_experiments.console.progress import LOG
        from gplfd_experiments.episodes.metrics import late_decisions
        from gplfd_experiments.files.folders import file_name, folder_in_use
        from gplfd_experiments.files.plain_data import json_text
        from gplfd_experiments.files.table import FIRST, text_table
        from gplfd_experiments.workflows.runs import open_doors

        if self.skill is not None and self.demonstrations is not None:
            raise ValueError("--skill is already learned: omit --demonstrations")
        folder = default = Path("results") / f"{file_name(self.policy)}-seed{self.seed}"
        numbers = itertools.count(2)
        while self.out is None and folder.exists():
            folder = default.with_name(f"{default.name}-{next(numbers)}")
        folder = self.out or folder
        # Output of a policy is kept out of the table or JSON on standard output.
        with contextlib.redirect_stdout(sys.stderr), folder_in_use(folder) as used:
            rows = open_doors(self, used, options.recorded(self))
        if late := late_decisions(rows):
            LOG.warning("warning: %s: %s", self.policy, late)
        status = options.FAILED if any("error" in row for row in rows) else 0
        if self.json:
            print(json_text(rows))
            return status
        print(text_table(run_table(rows), None if self.all else FIRST))
        if doors := [row["door"] for row in rows if "error" not in row]:
            file = folder / f"{'medium' if 'medium' in doors else doors[0]}.rrd"
            print(f"\nlook at it:  {options.next_command('view', file)}")
        return status


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Open a recording (.rrd) in the Rerun viewer.

    A journal of `gplfd serve` is first converted to a recording in the same folder.
    """

    file: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="FILE.rrd")]
    """Recording to open, for example results/gp-seed0/medium.rrd."""

    def execute(self) -> int:
        """Show the recording until the viewer is closed."""
        from gplfd_experiments.recording.viewer import open_recording

        return open_recording(self.file)


@dataclass(frozen=True, kw_only=True, slots=True)
class Learn:
    """Learn a skill from demonstrations and store it in a file.

    The file contains arrays only, no code; `gplfd run --skill FILE`
    and `gplfd_policies.load_skill` read it.
    """

    demonstrations: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="DEMOS.npz")
    ]
    """Demonstrations: a set, or demonstrations.npz of a `gplfd run`."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File to write, by default DEMONSTRATIONS-skill.npz; a skill without
    corrections is replaced."""

    policy: str = "gp"
    """Policy whose skill to learn: gp or one of its variants; see `gplfd list`."""

    seed: int = 0
    """Seed of random numbers in learning, 0 or more."""

    quiet: options.Quiet = False

    def execute(self) -> int:
        """Learn, and print how to use the file."""
        from gplfd_experiments.workflows.skills import demonstrated_doors, learn_skill

        demonstrations = self.demonstrations
        name = demonstrations.absolute().name.removesuffix(".npz")
        out = self.out or Path(f"{name}-skill.npz")
        skill = learn_skill(demonstrations, out, policy=self.policy, seed=self.seed)
        print(f"{out}: {skill}")
        if skill.frame != "door":
            print("no doors are opened with it: import with --frame hinge for that")
            return 0
        doors = demonstrated_doors(demonstrations)
        print(f"open doors with it:  {options.open_command(out, doors, self.policy)}")
        return 0
