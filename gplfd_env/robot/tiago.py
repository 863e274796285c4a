"""The TIAGo-like robot: its stances, and configuration that its URDF lacks."""

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final

from gplfd_env.conventions.constants import Base
from gplfd_env.doors.config import Handle, Swing
from gplfd_env.robot.config import (
    BASE_RADIUS,
    HELD,
    Capsule,
    RobotConfig,
    Stance,
    StanceGroup,
)

_AT_BAR: Final = (1.119, 0.225, -1.569, 1.569, -1.352, -0.219, -1.564)

_DRIVING: Final = Stance(
    handle_xy_w=(0.814, 0.340),
    door_yaw=math.radians(26.05),
    grasp_yaw=math.radians(25.4),
    below_handle=0.78,
    closed_posture=_AT_BAR,
    radius=1.05,
    height=1.22,
)
"""Stance of a mobile base: the arm is in a posture in which it is strong."""

_DRIVING_TURNED: Final = Stance(
    handle_xy_w=(0.742, 0.602),
    door_yaw=0.692,
    below_handle=0.86,
    closed_posture=(1.789, 0.634, -1.197, 1.295, -1.015, -0.662, 0.200),
    roll=math.pi / 2,
    radius=1.05,
    height=1.22,
)

_DRIVING_LEFT: Final = Stance(
    handle_xy_w=(0.814, 0.340),
    door_yaw=math.radians(51.45),
    below_handle=0.78,
    closed_posture=(1.119, 0.225, -1.569, 1.569, -1.352, -0.219, 0.006),
    roll=math.pi / 2,
    radius=1.0,
    height=1.22,
)
"""Stance to the left of the handle, where the passage of a left-hinged door is free."""

_DRIVING_LEFT_BAR: Final = replace(_DRIVING_LEFT, roll=0.0, closed_posture=_AT_BAR)
"""The same for a bar. With a yaw on the bar the palm would hit the jamb beside the
lock; without a yaw it passes through the frame."""

_BAR: Final[Mapping[tuple[Base, Swing], Stance]] = {
    ("fixed", "pull"): Stance(
        handle_xy_w=(0.7345, 0.7004),
        door_yaw=math.radians(26.05),
        grasp_yaw=math.radians(25.4),
        below_handle=0.50,
        closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, 0.900),
        radius=0.65,
        height=0.90,
    ),
    ("fixed", "push"): Stance(
        handle_xy_w=(0.593, -0.027),
        door_yaw=math.radians(67.2),
        below_handle=0.72,
        closed_posture=(0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -2.019),
        radius=0.65,
        height=1.07,
    ),
    ("mobile", "pull"): _DRIVING,
    ("mobile", "push"): _DRIVING,
}
"""By base and swing. With a fixed base the arm has to reach the whole motion: the robot
stands far from a door that it pulls and near to one that it pushes."""

_TURNED: Final[Mapping[tuple[Base, Swing], Stance]] = {
    ("fixed", "pull"): Stance(
        handle_xy_w=(0.7345, 0.7004),
        door_yaw=math.radians(51.45),
        below_handle=0.50,
        closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, -0.671),
        roll=-math.pi / 2,
        radius=0.91,
        height=1.07,
    ),
    ("fixed", "push"): Stance(
        handle_xy_w=(0.593, -0.027),
        door_yaw=math.radians(67.2),
        below_handle=0.72,
        closed_posture=(0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -0.448),
        roll=math.pi / 2,
        radius=0.91,
        height=1.07,
    ),
    ("mobile", "pull"): _DRIVING_TURNED,
    ("mobile", "push"): _DRIVING_TURNED,
}
"""The same for a lever or knob. With a fixed base the arm reaches the whole motion of
doors that are pulled with the hinge on the right, or pushed with the hinge on the left;
on the other side it reaches less (docs/environment.md)."""


_PUSHING_LEFT: Final[Mapping[Handle, Stance]] = {
    "bar": _DRIVING_LEFT_BAR,
    "lever": replace(_DRIVING_LEFT, radius=1.05),
    "knob": _DRIVING_LEFT,
    "paddle": _DRIVING_LEFT,
    "touch-bar": _DRIVING_LEFT,
    "handleset": _DRIVING_LEFT,
}
"""Before doors that are pushed with the hinge on the left, with a base that drives.
Farther from the hinge the base hits the leaf; on a lever the hand is nearer to the
hinge."""


def _stances() -> dict[StanceGroup, Stance]:
    """Return the stances for all doors."""
    found: dict[StanceGroup, Stance] = {}
    for (base, swing), bar in _BAR.items():
        for held in HELD:
            stance = bar if held == "bar" else _TURNED[base, swing]
            found[StanceGroup(base, swing, held, "right")] = stance
            found[StanceGroup(base, swing, held, "left")] = stance
    for handle, stance in _PUSHING_LEFT.items():
        found[StanceGroup("mobile", "push", handle, "left")] = stance
    return found


TIAGO_LIKE: Final = RobotConfig(
    name="tiago-like",
    urdf="tiago_like.urdf",
    arm=tuple(f"arm_{i}_joint" for i in range(1, 8)),
    tool="gripper_link",
    grasp_point=(0.0, 0.0, -0.185),
    approach=(0.0, 0.0, -1.0),
    stand=False,
    armature=(0.3, 0.3, 0.15, 0.15, 0.05, 0.05, 0.05),
    root="base_footprint",
    lift="torso_lift_joint",
    sensor="wrist_ft_link",
    # Half a turn about x at all joint angles.
    sensor_rotation=((0.0, -1.0, 0.0), (-1.0, 0.0, 0.0), (0.0, 0.0, -1.0)),
    forearm="arm_4_link",
    head=("head_link", (0.10, 0.0, 0.05)),
    hand_camera=((0.0, -0.12, -0.01), (-1.0, 0.0, 0.0), (0.0, -0.83, -0.56)),
    capsules=(
        Capsule("base_body", "base_link", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule(
            "column_body", "torso_fixed_link", (-0.03, 0, 0.15, -0.03, 0, 0.5), 0.16
        ),
        Capsule(
            "chest_body", "torso_lift_link", (0.03, 0, -0.15, 0.03, 0, -0.05), 0.16
        ),
        Capsule("head_body", "head_link", (0, 0, 0, 0, 0, 0.05), 0.12),
        Capsule(
            "shoulder_body",
            "arm_1_link",
            (0, 0, -0.03, 0.125, 0.0195, -0.031),
            0.06,
        ),
        Capsule("upper_arm_body", "arm_3_link", (0, 0, 0, -0.01, -0.013, -0.21), 0.055),
        Capsule("elbow_body", "arm_4_link", (0, 0, 0.005, -0.162, 0.02, 0.027), 0.05),
        Capsule("forearm_body", "arm_5_link", (0, 0, 0, 0, 0, 0.15), 0.045),
        Capsule("palm_body", "gripper_link", (0, 0, 0.04, 0, 0, -0.06), 0.045),
    ),
    stances=tuple(_stances().items()),
)
