"""Official training sets of the track *learner*, for policies that learn elsewhere."""

import math
from typing import Final

from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_policies.demonstrations.npz import LabelledDemonstrations

OFFICIAL: Final = {f"learner-{number}": number for number in (6, 50, 200)}
"""Number of demonstrations of every set, by its name."""
SEED: Final = 1000  # Of all sets; no trial has it.


def official_set(name: str) -> LabelledDemonstrations:
    """Return a set: the standard teacher at its three doors in turn.

    A larger set begins with the demonstrations of the smaller ones.
    """
    number, doors = OFFICIAL[name], len(DEMONSTRATED_RADII)
    per_door = math.ceil(number / doors)
    shown = Teacher().standard_demonstrations(per_door, seed=SEED)
    turns = [divmod(k, doors) for k in range(number)]
    return LabelledDemonstrations(
        demonstrations=tuple(shown[door * per_door + k] for k, door in turns),
        radii=tuple(DEMONSTRATED_RADII[door] for _, door in turns),
    )
