"""``gplfd list``: what there is to run."""

from dataclasses import dataclass

from gplfd_experiments.cli.commands.options import Json
from gplfd_experiments.console.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments, randomizations and disturbances."""

    json: Json = False

    def execute(self) -> int:
        """Print the catalogue."""
        with postponed_interruption():
            from gplfd_experiments.cli.catalogue import catalogue, catalogue_json
            from gplfd_experiments.files.plain_data import json_text

        print(json_text(catalogue_json()) if self.json else catalogue())
        return 0
