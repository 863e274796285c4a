"""``gplfd benchmark``: many policies, doors and seeds, and a table."""

import argparse
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import tyro

from gplfd.experiments.commands.options import (
    ON_THIS_MACHINE,
    EngineOptions,
    next_command,
    recorded,
)
from gplfd.experiments.interruption import postponed_interruption
from gplfd.experiments.study.settings import StudySettings

FAILED: Final = 1
"""Exit status of a study some of whose tasks ended in errors."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Benchmark:
    """Compare policies on doors and seeds and print a table; resumable.

    Writes DIR/tasks/<hash>.json (one per episode or test of what is learned),
    DIR/study.json (versions, command, settings), DIR/study.toml (the settings, for
    --config) and DIR/table.md. Started again with the same folder, it skips what is
    done and tries again what failed; more seeds, doors or policies add to it.
    """

    config: Annotated[
        str,
        tyro.conf.arg(metavar="{table-1,small}|FILE.toml"),
    ] = "table-1"
    """The study to run: the whole comparison, one of two minutes, or a saved
    study.toml. Options given here win over it."""

    study: Annotated[StudySettings, tyro.conf.arg(name="")] = field(
        default_factory=StudySettings
    )
    """What to compare."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/benchmark")
    """Folder to write to, or to go on in."""

    where: Annotated[EngineOptions, tyro.conf.arg(name="")] = ON_THIS_MACHINE
    """Where to run."""

    record: bool = False
    """Also record the best, the median and the worst episode of every policy."""

    quiet: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show no progress, only results and what went wrong."""

    def execute(self) -> int:
        """Run the study, print its tables, and return `FAILED` if a task failed."""
        with postponed_interruption():
            from gplfd.experiments.arguments import check_folder
            from gplfd.experiments.results.table import write_tables
            from gplfd.experiments.study.plan import checked, tasks
            from gplfd.experiments.study.session import carry_out
            from gplfd.experiments.study.settings_file import write_settings

        settings = checked(self.study)
        engine = self.where.made()
        options = recorded(self)
        del options["study"]
        options = dataclasses.asdict(settings) | options
        check_folder(self.out)
        write_settings(self.out / "study.toml", settings)
        errors = carry_out(tasks(settings), options, self.out, engine)
        print(write_tables(self.out, settings))
        if self.record:
            with postponed_interruption():
                from gplfd.experiments.extremes import record_extremes

            record_extremes(self.out)
        report = next_command("report", self.out)
        print(f"\nresults are in {self.out}; compare them:  {report}")
        return FAILED if errors else 0


def benchmark_from(arguments: Sequence[str]) -> Callable[..., Benchmark]:
    """Return `Benchmark` with the options of ``--config`` as its defaults.

    Args:
        arguments: Of the command ``gplfd``, of any subcommand.

    Raises:
        ValueError: The study is unknown or its file wrong.
        OSError: The file cannot be read.
    """
    parser = argparse.ArgumentParser(add_help=False, allow_abbrev=False)
    parser.add_argument("--config", nargs="?")
    given, _ = parser.parse_known_args(arguments)
    if list(arguments[:1]) != ["benchmark"] or given.config is None:
        return Benchmark
    with postponed_interruption():
        from gplfd.experiments.study.settings_file import settings_named

    return partial(Benchmark, study=settings_named(given.config))
