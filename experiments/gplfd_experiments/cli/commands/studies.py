"""Commands for studies: benchmark, trials, skill, report and figures."""

import contextlib
import dataclasses
from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gplfd_experiments.cli.commands import options
from gplfd_experiments.studies.settings import PRESETS, TABLE_1_NAME, StudySettings


@dataclass(frozen=True, kw_only=True, slots=True)
class Benchmark:
    """Compare policies on doors and seeds and print a table; resumable.

    Writes DIR/tasks/<hash>.json (one file per episode or prediction test),
    DIR/study.json (versions, command, settings), DIR/study.toml (the settings,
    for --config) and DIR/table.md. Run with an existing folder, it skips finished tasks
    and repeats failed ones. More seeds, doors or policies extend the study.
    """

    config: Annotated[str, tyro.conf.arg(metavar="{table-1,small}|FILE.toml")] = (
        "table-1"
    )
    """The study to run: table-1 (the whole comparison), small (a minute), or a
    saved study.toml. Options on the command line take precedence."""

    study: Annotated[StudySettings, tyro.conf.arg(name="")] = field(
        default_factory=StudySettings
    )
    """Policies, doors and seeds of the study."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/benchmark")
    """Folder to write to; an unfinished study in it is resumed."""

    where: options.Where = options.ON_THIS_MACHINE
    all: options.All = False
    json: options.Json = False
    quiet: options.Quiet = False

    def execute(self) -> int:
        """Run the study, print its tables, and return `FAILED` if a task failed."""
        from gplfd_experiments.analysis.results.measures import write_tables
        from gplfd_experiments.files.folders import folder_in_use
        from gplfd_experiments.files.plain_data import json_text, naming
        from gplfd_experiments.files.table import FIRST, text_table
        from gplfd_experiments.studies.runner import run_or_resume
        from gplfd_experiments.studies.settings import write_settings
        from gplfd_experiments.studies.tasks import checked, tasks

        # Values of the file, except those given on the command line.
        from_file = self.config not in PRESETS
        with naming(Path(self.config)) if from_file else contextlib.nullcontext():
            settings = checked(self.study)
        self.where.check()
        stored = dataclasses.asdict(settings) | options.recorded(self)
        del stored["study"]
        study = tasks(settings)
        with folder_in_use(self.out) as folder:
            write_settings(folder / "study.toml", settings)
            errors = run_or_resume(study, stored, folder, self.where)
            parts, rows = write_tables(folder, settings)
        if self.json:
            print(json_text(rows))
        else:
            columns = None if self.all else FIRST
            for part in parts:
                text = part if isinstance(part, str) else text_table(part, columns)
                print(f"{text}\n")
            report = options.next_command("report", self.out)
            print(f"results are in {self.out}; compare them:  {report}")
        return options.FAILED if errors else 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Trials:
    """Test each idea of the method in conditions where it matters; resumable.

    Writes the same files as `gplfd benchmark`. The whole protocol has 16,380 episodes,
    `--part ideas` 5,780, and `--part small` 270, which take about a minute.
    """

    trials: tuple[str, ...] = ()
    """Trials to run, such as radius or heavy (docs/tasks.md); default: the part's."""

    policies: tuple[str, ...] = ()
    """Additional policies: names from `gplfd list`, module:function, or
    ws://HOST:PORT of a server (openpi protocol)."""

    part: Literal["whole", "ideas", "small"] = "whole"
    """whole: all policies; ideas: gp, hinge-fit and the variants that lack an idea;
    small: six seeds of the strongest contrasts of five trials, for a first look."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/trials")
    """Folder to write to; an unfinished study in it is resumed."""

    robot: str = "tiago-like"
    """Robot that opens the doors: tiago-like, panda-like, ur5e-like, or a .urdf or
    .json of an arm."""

    where: options.Where = options.ON_THIS_MACHINE
    json: options.Json = False
    quiet: options.Quiet = False

    def execute(self) -> int:
        """Run the trials; as JSON, print trials.json as `gplfd report` writes it."""
        from gplfd_experiments.analysis.results.reading import read_results
        from gplfd_experiments.analysis.results.trials import trial_answers
        from gplfd_experiments.files.folders import folder_in_use
        from gplfd_experiments.files.plain_data import json_text
        from gplfd_experiments.studies.runner import run_or_resume
        from gplfd_experiments.studies.trials.protocol import named_trials, trial_tasks

        tasks = trial_tasks(
            named_trials(self.trials, self.part),
            policies=self.policies,
            part=self.part,
            robot=self.robot,
        )
        self.where.check()
        with folder_in_use(self.out) as folder:
            errors = run_or_resume(tasks, options.recorded(self), folder, self.where)
        if self.json:
            print(json_text(trial_answers(read_results(folder))))
        else:
            report = options.next_command("report", self.out)
            print(f"results are in {self.out}; read them:  {report}")
        return options.FAILED if errors else 0


@dataclass(frozen=True, kw_only=True, slots=True)
class SkillTests:
    """Compare methods on recordings: predict each from the others, without a robot.

    Writes DIR/report.html and report.md (errors, coverage of the stated uncertainty,
    forecasts after a part was observed) and DIR/tasks/, a result each; resumable.
    """

    recordings: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="DEMOS.npz")
    ]
    """Three or more demonstrations: a set, or the file of a `gplfd run`."""

    policies: tuple[str, ...] = (TABLE_1_NAME,)
    """Methods to compare; see `gplfd list`. "table-1" stands for gp and the eight
    of the paper's Table 1."""

    reference: Annotated[str, tyro.conf.arg(metavar="POLICY")] = "gp"
    """Method with which the others are compared."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/skill")
    """Folder to write to; unfinished tests in it are resumed."""

    where: options.Where = options.ON_THIS_MACHINE
    all: options.All = False
    quiet: options.Quiet = False

    def execute(self) -> int:
        """Run the tests, print a table; return `FAILED` if a method cannot learn."""
        from gplfd_experiments.files.folders import folder_in_use
        from gplfd_experiments.files.table import FIRST
        from gplfd_experiments.workflows.skills import judge

        with folder_in_use(self.out) as folder:
            errors = judge(
                self.recordings,
                folder,
                policies=self.policies,
                reference=self.reference,
                engine=self.where,
                options=options.recorded(self) | {"recordings": self.recordings.name},
                columns=None if self.all else FIRST,
            )
        print(f"{self.out / 'report.html'} and report.md")
        return options.FAILED if errors else 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Report:
    """Write a report of a study: rankings with intervals, paired tests, plots.

    Reads DIR/tasks/*.json and DIR/study.json, runs nothing, and writes report.html (a
    self-contained page), report.md, figures/ and, for trials, trials.json with all
    numbers by seed. The same results give the same bytes.
    """

    folders: Annotated[
        tyro.conf.Positional[tuple[Path, ...]], tyro.conf.arg(metavar="DIR")
    ]
    """Folders of studies or trials; their results are combined."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="DIR")] = None
    """Folder to write to; the folder of the first study by default."""

    check: bool = False
    """Write nothing; exit with status 1 unless the results follow the protocol."""

    reference: Annotated[str, tyro.conf.arg(metavar="POLICY")] = "gp"
    """Policy with which the others are compared; the best if the study lacks it."""

    rows: Annotated[Path | None, tyro.conf.arg(metavar="FILE.csv")] = None
    """Also write a row per task."""

    def execute(self) -> int:
        """Write the pages, print their location; `FAILED` if all tasks failed."""
        from gplfd_experiments.analysis.report.page import unfinished, write_report
        from gplfd_experiments.analysis.results.measures import write_rows
        from gplfd_experiments.analysis.results.reading import read_results
        from gplfd_experiments.console.arguments import check_folder
        from gplfd_experiments.console.progress import LOG

        if not self.folders:
            raise ValueError("give the folder of a study: gplfd report DIR")
        if self.out is not None and not self.check:
            check_folder(self.out)
        results = read_results(*self.folders)
        if self.check:
            from gplfd_experiments.analysis.results.trials import protocol_problems
            from gplfd_experiments.studies.trials.protocol import VERSION

            problems = protocol_problems(results)
            for problem in problems:
                print(problem)
            if not problems:
                print(f"the results follow protocol v{VERSION}")
            return options.FAILED if problems else 0
        if self.rows is not None:
            write_rows(self.rows, results)
        page = write_report(results, self.folders[0], self.out, self.reference)
        for reason in results.unreadable:
            LOG.warning("warning: left out: %s", reason)
        if missing := unfinished(results):
            LOG.warning("warning: %s", missing)
        print(f"{page} and {page.with_suffix('.md')}")
        return 0 if any(not result.error for result in results.all) else options.FAILED


@dataclass(frozen=True, kw_only=True, slots=True)
class Figures:
    """Draw the paper's figures from this project's own runs.

    Writes DIR/<figure>.png and .svg, DIR/captions.md (descriptions and numbers) and
    DIR/figures.json (versions, command, settings).
    """

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/figures")
    """Folder to write to; figures are added to an existing folder."""

    only: tuple[str, ...] = ()
    """Figures to draw, for example fig02 fig09; all by default."""

    seed: int = 0
    """Seed of teacher, policy, environment and synthetic sets, 0 or more."""

    quiet: options.Quiet = False

    def execute(self) -> int:
        """Draw the figures and print their location."""
        from gplfd_experiments.workflows.figures import draw_figures

        stored = options.recorded(self)
        number = draw_figures(self.out, self.only, seed=self.seed, options=stored)
        print(f"{number} figures and captions.md in {self.out}")
        return 0
