"""``gplfd trials``: the frozen protocol of trials, whole or in part."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

import tyro

from gplfd_experiments.cli.commands.options import (
    ON_THIS_MACHINE,
    EngineOptions,
    Json,
    next_command,
    recorded,
)
from gplfd_experiments.console.interruption import postponed_interruption

FAILED = 1
"""Exit status if some episodes ended in errors."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Trials:
    """Test the ideas of the method in the conditions where each matters; resumable.

    Writes what `gplfd benchmark` writes. The whole protocol takes about an hour of two
    cores; `--part ideas` a third of that, `--part small` two minutes.
    """

    trials: tuple[str, ...] = ()
    """Trials to run (radius, further, few, messy, rests, turned, person, push, stop,
    locked, heavy, breakaway, delay, noise); by default all that the part has."""

    policies: tuple[str, ...] = ()
    """Additional policies: names from `gplfd list`, or module:function for your
    own."""

    part: Literal["whole", "ideas", "small"] = "whole"
    """The whole protocol; of it gp, hinge-fit and the variants that lack an idea; or a
    first look: six seeds of the strongest contrasts of five trials."""

    out: Annotated[Path, tyro.conf.arg(metavar="DIR")] = Path("results/trials")
    """Folder to write to; an unfinished study in it is resumed."""

    where: Annotated[EngineOptions, tyro.conf.arg(name="")] = ON_THIS_MACHINE
    """Where to run."""

    record: bool = False
    """Also write a recording per trial of the compared policies side by side."""

    json: Json = False

    quiet: tyro.conf.FlagCreatePairsOff[bool] = False
    """Show no progress, only results, warnings and errors."""

    def execute(self) -> int:
        """Run the trials and return `FAILED` if an episode failed.

        As JSON it prints what `gplfd report` keeps of the folder in trials.json.
        """
        with postponed_interruption():
            from gplfd_experiments.analysis.results.reading import read_results
            from gplfd_experiments.analysis.results.trials_file import trial_answers
            from gplfd_experiments.files.plain_data import json_text
            from gplfd_experiments.studies.runner import run_or_resume
            from gplfd_experiments.studies.trials.plan import named_trials, trial_tasks

        tasks = trial_tasks(
            named_trials(self.trials, self.part),
            policies=self.policies,
            part=self.part,
        )
        engine = self.where.made()
        errors = run_or_resume(tasks, recorded(self), self.out, engine)
        if self.record:
            with postponed_interruption():
                from gplfd_experiments.workflows.trial_recordings import record_trials

            record_trials(self.out)
        if self.json:
            print(json_text(trial_answers(read_results(self.out))))
        else:
            report = next_command("report", self.out)
            print(f"results are in {self.out}; read them:  {report}")
        return FAILED if errors else 0
