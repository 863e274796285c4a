"""Trials of protocol v2: doors of furniture under different conditions."""

import dataclasses
import math
from collections.abc import Mapping
from typing import Final

from gplfd_experiments.data.teacher import MESSY
from gplfd_experiments.studies.trials.records import (
    BARS,
    GENTLE,
    MEDIUM,
    OPENED,
    RADIAL,
    SIZES,
    Level,
    Trial,
    compared_levels,
    contrasts,
)

_TO_45: Final = {"angle_mean": math.radians(45.0)}
"""A teacher who opens the door only to 45°."""

FURNITURE: Final[Mapping[str, Trial]] = {
    "radius": Trial(
        question="Which policy opens doors of a radius that was not demonstrated?",
        claims=("via-points", "prediction uncertainty"),
        measures=GENTLE,
        levels={
            "between": Level(doors=("0.42", "0.58")),
            "beyond": Level(
                doors=("0.3", "0.65"), demonstrated_radii=(0.42, 0.5, 0.58)
            ),
        },
        contrasts=contrasts(RADIAL, "via-points", *SIZES),
        tuned=True,
    ),
    "further": Trial(
        question="Demonstrations end at 45°. Which policy opens the door to 60°?",
        claims=("prediction uncertainty", "prior information"),
        measures=("final_angle_deg", "success"),
        levels={
            "nothing else": Level(doors=BARS, teacher=_TO_45),
            "prior mean": Level(doors=BARS, teacher=_TO_45, prior_radius=0.5),
        },
        contrasts=(
            *contrasts(
                "final_angle_deg",
                "progress beyond the demonstrations",
                level="nothing else",
            ),
            compared_levels("prior mean", RADIAL, "prior mean", "nothing else"),
        ),
    ),
    "few": Trial(
        question="Which policy learns from few demonstrations?",
        claims=("prior information",),
        measures=GENTLE,
        levels={
            "one per door": Level(doors=BARS, demonstrations_per_door=1),
            "two of the small door": Level(doors=BARS, demonstrated_radii=(0.35,)),
            "two and a prior mean": Level(
                doors=BARS, demonstrated_radii=(0.35,), prior_radius=0.5
            ),
        },
        contrasts=(
            compared_levels(
                "prior mean",
                RADIAL,
                "two and a prior mean",
                "two of the small door",
            ),
            *contrasts(RADIAL, *SIZES),
        ),
    ),
    "messy": Trial(
        question="Which policy learns from a person who pauses, hurries, moves "
        "back and stops early, and from recordings with gaps and outliers?",
        claims=("alignment", "task variability"),
        measures=GENTLE,
        levels={"messy": Level(doors=BARS, habits=dataclasses.asdict(MESSY))},
        contrasts=contrasts(RADIAL, "task variability"),
        tuned=True,
    ),
    "rests": Trial(
        question="Which policy learns from recordings that begin with up to 2 s of "
        "rest and contain a pause of up to 2 s?",
        claims=("alignment", "rests left out"),
        measures=GENTLE,
        levels={
            "rests": Level(
                doors=BARS,
                habits={"longest_rest": 2.0, "pauses": 1, "longest_pause": 2.0},
            )
        },
    ),
    "turned": Trial(
        question="Which policy opens doors if the robot has a heading error of up "
        "to 5° and grasps the bar off its middle?",
        claims=("path phase", "rotations"),
        measures=("success", "final_angle_deg", RADIAL),
        levels={
            "± 5°": Level(
                doors=BARS,
                randomization={
                    "base_yaw": math.radians(5.0),
                    "grasp_height": 0.04,
                    "grasp_depth": 0.004,
                },
            )
        },
        contrasts=contrasts(RADIAL, "rotations"),
        extra_policies=("gp-fixed",),
        tuned=True,
    ),
    "person": Trial(
        question="A person holds the robot's hand, or has a hand in the way of the "
        "door. How large is the force on the person?",
        claims=("variable stiffness",),
        measures=("person_force_peak", "person_energy", "success", "release_speed"),
        levels={
            "holds the hand": Level(doors=MEDIUM, disturbance="person"),
            "in the way": Level(doors=MEDIUM, disturbance="person-behind"),
        },
        contrasts=contrasts("person_force_peak", "variable stiffness", "learned load"),
        extra_policies=("gp-impedance",),
    ),
    "push": Trial(
        question="The hand is pushed for 0.3 s. How far does it move?",
        claims=("variable stiffness",),
        measures=("push_displacement_mm", "success", "recovery_time"),
        levels={
            title: Level(
                doors=MEDIUM,
                disturbance={"preset": "push", "push": {"start_angle": angles}},
            )
            for title, angles in (
                ("where demonstrations agree", (0.1, 0.25)),
                ("where they differ", (0.75, 0.9)),
            )
        },
        contrasts=contrasts("push_displacement_mm", "variable stiffness"),
        extra_policies=("gp-fixed",),
    ),
    "stop": Trial(
        question="The door is blocked for 2.5 s and then freed. Is it opened?",
        claims=("variable stiffness",),
        measures=("success", "stop_force_sustained", "release_speed"),
        levels={"stop": Level(doors=MEDIUM, disturbance="stop")},
        contrasts=(
            *contrasts("success", "variable stiffness"),
            *contrasts("stop_force_sustained", "variable stiffness", "learned load"),
        ),
        extra_policies=("gp-impedance",),
    ),
    "locked": Trial(
        question="The door is locked. Does the hand keep the handle, and with how "
        "much force?",
        claims=("variable stiffness",),
        measures=("stop_force_sustained", "grasp_kept"),
        levels={"locked": Level(doors=MEDIUM, disturbance="locked")},
        contrasts=contrasts(
            "stop_force_sustained", "variable stiffness", "learned load"
        ),
        extra_policies=("gp-impedance",),
    ),
    "heavy": Trial(
        question="Which policy opens doors that are heavier than all demonstrated "
        "ones?",
        claims=("variable stiffness",),
        measures=("final_angle_deg", "success"),
        levels={
            "14 N": Level(doors=("heavy",)),
            "24 N": Level(doors=("heavy",), door={"closer": {"preload": 10.0}}),
        },
        contrasts=contrasts("final_angle_deg", "variable stiffness", "learned load"),
        extra_policies=("gp-impedance",),
    ),
    "breakaway": Trial(
        question="The hinge sticks at the start and a seal holds the leaf. Is the "
        "door opened?",
        claims=("variable stiffness",),
        measures=("success", "force_handle_peak", "release_speed"),
        levels={"breakaway": Level(doors=MEDIUM, disturbance="breakaway")},
        contrasts=contrasts("force_handle_peak", "variable stiffness"),
    ),
    "delay": Trial(
        question="Commands take effect one to three control periods late. Which "
        "policy stays stable in contact?",
        claims=("contact stability",),
        measures=OPENED,
        levels={
            f"{10 * delay} ms": Level(
                doors=MEDIUM,
                randomization={"shortest_delay": delay, "longest_delay": delay},
            )
            for delay in (1, 2, 3)
        },
        contrasts=contrasts("force_handle_peak", "damping for contact"),
        extra_policies=("gp-impedance", "gp-fixed", "gp-constant-100"),
    ),
    "noise": Trial(
        question="Sensors are one, two and four times as noisy as those of a "
        "careful laboratory. Which policy still opens with a small force?",
        claims=("heteroscedastic noise",),
        measures=GENTLE,
        levels={
            f"× {factor}": Level(
                doors=MEDIUM,
                randomization={
                    # Noise of the sensors of `mild`.
                    "pose_noise": (factor * 0.0005, factor * 0.002),
                    "wrench_noise": (factor * 0.3, factor * 0.02),
                },
            )
            for factor in (1, 2, 4)
        },
        contrasts=contrasts(RADIAL, "heteroscedastic noise"),
        tuned=True,
    ),
}
"""Trials by name."""
