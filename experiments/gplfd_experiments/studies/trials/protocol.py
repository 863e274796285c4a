"""Protocol v6: the trials, their policies, and how contrasts are decided.

Frozen under its version: a change of a door, a draw, a demonstration, a measure or a
policy that takes part makes another version. The criteria were settled before the
trials were run.

All that is drawn for a seed is the same for all policies, so policies are compared seed
by seed: a policy's number is its mean over the doors and levels of a seed, and of the
differences of two policies the Hodges-Lehmann estimate is given with its exact 95 %
interval (signed ranks). An idea shows in a contrast if the interval leaves zero out on
the side of the policy that has it. With 20 seeds an effect as large as 0.67 of the
differences' standard deviation is found in 79 of 100 repetitions, one as large as 0.8
in 91 (1,500 simulated each).
"""

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import partial
from types import MappingProxyType
from typing import Final, Literal

from gplfd_env.doors.config import DOORS
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, MESSY, ROOM_RADII
from gplfd_experiments.studies.trials.records import Contrast, Level, Side, Trial
from gplfd_policies.registry.built_in import TABLE_1
from gplfd_policies.registry.tuning_spaces import tuned_settings

VERSION: Final = 6
"""Of the protocol."""

SEEDS: Final = 20
"""Seeds of every trial: 0, 1, ..."""

REFERENCES: Final = ("hinge-fit", "reflex", "chord", "compliant-pull", "oracle")
"""Policies that learn nothing from a demonstration; the line to be measured against."""

EVERYWHERE: Final = (*TABLE_1, "tp-gmm", *REFERENCES)
"""Policies that take part in every trial."""

TUNED: Final = tuple(f"{name}-tuned" for name in tuned_settings())
"""Methods with the settings that `gplfd tune` found, in the whole protocol's trials in
which what is learned decides; the controller, which decides the others, is in no space
that is searched."""

