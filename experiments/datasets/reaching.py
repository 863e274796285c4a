"""Demonstrations that reach for the handle before they open the door."""

from collections.abc import Sequence
from typing import Final

from gplfd.experiments.datasets.npz import LabelledDemonstrations
from gplfd.experiments.teacher import Teacher, doors_like
from gplfd.policies.demonstrations import Demonstration
from gplfd.policies.reaching import joined, parted
from gplfd_env.config import DoorConfig
from gplfd_env.task import Start

GRASPED: Final = "grasped"
"""Signal of demonstrations, (N, 1): 1 while the hand holds the handle, else 0."""


def taught(
    per_door: int, *, seed: int, like: DoorConfig, start: Start
) -> LabelledDemonstrations:
    """Return what the synthetic human shows to whoever is to open a door.

    Args:
        per_door: How often each of three doors is opened.
        seed: Of everything that is drawn.
        like: Door of whose kind they are.
        start: Whether the person reaches for the handle; the openings are the same.
    """
    teacher = Teacher()
    shown = teacher.standard_demonstrations(per_door, seed=seed, like=like)
    radii = tuple(door.radius for door in doors_like(like) for _ in range(per_door))
    if start == "grasped":
        return LabelledDemonstrations(demonstrations=shown, radii=radii)
    reaches = teacher.standard_reaches(per_door, seed=seed)
    whole = tuple(map(joined, reaches, shown))
    holding = ({GRASPED: (one.times[:, None] >= 0.0).astype(float)} for one in whole)
    return LabelledDemonstrations(
        demonstrations=whole, radii=radii, signals=tuple(holding)
    )


def openings(given: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return the demonstrations from where their hands hold the handle."""
    return [opening for _, opening in _parted(given)] or given.demonstrations


def reaches(given: LabelledDemonstrations) -> Sequence[Demonstration]:
    """Return how the hands of demonstrations come to the handle.

    Raises:
        ValueError: They hold it from the beginning.
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
