"""Commands for this machine and this installation: list and doctor."""

import re
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from gplfd_experiments.cli.commands.options import Json


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments, randomizations and disturbances."""

    json: Json = False

    def execute(self) -> int:
        """Print the catalogue."""
        from gplfd_experiments.cli.doctor import catalogue
        from gplfd_experiments.files.plain_data import json_text

        sections = catalogue()
        if self.json:  # The key of a section is the first word of its title.
            keys = (re.split(r"\W", title, maxsplit=1)[0] for title in sections)
            print(json_text(dict(zip(keys, sections.values(), strict=True))))
        else:
            print(_text(sections))
        return 0


@dataclass(frozen=True, kw_only=True, slots=True)
class Doctor:
    """Show what is installed, and what is missing for pictures, windows and extras.

    Missing parts are not errors: the exit status is 0. Add the output to a bug report.
    """

    json: Json = False

    def execute(self) -> int:
        """Check the installation and print the results."""
        from gplfd_experiments.cli.doctor import examined
        from gplfd_experiments.files.plain_data import json_text

        results = examined()
        if self.json:
            print(json_text(results))
            return 0
        for name, part in results["parts"].items():
            present = "yes  " if part["present"] else "NO   "
            results["parts"][name] = f"{present}{part['purpose']}: {part['remark']}"
        print(_text(results))
        return 0


def _text(sections: Mapping[str, Mapping[str, Any]]) -> str:
    """Return names and their texts in two columns below the title of each section."""
    return "\n\n".join(
        "\n".join([title, *(f"  {name:<{width}}  {lines[name]}" for name in lines)])
        for title, lines in sections.items()
        if (width := max(map(len, lines), default=0))
    )
