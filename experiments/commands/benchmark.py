"""``gplfd benchmark``: many policies, doors and seeds, and a table."""

from __future__ import annotations

import argparse
import contextlib
import dataclasses
import sys
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import tyro

from experiments.commands.complaint import complain
from experiments.study.engines import EngineName
from experiments.study.settings import StudySettings

if TYPE_CHECKING:
    from experiments.study.engines import Engine
    from experiments.study.tasks import Task

_SHOWN_ERRORS = 3


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

    engine: EngineName = "loky"
    """Where to run: in processes of this machine, here in order, or on a Dask cluster
    (`pip install 'gplfd[dask]'`)."""

    workers: Annotated[int | None, tyro.conf.arg(metavar="N")] = None
    """Number of loky's processes; one per core by default."""

    address: Annotated[str | None, tyro.conf.arg(metavar="tcp://HOST:PORT")] = None
    """Scheduler of the Dask cluster."""

    record: bool = False
    """Also record the best, the median and the worst episode of every policy."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        from experiments.study.plan import checked, tasks
        from experiments.study.store import damaged_results, made_by_other_code

        try:
            settings = checked(self.study)
            study = tasks(settings)
            engine = self._engine()
            self._write_settings(settings)
            for reason in damaged_results(self.out, study):
                _say(f"warning: {reason}; its task is run again")
            others = made_by_other_code(self.out, study)
            self._warn_of_other_code(others, len(study))
            self._run(study, engine)
        except (ValueError, OSError) as error:
            return complain(error)
        # Workers elsewhere may have another version of this package.
        if (others_now := made_by_other_code(self.out, study)) > others:
            self._warn_of_other_code(others_now, len(study))
        self._tell_errors(study)
        self._print_tables(settings)
        if self.record:
            from experiments.extremes import record_extremes

            record_extremes(self.out)
        print(f"\nresults are in {self.out}; compare them:  gplfd report {self.out}")
        return 0

    def _engine(self) -> Engine:
        from experiments.study.engines import engine_named

        if self.out.exists() and not self.out.is_dir():
            raise ValueError(f"--out {self.out} is a file; give a folder")
        return engine_named(self.engine, workers=self.workers, address=self.address)

    def _write_settings(self, settings: StudySettings) -> None:
        from experiments.files.plain_data import write_json
        from experiments.files.provenance import provenance
        from experiments.study.settings_file import write_settings

        how = {
            one.name: getattr(self, one.name)
            for one in dataclasses.fields(self)
            if one.name != "study"
        }
        config = dataclasses.asdict(settings) | how | {"out": str(self.out)}
        write_json(self.out / "study.json", provenance(config))
        write_settings(self.out / "study.toml", settings)

    def _run(self, study: Sequence[Task], engine: Engine) -> None:
        """Run what is missing behind a progress bar that counts tasks."""
        from tqdm import tqdm

        from experiments.study.runner import run_study
        from experiments.study.store import is_finished, stored_result

        done = sum(is_finished(stored_result(self.out, task)) for task in study)
        # Where nobody watches, a line now and then is enough.
        pause = 0.5 if sys.stderr.isatty() else 30.0
        with (
            contextlib.closing(run_study(self.out, study, engine)) as results,
            tqdm(
                total=len(study),
                initial=done,
                unit="task",
                mininterval=pause,
                maxinterval=pause,
                # Policies differ by the time they take: the mean tells most.
                smoothing=0.0,
            ) as bar,
        ):
            for _ in results:
                bar.update()

    def _print_tables(self, settings: StudySettings) -> None:
        from policies.storage import complete_or_absent

        text = "\n\n".join(_tables(self.out, settings))
        with complete_or_absent(self.out / "table.md") as path:
            path.write_text(text + "\n", encoding="utf-8")
        print(text)

    def _tell_errors(self, study: Iterable[Task]) -> None:
        from experiments.study.store import stored_result

        failed = [
            result
            for task in study
            if "error" in (result := stored_result(self.out, task) or {})
        ]
        for result in failed[:_SHOWN_ERRORS]:
            _say(f"{_named(result['task'])}: {result['error']}")
        if failed:
            _say(
                f"{len(failed)} tasks ended with an error, kept in "
                f"{self.out / 'tasks'}; the same command tries them again"
            )

    def _warn_of_other_code(self, others: int, total: int) -> None:
        if others:
            _say(
                f"warning: {others} of {total} results were made by other code "
                "(another git state or other package versions); use another --out or "
                f"delete {self.out} to have one version"
            )


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
    from experiments.study.settings_file import settings_named

    return partial(Benchmark, study=settings_named(given.config))


def _tables(folder: Path, settings: StudySettings) -> Iterator[str]:
    """Yield a table per condition of the study, and what is missing in it."""
    from experiments.files.table import markdown_table
    from experiments.results.reading import read_files
    from experiments.results.table import error_count, study_table
    from experiments.study.plan import conditions, episodes
    from experiments.study.store import result_path

    several = list(conditions(settings))
    for condition in several:
        tasks = episodes(settings, condition, range(settings.seeds))
        files = (result_path(folder, task) for task in tasks)
        results, _, unreadable = read_files(files)
        if len(several) > 1:
            yield f"{condition}:"
        yield from filter(None, (error_count(results), *unreadable))
        yield markdown_table(study_table(results))


def _named(task: Mapping[str, Any]) -> str:
    what = task["door"] if task["kind"] == "episode" else f"{task['held_out']} left out"
    return f"{task['policy']}, {what}, seed {task['seed']}"


def _say(text: str) -> None:
    print(f"gplfd: {text}", file=sys.stderr)