Part = Literal["whole", "ideas", "small"]
"""Of the protocol."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PartPlan:
    """Number of seeds, and the policies of every trial, of a part of the protocol."""

    seeds: int
    everywhere: tuple[str, ...]
    variants: Mapping[str, tuple[str, ...]] = field(default_factory=dict)
    """Variants of `gp` that lack an idea, by trial; a trial that is not listed has all
    of its own."""


PARTS: Final[Mapping[Part, PartPlan]] = MappingProxyType(
    {
        "whole": PartPlan(seeds=SEEDS, everywhere=EVERYWHERE),
        "ideas": PartPlan(seeds=SEEDS, everywhere=("gp", "hinge-fit")),
        "small": PartPlan(
            seeds=6,
            everywhere=("gp", "hinge-fit"),
            variants={
                "radius": ("gp-fixed",),
                "turned": ("gp-clock", "gp-position-only"),
                "person": ("gp-constant-500", "gp-carried-load"),
                "locked": ("gp-constant-330", "gp-carried-load"),
                "heavy": ("gp-constant-100", "gp-carried-load"),
            },
        ),
    }
)
"""The parts by name. The ideas are decided as in the whole. The small part is a first
look at the strongest contrasts of docs/results/trials-v2.json, with the fewest seeds
that give an interval; it decides nothing."""

CONSTANT: Final = tuple(f"gp-constant-{k}" for k in (100, 200, 330, 500))
"""`gp` at constant stiffnesses."""

_ALL: Final = ("small", "medium", "large")
_MEDIUM: Final = ("medium",)
_TO_45: Final = {"angle_mean": math.radians(45.0)}
"""A teacher who opens the door to 45° only."""
_LEVERS: Final = (0.65, 0.78, 0.9)
"""Radii of demonstrated levers [m]."""
_CLOSERS: Final[tuple[Mapping[str, float], ...]] = (
    {},
    {"closer_preload": 18.0, "closer_stiffness": 2.0, "closer_damping": 6.0},
    {"closer_preload": 40.0, "closer_stiffness": 5.0, "closer_damping": 10.0},
)
"""Closers of these: none, and two of those that DoorBench has."""
_CLOSER_RANGES: Final = {
    "radius": (0.66, 0.91),
    "closer_preload": (8.0, 47.0),
    "closer_stiffness": (1.0, 10.0),
    "panel_mass": (20.0, 45.0),
}
"""Of levers that are opened: other closers than those, as DoorBench has them."""
_AMONG: Final = (
    *("gp", "dmp", "promp", "gmr", "kmp", "gmm-gp", "prodmp", "midigap"),
    *("hinge-fit", "mechanism-fit", "oracle"),
)
"""Policies of the trials that protocol v5 added: DMP, ProMP, GMM-GMR, GP, KMP and
GMM-GP of the paper's Table 1, and `prodmp`, `midigap` and `mechanism-fit`, which take
part in no other trial."""
_SEEDS: Final = 10
"""Of these trials. Independent episodes needed to separate two shares of opened doors
(power 0.8, `sequential.seeds_needed`): 24 for 0.9 and 0.4, 84 for 0.85 and 0.6."""
_PUSH_AND_PULL: Final = tuple(
    {"swing": swing} for swing in 3 * ("push",) + 3 * ("pull",)
)
_HINGES: Final = tuple(
    {"swing": "pull", "hinge_side": side} for side in 3 * ("left",) + 3 * ("right",)
)
"""Of six demonstrated doors without a label, of which three are of another kind."""
_ROOMS: Final = {
    "radius": (0.60, 0.90),
    "panel_mass": (12.0, 40.0),
    "closer_preload": (0.0, 18.0),
    "closer_stiffness": (0.0, 4.0),
}
"""Of doors of buildings: leaves and closers that were not demonstrated."""
_FLAPS: Final = {"oven": "oven", "overhead": "overhead-flap"}
"""Flaps as those of `motions`, of which `gp` opened 8 of 20 in protocol v5."""
_CORRECTIONS: Final[Mapping[str, tuple[int, bool]]] = {
    **{str(number): (number, False) for number in (0, 1, 3, 5)},
    **{f"{number} shown": (number, True) for number in (1, 5)},
}
"""Number of corrections of a level, and whether their time is used to demonstrate."""
_LACKING: Final[Mapping[str, tuple[str, ...]]] = {
    "via-points": ("gp-fixed",),
    "shared phase error": ("gp-independent-phase",),
    "size and phase together": ("gp-one-size",),
    "forecast with size": ("gp-process",),
    "progress beyond the demonstrations": ("gp-within-demonstrations",),
    "alignment": ("gp-dtw-euclidean",),
    "task variability": ("gp-homoscedastic",),
    "heteroscedastic noise": ("gp-homoscedastic",),
    "rests left out": ("gp-untrimmed",),
    "path phase": ("gp-clock",),
    "heading as a nuisance": ("gp-heading-trusting",),
    "rotations": ("gp-position-only",),
    "variable stiffness": CONSTANT,
    "stiffness along the path": ("gp-axis-stiffness",),
    "learned load": ("gp-carried-load",),
    "demonstrated forces": ("gp-without-forces",),
    "damping for contact": ("gp-undamped",),
    "several modes": ("gp-one-mode",),
}
"""Variants that lack an idea."""
_SIZES: Final = ("size and phase together", "forecast with size")
_RADIAL: Final = "force_radial_peak"
_GENTLE: Final = (_RADIAL, "success")
"""Measures of a door that is opened with a small force."""
_OPENED: Final = ("success", "force_handle_peak")
_felt = partial(Level, demonstrated_forces=True)
_like_opened = partial(Level, demonstrated_radii=None)
"""A level in which doors of the kind of the opened one are demonstrated."""
_forces = partial(Trial, claims=("demonstrated forces",))
_added = partial(Trial, measures=_OPENED, among=_AMONG, seeds=_SEEDS)
"""A trial in which the policies `_AMONG` take part."""


def _contrasts(measure: str, *ideas: str, level: str = "") -> tuple[Contrast, ...]:
    """Compare `gp` with all variants that lack one of the ideas."""
    return tuple(
        Contrast(
            idea=idea,
            measure=measure,
            # A phase error that is shared is an idea of this form of adaptation.
            having=Side(
                policy="gp-process" if idea == "shared phase error" else "gp",
                level=level,
            ),
            lacking=Side(policy=policy, level=level),
        )
        for idea in ideas
        for policy in _LACKING[idea]
    )


def _levels(idea: str, measure: str, having: str, lacking: str) -> Contrast:
    """Compare two levels of `gp`, of which one has what the idea is about."""
    return Contrast(
        idea=idea,
        measure=measure,
        having=Side(policy="gp", level=having),
        lacking=Side(policy="gp", level=lacking),
    )


TRIALS: Final[Mapping[str, Trial]] = MappingProxyType(
    {
        "radius": Trial(
            question="Which policy opens doors of a radius that was not demonstrated?",
            claims=("via-points", "prediction uncertainty"),
            measures=_GENTLE,
            levels={
                "between": Level(doors=("0.42", "0.58")),
                "beyond": Level(
                    doors=("0.3", "0.65"), demonstrated_radii=(0.42, 0.5, 0.58)
                ),
            },
            contrasts=_contrasts(
                _RADIAL,
                *("via-points", "shared phase error", *_SIZES),
                "stiffness along the path",
            ),
            tuned=True,
        ),
        "further": Trial(
            question="Demonstrations end at 45°. Which policy opens the door to 60°?",
            claims=("prediction uncertainty", "prior information"),
            measures=("final_angle_deg", "success"),
            levels={
                "nothing else": Level(doors=_ALL, teacher=_TO_45),
                "prior mean": Level(doors=_ALL, teacher=_TO_45, prior_radius=0.5),
            },
            contrasts=(
                *_contrasts(
                    "final_angle_deg",
                    "progress beyond the demonstrations",
                    level="nothing else",
                ),
                _levels("prior mean", _RADIAL, "prior mean", "nothing else"),
            ),
        ),
        "few": Trial(
            question="Which policy learns from few demonstrations?",
            claims=("prior information",),
            measures=_GENTLE,
            levels={
                "one per door": Level(doors=_ALL, demonstrations_per_door=1),
                "two of the small door": Level(doors=_ALL, demonstrated_radii=(0.35,)),
                "two and a prior mean": Level(
                    doors=_ALL, demonstrated_radii=(0.35,), prior_radius=0.5
                ),
            },
            contrasts=(
                _levels(
                    "prior mean",
                    _RADIAL,
                    "two and a prior mean",
                    "two of the small door",
                ),
                *_contrasts(_RADIAL, *_SIZES),
            ),
        ),
        "messy": Trial(
            question="Which policy learns from a person who pauses, hurries, moves "
            "back and stops early, and from recordings with gaps and outliers?",
            claims=("alignment", "task variability"),
            measures=_GENTLE,
            levels={"messy": Level(doors=_ALL, habits=dataclasses.asdict(MESSY))},
            contrasts=_contrasts(_RADIAL, "alignment", "task variability"),
            tuned=True,
        ),
        "rests": Trial(
            question="Which policy learns from recordings that begin with up to 2 s of "
            "rest and contain a pause of up to 2 s?",
            claims=("alignment", "rests left out"),
            measures=_GENTLE,
            levels={
                "rests": Level(
                    doors=_ALL,
                    habits={"longest_rest": 2.0, "pauses": 1, "longest_pause": 2.0},
                )
            },
            contrasts=_contrasts(_RADIAL, "rests left out"),
        ),
        "turned": Trial(
            question="Which policy opens doors if the robot has a heading error of up "
            "to 5° and grasps the bar off its middle?",
            claims=("path phase", "rotations"),
            measures=("success", "final_angle_deg", _RADIAL),
            levels={
                "± 5°": Level(
                    doors=_ALL,
                    randomization={
                        "base_yaw": math.radians(5.0),
                        "grasp_height": 0.04,
                        "grasp_depth": 0.004,
                    },
                )
            },
            contrasts=(
                *_contrasts("final_angle_deg", "path phase"),
                *_contrasts(_RADIAL, "heading as a nuisance", "rotations"),
            ),
            also=("gp-fixed",),
            tuned=True,
        ),
        "person": Trial(
            question="A person holds the robot's hand, or has a hand in the way of the "
            "door. How large is the force on the person?",
            claims=("variable stiffness",),
            measures=("person_force_peak", "person_energy", "success", "release_speed"),
            levels={
                "holds the hand": Level(doors=_MEDIUM, disturbance="person"),
                "in the way": Level(doors=_MEDIUM, disturbance="person-behind"),
            },
            contrasts=_contrasts(
                "person_force_peak",
                *("variable stiffness", "stiffness along the path", "learned load"),
            ),
            also=("gp-impedance",),
        ),
        "push": Trial(
            question="The hand is pushed for 0.3 s. How far does it move?",
            claims=("variable stiffness",),
            measures=("push_displacement_mm", "success", "recovery_time"),
            levels={
                title: Level(
                    doors=_MEDIUM,
                    disturbance={"preset": "push", "push": {"start_angle": angles}},
                )
                for title, angles in (
                    ("where demonstrations agree", (0.1, 0.25)),
                    ("where they differ", (0.75, 0.9)),
                )
            },
            contrasts=_contrasts("push_displacement_mm", "variable stiffness"),
            also=("gp-fixed",),
        ),
        "stop": Trial(
            question="The door is blocked for 2.5 s and then freed. Is it opened?",
            claims=("variable stiffness",),
            measures=("success", "stop_force_sustained", "release_speed"),
            levels={"stop": Level(doors=_MEDIUM, disturbance="stop")},
            contrasts=(
                *_contrasts("success", "variable stiffness"),
                *_contrasts(
                    "stop_force_sustained", "variable stiffness", "learned load"
                ),
            ),
            also=("gp-impedance",),
        ),
        "locked": Trial(
            question="The door is locked. Does the hand keep the handle, and with how "
            "much force?",
            claims=("variable stiffness",),
            measures=("stop_force_sustained", "grasp_kept"),
            levels={"locked": Level(doors=_MEDIUM, disturbance="locked")},
            contrasts=_contrasts(
                "stop_force_sustained", "variable stiffness", "learned load"
            ),
            also=("gp-impedance",),
        ),
        "heavy": Trial(
            question="Which policy opens doors that are heavier than all demonstrated "
            "ones?",
            claims=("variable stiffness",),
            measures=("final_angle_deg", "success"),
            levels={
                "14 N": Level(doors=("heavy",)),
                "24 N": Level(doors=("heavy",), door={"closer_preload": 10.0}),
            },
            contrasts=_contrasts(
                "final_angle_deg", "variable stiffness", "learned load"
            ),
            also=("gp-impedance",),
        ),
        "breakaway": Trial(
            question="The hinge sticks at the start and a seal holds the leaf. Is the "
            "door opened?",
            claims=("variable stiffness",),
            measures=("success", "release_speed", "force_handle_peak"),
            levels={"breakaway": Level(doors=_MEDIUM, disturbance="breakaway")},
            contrasts=_contrasts("force_handle_peak", "variable stiffness"),
        ),
        "delay": Trial(
            question="Commands take effect one to three control periods late. Which "
            "policy stays stable in contact?",
            claims=("contact stability",),
            measures=_OPENED,
            levels={
                f"{10 * delay} ms": Level(
                    doors=_MEDIUM,
                    randomization={"shortest_delay": delay, "longest_delay": delay},
                )
                for delay in (1, 2, 3)
            },
            contrasts=_contrasts("force_handle_peak", "damping for contact"),
            also=("gp-impedance", "gp-fixed", "gp-constant-100"),
        ),
        "noise": Trial(
            question="Sensors are one, two and four times as noisy as those of a "
            "careful laboratory. Which policy still opens with a small force?",
            claims=("heteroscedastic noise",),
            measures=_GENTLE,
            levels={
                f"× {factor}": Level(
                    doors=_MEDIUM,
                    randomization={
                        # Those of `mild` sensors.
                        "pose_noise": (factor * 0.0005, factor * 0.002),
                        "wrench_noise": (factor * 0.3, factor * 0.02),
                    },
                )
                for factor in (1, 2, 4)
            },
            contrasts=_contrasts(_RADIAL, "heteroscedastic noise"),
            tuned=True,
        ),
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
            contrasts=_contrasts("success", "via-points"),
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
            contrasts=_contrasts("success", "learned load"),
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
            contrasts=_contrasts("success", "several modes"),
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
                        {"backset": 0.16},
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
                        if name not in ("radius", "closer_preload")
                    },
                    randomization={"closer_preload": (3.0, 6.0)},
                    corrections=number,
                    demonstrated=shown,
                )
                for kind, preset in _FLAPS.items()
                for title, (number, shown) in _CORRECTIONS.items()
            },
            contrasts=tuple(
                _levels(idea, "success", f"{kind}, {having}", f"{kind}, {lacking}")
                for idea, having, lacking in (
                    ("one correction", "1", "0"),
                    ("five corrections", "5", "0"),
                    ("correction, not demonstration", "1", "1 shown"),
                )
                for kind in _FLAPS
            ),
            among=("gp", "dmp", "promp", "hinge-fit", "mechanism-fit", "oracle"),
        ),
        "forces-weight": _forces(
            question="Forces were demonstrated. Which policy opens doors that are "
            "lighter, or heavier, than all demonstrated ones?",
            measures=_OPENED,
            levels={
                "lighter": _felt(
                    doors=_ALL, demonstrated_hardware=3 * ({"closer_preload": 8.0},)
                ),
                "14 N": _felt(doors=("heavy",)),
                "24 N": _felt(doors=("heavy",), door={"closer_preload": 10.0}),
            },
            contrasts=(
                *_contrasts("success", "demonstrated forces"),
                *_contrasts("force_handle_peak", "demonstrated forces"),
            ),
        ),
        "forces-closer": _forces(
            question="Forces were demonstrated. Which policy opens levers whose "
            "closers differ from those of the demonstrations?",
            measures=_OPENED,
            levels={
                "closers": _felt(
                    doors=("room-709", "room-834", "room-959"),
                    door={"closer_damping": 8.0, "closing_damping": 30.0},
                    randomization=_CLOSER_RANGES,
                    demonstrated_radii=_LEVERS,
                    demonstrated_hardware=_CLOSERS,
                )
            },
            contrasts=(
                *_contrasts("success", "demonstrated forces"),
                *_contrasts("force_handle_peak", "demonstrated forces"),
            ),
            also=("stiffness-from-force",),
        ),
        "forces-person": _forces(
            question="Forces were demonstrated. How large is the force on a person who "
            "holds the hand, or is in the way?",
            measures=("person_force_peak", "success"),
            levels={
                "holds the hand": _felt(doors=_MEDIUM, disturbance="person"),
                "in the way": _felt(doors=_MEDIUM, disturbance="person-behind"),
                "holds the hand, room": _felt(
                    doors=("room-834",),
                    disturbance="person",
                    demonstrated_radii=_LEVERS,
                ),
            },
            contrasts=_contrasts("person_force_peak", "demonstrated forces"),
            also=("stiffness-from-force",),
        ),
        "forces-blocked": _forces(
            question="Forces were demonstrated. The door is blocked for 2.5 s, or "
            "locked. With how much force does the hand pull?",
            measures=("stop_force_sustained", "grasp_kept"),
            levels={
                "stop": _felt(doors=_MEDIUM, disturbance="stop"),
                "locked": _felt(doors=_MEDIUM, disturbance="locked"),
            },
            contrasts=_contrasts("stop_force_sustained", "demonstrated forces"),
            also=("stiffness-from-force",),
        ),
        "forces-seal": _forces(
            question="Forces were demonstrated. The hinge sticks at the start and a "
            "seal holds the leaf. Is the door opened?",
            measures=_OPENED,
            levels={"breakaway": _felt(doors=_MEDIUM, disturbance="breakaway")},
            contrasts=_contrasts("force_handle_peak", "demonstrated forces"),
        ),
    }
)
"""Every trial by its name."""
