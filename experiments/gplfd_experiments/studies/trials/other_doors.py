"""Trials that protocols v5 and v6 added: other doors, and realistic conditions."""

import math
from collections.abc import Mapping
from functools import partial
from typing import Any, Final

from gplfd_env.doors.config import DOORS
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, ROOM_RADII
from gplfd_experiments.studies.trials.records import (
    OPENED,
    Level,
    Trial,
    compared_levels,
    contrasts,
)

_AMONG: Final = (
    *("gp", "dmp", "promp", "gmr", "kmp", "gmm-gp", "prodmp", "midigap"),
    *("hinge-fit", "mechanism-fit", "oracle"),
)
"""Policies of the trials that protocol v5 added: DMP, ProMP, GMM-GMR, GP, KMP and
GMM-GP of the paper's Table 1, and `prodmp`, `midigap` and `mechanism-fit`, which take
part in no other trial."""
_PUSH_AND_PULL: Final = tuple(
    {"swing": swing} for swing in 3 * ("push",) + 3 * ("pull",)
)
_HINGES: Final = tuple(
    {"swing": "pull", "hinge_side": side} for side in 3 * ("left",) + 3 * ("right",)
)
"""Fields of six demonstrated doors without a label, three of them of another kind."""
_ROOMS: Final = {
    "radius": (0.60, 0.90),
    "panel_mass": (12.0, 40.0),
    "closer_preload": (0.0, 18.0),
    "closer_stiffness": (0.0, 4.0),
}
"""Doors of buildings with leaves and closers that were not demonstrated."""
_FLAPS: Final = {"oven": "oven", "overhead": "overhead-flap"}
"""Flaps as in `motions`, of which `gp` opened 8 of 20 in protocol v5."""
_CLOSERS: Final[Mapping[str, dict[str, Any]]] = {
    "oven": {"closer": {"stiffness": 12.0}},
    "overhead-flap": {},
}
"""Closers of these flaps without their preload, which is drawn."""
_CORRECTIONS: Final[Mapping[str, tuple[int, bool]]] = {
    **{str(number): (number, False) for number in (0, 1, 3, 5)},
    **{f"{number} shown": (number, True) for number in (1, 5)},
}
"""Number of corrections of a level, and whether their time is used to demonstrate."""
_like_opened = partial(Level, demonstrated_radii=None)
"""A level in which doors of the kind of the opened one are demonstrated."""
_added = partial(Trial, measures=OPENED, only_policies=_AMONG)
"""A trial in which the policies `_AMONG` take part."""

