"""``gplfd report``: a study's result files told on one page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from experiments.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """Tell a study: rankings with intervals, paired tests, Table 1 measured, plots.

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
        """Write the pages and print where they are."""
        with postponed_interruption():
            from experiments.arguments import check_folder
            from experiments.report.page import write_report

        if self.out is not None:
            check_folder(self.out)
        page = write_report(self.folder, self.out, self.reference)
        print(f"{page} and {page.with_suffix('.md')}")
        return 0
