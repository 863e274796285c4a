"""Commands for this machine and this installation: list and doctor."""

from dataclasses import dataclass

from gplfd_experiments.cli.commands.options import Json


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments, randomizations and disturbances."""

    json: Json = False

    def execute(self) -> int:
        """Print the catalogue."""
        from gplfd_experiments.cli.catalogue import catalogue, catalogue_json
        from gplfd_experiments.files.plain_data import json_text

        print(json_text(catalogue_json()) if self.json else catalogue())
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Doctor:
    """Show what is installed, and what is missing for pictures, windows and extras.

    Missing parts are not errors: the exit status is 0. Add the output to a bug report.
    """

    json: Json = False

    def execute(self) -> int:
        """Check the installation and print the results."""
        from gplfd_experiments.cli.doctor import examined, text
        from gplfd_experiments.files.plain_data import json_text

        results = examined()
        print(json_text(results) if self.json else text(results))
        return 0
