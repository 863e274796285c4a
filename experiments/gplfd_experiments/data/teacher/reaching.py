"""Demonstrations that reach for a handle and then open the door."""

from collections.abc import Sequence

from gplfd_policies.agents.reaching import GRASPED, join_at_grasp
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import LabelledDemonstrations


def with_reaches(
    reaches: Sequence[Demonstration],
    openings: Sequence[Demonstration],
    radii: Sequence[float | None],
) -> LabelledDemonstrations:
    """Join reaches and openings; a signal says whether the hand holds the handle.

    A radius [m] is that of the opened door, or None.
    """
    whole = tuple(map(join_at_grasp, reaches, openings))
    grasped = [{GRASPED: (one.times[:, None] >= 0.0).astype(float)} for one in whole]
    return LabelledDemonstrations(
        demonstrations=whole, radii=tuple(radii), signals=tuple(grasped)
    )
