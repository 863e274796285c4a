"""Doors drawn from standards and manufacturers' tables: ``randomization="standard"``.

assets/README.md names the clause or table of every range.
"""

import math
from typing import Any, Final

import numpy as np

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import EN_1154, en1154, leaf, spring_hinge
from gplfd_env.doors.parts import Lockset

LEAVES: Final = (
    *((width, 0.055) for width in (0.584, 0.709, 0.834, 0.959)),
    *((w, b) for w in (0.610, 0.711, 0.762, 0.813, 0.914) for b in (0.060, 0.070)),
)
"""Width of a leaf and its backset [m]: DIN 18101 and 18251, ANSI A250 and A156.2."""

_HANDLES: Final = {"lever": 0.4, "knob": 0.375, "bar": 0.225}
_CONSTRUCTIONS: Final = ("honeycomb", "tubular-strips", "tubular-core", "chipboard")
_BEARINGS: Final = {"ball": 0.5, "plain": 0.4, "worn": 0.1}
_CLOSERS: Final = {"none": 0.6, "spring hinge": 0.1, "EN 1154": 0.3}
_LARGEST: Final = 2
"""Greatest power size of a closer that is drawn."""


def standard_door(rng: np.random.Generator) -> DoorConfig:
    """Draw a door of a building: its structure, leaf, handle, latch and closer."""
    width, backset = LEAVES[rng.integers(len(LEAVES))]
    construction = _CONSTRUCTIONS[rng.integers(len(_CONSTRUCTIONS))]
    fields: dict[str, Any] = leaf(
        width, construction, backset=backset, bearing=_choice(_BEARINGS, rng)
    )
    handle = _choice(_HANDLES, rng)
    fields |= {
        "handle": handle,
        "latch": "none" if handle == "bar" else "spring",
        "swing": _choice({"pull": 0.5, "push": 0.5}, rng),
        "hinge_side": _choice({"right": 0.5, "left": 0.5}, rng),
        "handle_height": rng.uniform(0.865, 1.07),
        "hinge_damping": rng.uniform(0.1, 1.0),
        "stiction": rng.uniform(0.0, 4.0),
        "seal": rng.uniform(0.0, 3.0),
        "seal_angle": math.radians(rng.uniform(2.0, 5.0)),
    }
    lockset = {
        "bolt_throw": (0.0127, 0.019)[rng.integers(2)],
        "bolt_preload": rng.uniform(2.5, 8.0),
    }
    if handle == "lever":
        lockset |= {
            "handle_length": rng.uniform(0.105, 0.125),
            "handle_preload": rng.uniform(0.35, 0.70),
            "handle_stiffness": rng.uniform(0.9, 1.4),
            "handle_travel": rng.uniform(0.65, 0.96),
        }
    else:
        lockset |= {
            "handle_preload": rng.uniform(0.10, 0.25),
            "handle_stiffness": rng.uniform(0.1, 0.3),
            "handle_travel": rng.uniform(math.radians(45.0), math.radians(60.0)),
        }
    fields["lockset"] = Lockset(**lockset)
    # There is no closer if the leaf needs a larger one than `_LARGEST`.
    closer = _choice(_CLOSERS, rng)
    sizes = [
        size
        for size, row in EN_1154.items()
        if size <= _LARGEST
        and width <= row.widest
        and fields["panel_mass"] <= row.heaviest
    ]
    if closer == "EN 1154" and sizes:
        least = EN_1154[sizes[0]].efficiency
        fields["closer"] = en1154(sizes[0], rng.uniform(least + 0.1, 0.9))
    elif closer == "spring hinge":
        fields["closer"] = spring_hinge(rng.uniform(3.0, 8.0))
    return DoorConfig(**fields)


def _choice(shares: dict[str, float], rng: np.random.Generator) -> str:
    names = list(shares)
    return names[int(rng.choice(len(names), p=list(shares.values())))]
