"""``gplfd benchmark``: many policies, doors and seeds, and a table."""

import argparse
import contextlib
import dataclasses
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Annotated, Final

import tyro

from gplfd_experiments.cli.commands.options import (
    ON_THIS_MACHINE,
    EngineOptions,
    Json,
    next_command,
    recorded,
)
from gplfd_experiments.console.interruption import postponed_interruption
from gplfd_experiments.studies.settings import PRESETS, StudySettings

FAILED: Final = 1
"""Exit status of a study some of whose tasks ended in errors."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Benchmark:
    """Compare policies on doors and seeds and print a table; resumable.

    Writes DIR/tasks/<hash>.json (one file per episode or prediction test),
    DIR/study.json (versions, command, settings), DIR/study.toml (the settings, for
    --config) and DIR/table.md. Started again with the same folder, it skips finished
    tasks and repeats failed ones. More seeds, doors or policies extend the study.
    """

    config: Annotated[
        str,
        tyro.conf.arg(metavar="{table-1,small}|FILE.toml"),
    ] = "table-1"
    """The study to run: table-1 (the whole comparison), small (a minute), or a
    saved study.toml. Options on the command line take precedence."""

    study: Annotated[StudySettings, tyro.conf.arg(name="")] = field(
        default_factory=StudySettings
    )
    """What to compare."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/benchmark")
    """Folder to write to; an unfinished study in it is resumed."""

    where: Annotated[EngineOptions, tyro.conf.arg(name="")] = ON_THIS_MACHINE
    """Where to run."""

    record: bool = False
    """Also write recordings of the best, the median and the worst episode of every
    policy."""

    json: Json = False

    quiet: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show no progress, only results, warnings and errors."""

    def execute(self) -> int:
        """Run the study, print its tables, and return `FAILED` if a task failed."""
        with postponed_interruption():
            from gplfd_experiments.analysis.results.table import (
                study_rows,
                write_tables,
            )
            from gplfd_experiments.console.arguments import check_folder
            from gplfd_experiments.files.plain_data import json_text, naming
            from gplfd_experiments.studies.plan import checked, tasks
            from gplfd_experiments.studies.runner import run_or_resume
            from gplfd_experiments.studies.settings_file import write_settings

        # The values are the file's, but for those given on the command line.
        from_file = self.config not in PRESETS
        with naming(Path(self.config)) if from_file else contextlib.nullcontext():
            settings = checked(self.study)
        engine = self.where.made()
        options = recorded(self)
        del options["study"]
        options = dataclasses.asdict(settings) | options
        check_folder(self.out)
        write_settings(self.out / "study.toml", settings)
        errors = run_or_resume(tasks(settings), options, self.out, engine)
        tables = write_tables(self.out, settings)
        print(json_text(study_rows(self.out, settings)) if self.json else tables)
        if self.record:
            with postponed_interruption():
                from gplfd_experiments.workflows.extremes import record_extremes

            record_extremes(self.out)
        if not self.json:
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
        from gplfd_experiments.studies.settings_file import settings_named

    return partial(Benchmark, study=settings_named(given.config))
