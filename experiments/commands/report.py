"""``gplfd report``: a study's result files on one page."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from experiments.commands.complaint import complain


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """Report a study: rankings with intervals, paired tests, Table 1 measured, plots.

    Reads DIR/tasks/*.json and DIR/study.json, runs nothing, and writes report.html (one
    page that needs nothing else), report.md and figures/. The same results give the
    same bytes.
    """

    folder: Annotated[tyro.conf.Positional[Path], tyro.conf.arg(metavar="DIR")]
    """Folder of a `gplfd benchmark`."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; the study's own by default."""

    reference: Annotated[str, tyro.conf.arg(metavar="POLICY")] = "gp"
    """Policy with which the others are compared; the best if the study lacks it."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from experiments.report.page import write_report

        try:
            if self.out is not None and self.out.exists() and not self.out.is_dir():
                raise ValueError(f"--out {self.out} is a file; give a folder")
            page = write_report(self.folder, self.out, self.reference)
        except (ValueError, OSError) as error:
            return complain(error)
        print(f"{page} and {page.with_suffix('.md')}")
        return 0
