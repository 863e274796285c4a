"""``gplfd report``: a study's result files told on one page."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Final

import tyro

from gplfd_experiments.console.interruption import postponed_interruption

FAILED: Final = 1
"""Exit status if there are only errors, or results do not follow the protocol."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """Write a report of a study: rankings with intervals, paired tests, plots.

    Reads DIR/tasks/*.json and DIR/study.json, runs nothing, and writes report.html (one
    page that needs nothing else), report.md, figures/ and, of trials, trials.json: all
    their numbers seed by seed. The same results give the same bytes.
    """

    folders: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="DIR")
    ]
    """Folder of a `gplfd benchmark` or `gplfd trials`; the results of several folders
    are combined."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; the first study's own by default."""

    check: bool = False
    """Write nothing; check whether the results follow the protocol of the trials (exit
    status 1 if they do not)."""

    reference: Annotated[str, tyro.conf.arg(metavar="POLICY")] = "gp"
    """Policy with which the others are compared; the best if the study lacks it."""

    def execute(self) -> int:
        """Write the pages, print where they are; `FAILED` if all tasks failed."""
        with postponed_interruption():
            from gplfd_experiments.analysis.report.page import write_report
            from gplfd_experiments.analysis.results.reading import is_measured, read_all
            from gplfd_experiments.console.arguments import check_folder
            from gplfd_experiments.console.progress import LOG

        if not self.folders:
            raise ValueError("give the folder of a study: gplfd report DIR")
        if self.check:
            return self._check()
        if self.out is not None:
            check_folder(self.out)
        first, *others = self.folders
        page = write_report(first, self.out, self.reference, *others)
        for reason in read_all(self.folders).unreadable:
            LOG.warning("warning: left out: %s", reason)
        print(f"{page} and {page.with_suffix('.md')}")
        return 0 if any(map(is_measured, self.folders)) else FAILED

    def _check(self) -> int:
        with postponed_interruption():
            from gplfd_experiments.analysis.results.protocol_check import (
                protocol_problems,
            )
            from gplfd_experiments.analysis.results.reading import read_all
            from gplfd_experiments.studies.trials.protocol import VERSION

        problems = protocol_problems(read_all(self.folders))
        for problem in problems:
            print(problem)
        if not problems:
            print(f"the results follow protocol v{VERSION}")
        return FAILED if problems else 0
