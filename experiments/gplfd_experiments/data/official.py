"""Official training sets of the tracks, for policies that learn elsewhere."""

import math
from dataclasses import replace
from typing import Final

import numpy as np

from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_experiments.data.teacher import Teacher, doors_like
from gplfd_policies.demonstrations.demonstration import Demonstration

_BAR, _LEVER = DoorConfig(), DOORS["room-834"]
_FOLDING, _FLAP = DOORS["bifold-closet"], DOORS["overhead-flap"]
KINDS: Final = {
    "learner": (_BAR,),
    "pipeline": (
        *(_BAR, _LEVER, _FOLDING, _FLAP),
        *map(DOORS.__getitem__, ("pocket-door", "plug-door", "kitchen-cupboard")),
        *(replace(_LEVER, swing="push"), replace(_LEVER, handle="knob")),
        *(replace(_BAR, swing="push"), replace(_BAR, hinge_side="left")),
    ),
    "forces": (_BAR, _LEVER),
    "realistic": (_BAR, _LEVER, _FOLDING),
    "corrections": (_FLAP,),
}
"""A door of every kind that a track's trials demonstrate. *learner* has only bars, from
which the first networks learned."""
OFFICIAL: Final = {f"{of}-{n}": (of, n) for of in KINDS for n in (6, 50, 200)}
"""Track and number of demonstrations of every set, by its name."""
SEED: Final = 1000  # Of all sets; no trial has it.


def official_set(name: str) -> list[tuple[Demonstration, DoorConfig]]:
    """Return demonstrations and their doors: three sizes of each kind, in turn.

    A larger set begins with the demonstrations of the smaller ones.
    """
    track, number = OFFICIAL[name]
    doors = [
        # A flap of another mass than its struts lift does not open.
        replace(like, panel_mass=kind.panel_mass, mechanism=kind.mechanism)
        for size in zip(*map(doors_like, KINDS[track]), strict=True)
        for kind, like in zip(KINDS[track], size, strict=True)
    ]
    per_door, rng = math.ceil(number / len(doors)), np.random.default_rng(SEED)
    shown = Teacher().demonstrate_doors(doors, per_door, rng=rng)
    turns = (divmod(k, len(doors)) for k in range(number))
    return [(shown[door * per_door + turn], doors[door]) for turn, door in turns]
