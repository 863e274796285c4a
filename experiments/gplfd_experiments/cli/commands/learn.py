"""``gplfd learn``: a skill from demonstrations, in a file."""

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

import tyro

from gplfd_experiments.cli.commands.options import Quiet, next_command
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Learn:
    """Learn a skill from demonstrations and keep it in a file.

    The file holds arrays only, no code; `gplfd run --skill FILE` and
    `gplfd_policies.load_skill` read it.
    """

    demonstrations: Annotated[
        Path, tyro.conf.Positional, tyro.conf.arg(metavar="DEMOS.npz")
    ]
    """File of demonstrations, such as demonstrations.npz of a `gplfd run`."""

    out: Annotated[Path | None, tyro.conf.arg(metavar="FILE")] = None
    """File to write, DEMOS-skill.npz by default; one that is there already is
    replaced."""

    policy: str = "gp"
    """Policy whose skill to learn: gp or one of its variants; see `gplfd list`."""

    seed: int = 0
    """Seeds whatever is random in the learning, 0 or more."""

    quiet: Quiet = False

    def execute(self) -> int:
        """Learn, and print how to use the file."""
        with postponed_interruption():
            from gplfd_experiments.workflows.skills import learn_skill

        out = self.out or Path(f"{self.demonstrations.stem}-skill.npz")
        skill = learn_skill(
            self.demonstrations, out, policy=self.policy, seed=self.seed
        )
        print(f"{out}: {skill}")
        print(f"open doors with it:  {next_command('run', '--skill', out)}")
        return 0