OTHER_DOORS: Final[Mapping[str, Trial]] = {
    "motions": _added(
        question="Leaves slide, fold, tilt, or turn about a four-bar. Which policy "
        "opens them, having been shown three other sizes?",
        claims=("learned motion",),
        levels={
            title: _like_opened(doors=doors, randomization=drawn)
            for title, doors, drawn in (
                (
                    "folding",
                    ("bifold-closet",),
                    {"radius": (0.46, 0.68), "hinge_friction": (0.5, 3.0)},
                ),
                (
                    "sliding",
                    ("barn-door", "pocket-door"),
                    {
                        "radius": (0.56, 0.82),
                        "panel_mass": (15.0, 35.0),
                        "hinge_friction": (1.0, 4.0),
                    },
                ),
                (
                    "parallel-sliding",
                    ("plug-door",),
                    {
                        "radius": (0.50, 0.80),
                        "panel_mass": (25.0, 45.0),
                        "hinge_friction": (0.5, 2.5),
                    },
                ),
                (
                    "flap",
                    ("oven", "overhead-flap"),
                    {"radius": (0.32, 0.44), "closer_preload": (3.0, 6.0)},
                ),
                (
                    "concealed hinge",
                    ("kitchen-cupboard",),
                    {"radius": (0.33, 0.60), "hinge_friction": (0.1, 2.0)},
                ),
            )
        },
        contrasts=contrasts("success", "via-points"),
    ),
    "buildings": _added(
        question="Doors of buildings have a latch, and are pulled or pushed. Which "
        "policy opens those whose leaf and closer were not demonstrated?",
        claims=("via-points", "learned load"),
        levels={
            "pulled": _like_opened(doors=("room-834",), randomization=_ROOMS),
            "pushed": _like_opened(
                doors=("room-834",), door={"swing": "push"}, randomization=_ROOMS
            ),
            "knobs": _like_opened(
                doors=("room-709",),
                door={"handle": "knob"},
                randomization={**_ROOMS, "radius": (0.50, 0.80)},
            ),
        },
        contrasts=contrasts("success", "learned load"),
    ),
    "handle-pose": _added(
        question="The robot reaches for a handle whose pose it knows with a "
        "standard deviation of 1 or 2 cm. Is the door opened?",
        claims=("grasp by contact",),
        levels={
            f"{100 * off:g} cm": _like_opened(
                doors=("small", "room-834"),
                start="approach",
                randomization={"perception": (off, math.radians(200.0 * off))},
            )
            for off in (0.01, 0.02)
        },
    ),
    "two-modes": _added(
        question="Doors of two kinds were demonstrated, without a label. Which "
        "policy opens a door of one of them?",
        claims=("several modes",),
        levels={
            "bars": Level(
                doors=("0.6",),
                demonstrations_per_door=1,
                demonstrated_radii=2 * DEMONSTRATED_RADII,
                demonstrated_hardware=_PUSH_AND_PULL,
            ),
            "hinges": Level(
                doors=("0.42",),
                demonstrations_per_door=1,
                demonstrated_radii=2 * DEMONSTRATED_RADII,
                demonstrated_hardware=_HINGES,
            ),
            "levers": Level(
                doors=("room-709", "room-834"),
                demonstrations_per_door=1,
                demonstrated_radii=2 * ROOM_RADII,
                demonstrated_hardware=_PUSH_AND_PULL,
            ),
        },
        contrasts=contrasts("success", "several modes"),
    ),
    "few-doors": _added(
        question="One or three demonstrations are all there is. Which policy "
        "opens a lever or a folding door of another size?",
        claims=("prior information",),
        levels={
            f"{title}, {len(radii)}": Level(
                doors=(door,),
                demonstrations_per_door=1,
                demonstrated_radii=radii,
                demonstrated_hardware=len(radii) * (shape,),
                randomization=drawn,
            )
            for title, door, sizes, shape, drawn in (
                ("lever", "room-834", ROOM_RADII, {}, {"radius": (0.6, 0.9)}),
                (
                    "folding",
                    "bifold-closet",
                    (0.44, 0.54, 0.64),
                    {"leaf": {"backset": 0.16}},
                    {"radius": (0.46, 0.68)},
                ),
            )
            for radii in ((sizes[1],), sizes)
        },
    ),
    "another-handle": _added(
        question="Levers were demonstrated. Which policy opens a door with a knob?",
        claims=("learned motion",),
        levels={
            "knob": Level(
                doors=("room-709",),
                door={"handle": "knob"},
                demonstrated_radii=ROOM_RADII,
                demonstrated_kind={
                    "handle": "lever",
                    "latch": "spring",
                    "swing": "pull",
                    "hinge_side": "right",
                },
            )
        },
    ),
    "corrections": _added(
        question="A policy practises at flaps, and is corrected up to five times. "
        "Which other flaps does it open then?",
        claims=("corrections",),
        levels={
            f"{kind}, {title}": _like_opened(
                doors=("0.33", "0.36", "0.39", "0.42"),
                # Another size and closer of the same shape.
                door={
                    name: value
                    for name, value in DOORS[preset].as_dict().items()
                    if name not in ("radius", "closer")
                }
                | _CLOSERS[preset],
                randomization={"closer_preload": (3.0, 6.0)},
                corrections=number,
                demonstrated=shown,
            )
            for kind, preset in _FLAPS.items()
            for title, (number, shown) in _CORRECTIONS.items()
        },
        contrasts=tuple(
            compared_levels(idea, "success", f"{kind}, {having}", f"{kind}, {lacking}")
            for idea, having, lacking in (
                ("one correction", "1", "0"),
                ("five corrections", "5", "0"),
                ("correction, not demonstration", "1", "1 shown"),
            )
            for kind in _FLAPS
        ),
        only_policies=("gp", "dmp", "promp", "hinge-fit", "mechanism-fit", "oracle"),
    ),
}
"""Trials by name."""
