"""``gplfd speed``: how fast and how accurate, beside other libraries."""

from __future__ import annotations

import dataclasses
import sys
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from experiments.commands.complaint import complain

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

    def execute(self) -> int:
        """Run the command and return the exit status."""
        # Parsing the command line must not wait for what is measured.
        from experiments.files.plain_data import write_json
        from experiments.files.provenance import provenance
        from experiments.speed.machine import machine
        from experiments.speed.parts import PARTS, announcement
        from experiments.speed.report import measure_all

        try:
            self._check()
        except ValueError as error:
            return complain(error)
        chosen = [name for name in PARTS if not self.only or name in self.only]
        print(announcement(chosen, self.repeats), file=sys.stderr, flush=True)
        measures = {k: v for name in chosen for k, v in PARTS[name].measures.items()}
        found = measure_all(measures, self.repeats)
        record = provenance(dataclasses.asdict(self) | {"out": str(self.out)}) | {
            "measured_on": machine(),
            "results": {name: dataclasses.asdict(one) for name, one in found.items()},
        }
        try:
            write_json(self.out / RESULTS, record)
        except OSError as error:
            return complain(error)
        return 0

    def _check(self) -> None:
        if self.repeats < 1:
            raise ValueError(f"--repeats {self.repeats} must be 1 or more")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file; give a folder")
