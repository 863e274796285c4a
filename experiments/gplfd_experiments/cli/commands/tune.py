"""``gplfd tune``: the best settings of every method, found alike."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gplfd_experiments.cli.commands.options import Json, Quiet
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Tune:
    """Tune methods with equal budgets on doors and seeds that no study uses.

    Writes DIR/evaluations/<hash>.json and, when all are done, DIR/tuned.json: the best
    settings of each method, and what they and the published ones gave. Started again
    with the same folder, it skips what is done. Copied to policies/tuned.json, the file
    makes the policies <name>-tuned.
    """

    policies: tuple[str, ...] = ()
    """Methods to tune; by default all of Table 1, and tp-gmm."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/tuning")
    """Folder to write to, or to go on in."""

    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of processes; one per core by default."""

    json: Json = False

    quiet: Quiet = False
    """Show no progress, only results, warnings and errors."""

    def execute(self) -> int:
        """Tune, and print methods as published and tuned."""
        with postponed_interruption():
            from gplfd_experiments.files.plain_data import json_text, read_json
            from gplfd_experiments.studies.engines import engine_named
            from gplfd_experiments.studies.tuning.candidates import checked_policies
            from gplfd_experiments.studies.tuning.search import FILE, tune

        policies = checked_policies(self.policies)
        engine = engine_named("loky", workers=self.workers)
        table = tune(policies, self.out, engine)
        if self.json:
            print(json_text(read_json(self.out / FILE)["policies"]))
        else:
            print(f"{table}\n\nthe settings are in {self.out / FILE}")
        return 0
