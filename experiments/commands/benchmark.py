"""``gplfd benchmark``: many policies, doors and seeds, and a table."""

from __future__ import annotations

import dataclasses
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import tyro

from experiments.commands.complaint import complain
from experiments.commands.run import named_doors

if TYPE_CHECKING:
    from experiments.study import Task


@dataclass(frozen=True, kw_only=True, slots=True)
class Benchmark:
    """Run policies × doors × seeds and print a table; resumable.

    Writes DIR/tasks/<hash>.json (one per episode), DIR/study.json (versions, command,
    settings) and DIR/table.md. Started again with the same folder, it skips what is
    done and tries again what failed; more seeds, doors or policies add to it.
    """

    policies: tuple[str, ...] = ("gp", "gp-fixed")
    """Policies to compare; see `gplfd list`."""

    doors: tuple[str, ...] = ("small", "medium", "large")
    """Doors to open: names (see `gplfd list`) or radii in metres."""

    seeds: int = 20
    """Number of seeds: 0, 1, ... Each has demonstrations of its own."""

    demonstrations_per_door: int = 2
    """How often the synthetic human opens each of the three demonstrated doors."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/benchmark")
    """Folder to write to, or to go on in."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from tqdm import tqdm

        from experiments.atomic_write import complete_or_absent, write_json
        from experiments.provenance import provenance
        from experiments.study import run_study, tasks
        from experiments.summary import summary_table

        try:
            doors = {
                name: dataclasses.asdict(config)
                for name, config in named_doors(self.doors).items()
            }
            self._check()
            settings = dataclasses.asdict(self) | {"out": str(self.out)}
            write_json(self.out / "study.json", provenance(settings))
        except (ValueError, OSError) as error:
            return complain(error)
        study = tasks(
            self.policies, doors, range(self.seeds), self.demonstrations_per_door
        )
        self._warn_of_other_code(study)
        # Where nobody watches, a line now and then is enough.
        pause = 0.5 if sys.stderr.isatty() else 30.0
        episodes = tqdm(
            run_study(self.out, study),
            total=len(study),
            unit="episode",
            mininterval=pause,
            maxinterval=pause,
        )
        table = summary_table(episodes)
        with complete_or_absent(self.out / "table.md") as path:
            path.write_text(table + "\n", encoding="utf-8")
        print(table)
        return 0

    def _check(self) -> None:
        from policies.registry import policy_entry

        for name in self.policies:
            policy_entry(name)
            if self.policies.count(name) > 1:
                raise ValueError(f"policy {name} is given twice in --policies")
        for option, value in (
            ("--seeds", self.seeds),
            ("--demonstrations-per-door", self.demonstrations_per_door),
        ):
            if value < 1:
                raise ValueError(f"{option} {value} must be 1 or more")
        if not self.policies:
            raise ValueError("--policies needs at least one policy; see gplfd list")
        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file; give a folder")

    def _warn_of_other_code(self, study: Sequence[Task]) -> None:
        from experiments.study import made_by_other_code

        others = made_by_other_code(self.out, study)
        if others:
            print(
                f"gplfd: warning: {others} of {len(study)} results were made by other "
                "code (another git state or other package versions); use another --out "
                f"or delete {self.out} to have one version",
                file=sys.stderr,
            )
