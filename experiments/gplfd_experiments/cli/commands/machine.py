"""Commands for this machine and this installation: speed, list and doctor."""

import dataclasses
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import Annotated, Final, Literal

import tyro

from gplfd_experiments.cli.commands.options import Json, Quiet, recorded

RESULTS: Final = "speed.json"

PartName = Literal["fit", "adapt", "align", "environment"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Speed:
    """Measure speed and accuracy of policies and environment; takes minutes.

    Prints tables and writes DIR/speed.json. Times are CPU times with one BLAS thread.
    Compared programs run in turns, in one process. Other libraries are installed by pip
    install 'gplfd[bench]'; otherwise their lines show "not installed".
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
        measures = {
            measured: partial(measure, self.repeats)
            for name in chosen
            for measured, measure in PARTS[name].measures.items()
        }
        found = measure_all(measures)
        record = provenance(recorded(self)) | {
            "measured_on": machine(),
            "results": {name: dataclasses.asdict(one) for name, one in found.items()},
        }
        write_json(self.out / RESULTS, record)
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments, randomizations and disturbances."""

    json: Json = False

    def execute(self) -> int:
        """Print the catalogue."""
        from gplfd_experiments.cli.catalogue import catalogue, catalogue_json
        from gplfd_experiments.files.plain_data import json_text

        print(json_text(catalogue_json()) if self.json else catalogue())
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Doctor:
    """Show what is installed, and what is missing for pictures, windows and extras.

    Missing parts are not errors: the exit status is 0. Add the output to a bug report.
    """

    json: Json = False

    def execute(self) -> int:
        """Check the installation and print the results."""
        from gplfd_experiments.cli.doctor import examined, text
        from gplfd_experiments.files.plain_data import json_text

        found = examined()
        print(json_text(found) if self.json else text(found))
        return 0
