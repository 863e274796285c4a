"""``gplfd list``: what there is to run."""

from dataclasses import dataclass

from experiments.interruption import postponed_interruption


@dataclass(frozen=True, kw_only=True, slots=True)
class Catalogue:
    """List doors, policies, environments and randomizations, a line about each."""

    def execute(self) -> int:
        """Print the catalogue."""
        with postponed_interruption():
            from experiments.catalogue import catalogue

        print(catalogue())
        return 0
