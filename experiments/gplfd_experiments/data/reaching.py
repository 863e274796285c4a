"""Demonstrations that reach for the handle before they open the door."""

from collections.abc import Sequence
from typing import Final

from gplfd_policies.agents.reaching import parted
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

GRASPED: Final = "grasped"
"""Signal of demonstrations, (N, 1): 1 while the hand holds the handle, else 0."""


def openings(given: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return the demonstrations from where their hands hold the handle."""
    return [opening for _, opening in _parted(given)] or given.demonstrations


def reaches(given: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return how the hands of demonstrations come to the handle.

    Raises:
        ValueError: The demonstrations do not say when a hand takes hold.
    """
    parts = _parted(given)
    if not parts:
        raise ValueError(
            f"these demonstrations do not say when the hand takes hold (signal "
            f"{GRASPED!r}), so that nobody can learn from them to reach for the "
            "handle; leave out --start approach, or --demonstrations"
        )
    return [reach for reach, _ in parts]


def _parted(
    given: LabelledDemonstrations,
) -> list[tuple[Demonstration, Demonstration]]:
    """Return reach and opening of each; nothing if the signal is missing."""
    if not given.signals or any(GRASPED not in one for one in given.signals):
        return []
    return [
        parted(one, signals[GRASPED][:, 0] > 0.5)
        for one, signals in zip(given.demonstrations, given.signals, strict=True)
    ]
