"""``gplfd list``: what there is to run."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments and randomizations, a line about each."""

    def execute(self) -> int:
        """Print the catalogue."""
        from experiments.catalogue import catalogue

        print(catalogue())
        return 0
