"""Commands for submissions to the leaderboard: submit and verify."""

import secrets
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any, get_type_hints

import tyro

from gplfd_experiments.cli.commands import options
from gplfd_experiments.workflows.settings import Card


@dataclass(frozen=True, kw_only=True, slots=True)
class Submit(Card):
    """Write the results of trials, and who and what made them, into one archive.

    The archive has the results, versions, settings, a card, the hashes of all files and
    the policies that are files below the working folder. Results that do not follow the
    protocol are refused, with exit status 1.
    """

    folder: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="DIR")]
    """Folder of `gplfd trials`."""

    out: Annotated[Path, tyro.conf.arg(metavar="FILE.zip")] = Path("submission.zip")
    """Archive to write."""

    card: Annotated[Path | None, tyro.conf.arg(metavar="FILE.toml")] = None
    """Card with the keys authors, code, training_data and knowledge. The options of
    these names take precedence; all four must be stated."""

    files: Annotated[tuple[Path, ...], tyro.conf.arg(metavar="FILE")] = ()
    """Further files that a policy needs, such as weights, below the working folder."""

    def execute(self) -> int:
        """Write the archive, and print how to propose it."""
        from gplfd_experiments.files.plain_data import entry, naming, read_toml
        from gplfd_experiments.workflows.submissions import submit

        stated: dict[str, Any] = read_toml(self.card) if self.card else {}
        with naming(self.card or Path("options")):
            for name, kind in get_type_hints(Card).items():
                stated[name] = getattr(self, name) or entry(
                    {name: None, **stated}, name, kind | None
                )
        if problems := submit(self.folder, self.out, Card(**stated), self.files):
            print("\n".join(problems))
            print("nothing is written: the results do not follow the protocol")
            return options.FAILED
        print(
            f"{self.out}: check it with  {options.next_command('verify', self.out)}"
            " (--trust runs policies in it)\n"
            "Propose it by a pull request that adds it to docs/results/submissions; "
            "its text is .github/PULL_REQUEST_TEMPLATE/submission.md"
        )
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Verify:
    """Check the hashes of a submission, and run a random tenth of its tasks again.

    Numbers must be equal; from another processor, all but forecasts to 0.1 (N, degrees,
    s, mm) or a tenth of a percent. A difference ends with exit status 1.
    """

    archive: Annotated[Path, tyro.conf.Positional, tyro.conf.arg(metavar="FILE.zip")]
    """Archive of `gplfd submit`."""

    seed: int | None = None
    """Seed that chooses the tasks, at least one; by default another one each time."""

    trust: tyro.conf.FlagCreatePairsOff[bool] = False
    """Run the policies in the archive, which are code of others, and those at addresses
    that it names."""

    where: options.Where = options.ON_THIS_MACHINE
    quiet: options.Quiet = False

    def execute(self) -> int:
        """Print what differs; return `FAILED` if anything does."""
        from gplfd_experiments.workflows.submissions import verify

        self.where.check()
        seed = secrets.randbelow(10**6) if self.seed is None else self.seed
        problems = verify(self.archive, seed, self.where, trust=self.trust)
        print("\n".join(problems) or f"{self.archive}: equal in all that was run again")
        return options.FAILED if problems else 0
