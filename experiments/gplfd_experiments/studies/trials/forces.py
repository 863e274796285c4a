"""Trials with demonstrated forces, which protocol v4 added."""

from collections.abc import Mapping
from functools import partial
from typing import Final

from gplfd_experiments.studies.trials.records import (
    BARS,
    MEDIUM,
    OPENED,
    Level,
    Trial,
    contrasts,
)

_LEVERS: Final = (0.65, 0.78, 0.9)
"""Radii of demonstrated levers [m]."""
_CLOSERS: Final[tuple[Mapping[str, Mapping[str, float]], ...]] = (
    {},
    {"closer": {"preload": 18.0, "stiffness": 2.0, "damping": 6.0}},
    {"closer": {"preload": 40.0, "stiffness": 5.0, "damping": 10.0}},
)
"""Closers of these doors: none, and two of DoorBench."""
_CLOSER_RANGES: Final = {
    "radius": (0.66, 0.91),
    "closer_preload": (8.0, 47.0),
    "closer_stiffness": (1.0, 10.0),
    "panel_mass": (20.0, 45.0),
}
"""Closers of the opened doors: other ones of DoorBench."""
_felt = partial(Level, demonstrated_forces=True)
_forces = partial(Trial, claims=("demonstrated forces",))

FORCES: Final[Mapping[str, Trial]] = {
    "forces-weight": _forces(
        question="Forces were demonstrated. Which policy opens doors that are "
        "lighter, or heavier, than all demonstrated ones?",
        measures=OPENED,
        levels={
            "lighter": _felt(
                doors=BARS, demonstrated_hardware=3 * ({"closer": {"preload": 8.0}},)
            ),
            "14 N": _felt(doors=("heavy",)),
            "24 N": _felt(doors=("heavy",), door={"closer": {"preload": 10.0}}),
        },
        contrasts=(
            *contrasts("success", "demonstrated forces"),
            *contrasts("force_handle_peak", "demonstrated forces"),
        ),
    ),
    "forces-closer": _forces(
        question="Forces were demonstrated. Which policy opens levers whose "
        "closers differ from those of the demonstrations?",
        measures=OPENED,
        levels={
            "closers": _felt(
                doors=("room-709", "room-834", "room-959"),
                door={"closer": {"damping": 8.0, "closing_damping": 30.0}},
                randomization=_CLOSER_RANGES,
                demonstrated_radii=_LEVERS,
                demonstrated_hardware=_CLOSERS,
            )
        },
        contrasts=(
            *contrasts("success", "demonstrated forces"),
            *contrasts("force_handle_peak", "demonstrated forces"),
        ),
        extra_policies=("stiffness-from-force",),
    ),
    "forces-person": _forces(
        question="Forces were demonstrated. How large is the force on a person who "
        "holds the hand, or is in the way?",
        measures=("person_force_peak", "success"),
        levels={
            "holds the hand": _felt(doors=MEDIUM, disturbance="person"),
            "in the way": _felt(doors=MEDIUM, disturbance="person-behind"),
            "holds the hand, room": _felt(
                doors=("room-834",),
                disturbance="person",
                demonstrated_radii=_LEVERS,
            ),
        },
        contrasts=contrasts("person_force_peak", "demonstrated forces"),
        extra_policies=("stiffness-from-force",),
    ),
    "forces-blocked": _forces(
        question="Forces were demonstrated. The door is blocked for 2.5 s, or "
        "locked. With how much force does the hand pull?",
        measures=("stop_force_sustained", "grasp_kept"),
        levels={
            "stop": _felt(doors=MEDIUM, disturbance="stop"),
            "locked": _felt(doors=MEDIUM, disturbance="locked"),
        },
        contrasts=contrasts("stop_force_sustained", "demonstrated forces"),
        extra_policies=("stiffness-from-force",),
    ),
    "forces-seal": _forces(
        question="Forces were demonstrated. The hinge sticks at the start and a "
        "seal holds the leaf. Is the door opened?",
        measures=OPENED,
        levels={"breakaway": _felt(doors=MEDIUM, disturbance="breakaway")},
        contrasts=contrasts("force_handle_peak", "demonstrated forces"),
    ),
}
"""Trials by name."""
