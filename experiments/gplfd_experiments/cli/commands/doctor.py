"""``gplfd doctor``: what is installed here, and what is missing."""

from dataclasses import dataclass

from gplfd_experiments.cli.commands.options import Json
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Doctor:
    """Show what is installed, and what is missing for pictures, windows and extras.

    Nothing that is missing is an error: the exit status is 0. Add the output to a
    bug report.
    """

    json: Json = False

    def execute(self) -> int:
        """Look, and print what was found."""
        with postponed_interruption():
            from gplfd_experiments.cli.doctor import examined, text
            from gplfd_experiments.files.plain_data import json_text

        found = examined()
        print(json_text(found.as_json()) if self.json else text(found))
        return 0
