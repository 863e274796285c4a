"""``gplfd speed``: how fast and how accurate, beside other libraries."""

import dataclasses
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gplfd_experiments.cli.commands.options import Quiet, recorded
from gplfd_experiments.console.interruption import postponed_interruption

RESULTS = "speed.json"

PartName = Literal["fit", "adapt", "align", "environment"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Speed:
    """Measure speed and accuracy of policies and environment; minutes for everything.

    Prints tables and writes DIR/speed.json. Times are CPU times with one BLAS thread;
    what is compared runs in turns, in one process. Other libraries come with
    pip install 'gplfd[bench]'; without them their lines say "not installed".
    """

    only: tuple[PartName, ...] = ()
    """Parts to run; all by default."""

    repeats: int = 5
    """Measurements of every time, 1 or more."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/speed")
    """Folder to write to."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Measure, print tables and write the results."""
        with postponed_interruption():
            from gplfd_experiments.console.arguments import check_folder, check_least
            from gplfd_experiments.console.progress import LOG
            from gplfd_experiments.files.plain_data import write_json
            from gplfd_experiments.files.provenance import provenance
            from gplfd_experiments.speed.machine import machine
            from gplfd_experiments.speed.parts import PARTS, announcement
            from gplfd_experiments.speed.report import measure_all

        check_least("--repeats", self.repeats, 1)
        check_folder(self.out)
        chosen = [name for name in PARTS if not self.only or name in self.only]
        LOG.info(announcement(chosen, self.repeats))
        measures = {k: v for name in chosen for k, v in PARTS[name].measures.items()}
        found = measure_all(measures, self.repeats)
        record = provenance(recorded(self)) | {
            "measured_on": machine(),
            "results": {name: dataclasses.asdict(one) for name, one in found.items()},
        }
        write_json(self.out / RESULTS, record)
        return 0
