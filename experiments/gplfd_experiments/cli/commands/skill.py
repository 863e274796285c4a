"""``gplfd skill``: which method fits these recordings, and how well."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import tyro

from gplfd_experiments.cli.commands.options import (
    ON_THIS_MACHINE,
    EngineOptions,
    Quiet,
    next_command,
    recorded,
)
from gplfd_experiments.console.interruption import postponed_interruption
from gplfd_experiments.studies.settings import TABLE_1_NAME

FAILED: Final = 1
"""Exit status if a method could not learn from the recordings."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTests:
    """Compare methods on recordings: predict each from the others; no robot.

    Writes DIR/report.html and report.md (which method is nearest, whether its
    uncertainty is honest, what it forecasts once a part was seen, and what to do about
    bad numbers), DIR/skill.rrd (recordings, mean and tube in 3-D) and DIR/tasks/, one
    result per method and recording; resumable.
    """

    recordings: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="DEMOS.npz")
    ]
    """File of demonstrations, such as demonstrations.npz of a `gplfd run`; at least
    three."""

    policies: tuple[str, ...] = (TABLE_1_NAME,)
    """Methods to judge; see `gplfd list`. "table-1" stands for the nine of the paper's
    Table 1."""

    reference: Annotated[str, tyro.conf.arg(metavar="POLICY")] = "gp"
    """Method with which the others are compared, and which skill.rrd shows."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/skill")
    """Folder to write to; unfinished tests in it are resumed."""

    where: Annotated[EngineOptions, tyro.conf.arg(name="")] = ON_THIS_MACHINE
    """Where to run."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Judge, print a table, and return `FAILED` if a method could not learn."""
        with postponed_interruption():
            from gplfd_experiments.workflows.skills import judge

        errors = judge(
            self.recordings,
            self.out,
            policies=self.policies,
            reference=self.reference,
            engine=self.where.made(),
            options=recorded(self) | {"recordings": self.recordings.name},
        )
        print(f"{self.out / 'report.html'} and report.md")
        if self._recording.is_file():
            print(f"look at what was learned:  {next_command('view', self._recording)}")
        return FAILED if errors else 0

    @property
    def _recording(self) -> Path:
        return self.out / "skill.rrd"
