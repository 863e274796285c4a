"""The TIAGo-like robot: its stances, and configuration that its URDF lacks."""

import itertools
import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Final, get_args

from gplfd_env.doors.config import Handle, HingeSide, Swing
from gplfd_env.robot.config import (
    BASE_RADIUS,
    HELD,
    Capsule,
    RobotConfig,
    Stance,
    StanceGroup,
)


def stance_of(
    handle_xy_w: tuple[float, float],
    door_yaw: float,
    grasp_yaw: float,
    quarters: int,
    below_handle: float,
    radius: float,
    *closed_posture: float,
    height: float = 1.22,
) -> Stance:
    """Return a stance with a roll of the wrist in quarter turns."""
    return Stance(
        handle_xy_w=handle_xy_w,
        door_yaw=door_yaw,
        grasp_yaw=grasp_yaw,
        roll=quarters * math.pi / 2,
        below_handle=below_handle,
        closed_posture=closed_posture,
        radius=radius,
        height=height,
    )


def stances_of(
    fixed: Mapping[tuple[Swing, bool], Stance], driving: tuple[Stance, Stance, Stance]
) -> tuple[tuple[StanceGroup, Stance], ...]:
    """Return the stances for all doors.

    Args:
        fixed: stances on a fixed base, by swing and whether a bar is held.
        driving: stances on a mobile base: at a bar with the hinge on the right, on the
            left, and at other handles.
    """
    bar_right, bar_left, turned = driving
    stances = []
    sides: tuple[HingeSide, ...] = ("right", "left")
    for swing, held, side in itertools.product(get_args(Swing), HELD, sides):
        bar = held == "bar"
        stance = (bar_right if side == "right" else bar_left) if bar else turned
        stances.append((StanceGroup("mobile", swing, held, side), stance))
        stances.append((StanceGroup("fixed", swing, held, side), fixed[swing, bar]))
    return tuple(stances)


_RIGHT, _LEFT, _YAW = math.radians(26.05), math.radians(51.45), math.radians(25.4)
_AHEAD: Final = math.radians(67.2)

_DRIVING: Final = stance_of(
    (0.814, 0.340), _RIGHT, _YAW, 0, 0.78, 1.05,
    1.119, 0.225, -1.569, 1.569, -1.352, -0.219, -1.564,
)  # fmt: skip
"""Stance of a mobile base: the arm is in a posture in which it is strong."""

_DRIVING_TURNED: Final = stance_of(
    (0.742, 0.602), 0.692, 0.0, 1, 0.86, 1.05,
    1.789, 0.634, -1.197, 1.295, -1.015, -0.662, 0.200,
)  # fmt: skip

_DRIVING_LEFT: Final = stance_of(
    (0.814, 0.340), _LEFT, 0.0, 1, 0.78, 1.0,
    1.119, 0.225, -1.569, 1.569, -1.352, -0.219, 0.006,
)  # fmt: skip
"""Stance to the left of the handle, where the passage of a left-hinged door is free."""

_FIXED: Final[Mapping[tuple[Swing, bool], Stance]] = {
    ("pull", True): stance_of(
        (0.7345, 0.7004), _RIGHT, _YAW, 0, 0.50, 0.65,
        2.183, -0.730, -2.699, 0.803, 0.995, 0.034, 0.900, height=0.90,
    ),
    ("push", True): stance_of(
        (0.593, -0.027), _AHEAD, 0.0, 0, 0.72, 0.65,
        0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -2.019, height=1.07,
    ),
    ("pull", False): stance_of(
        (0.7345, 0.7004), _LEFT, 0.0, -1, 0.50, 0.91,
        2.183, -0.730, -2.699, 0.803, 0.995, 0.034, -0.671, height=1.07,
    ),
    ("push", False): stance_of(
        (0.593, -0.027), _AHEAD, 0.0, 1, 0.72, 0.91,
        0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -0.448, height=1.07,
    ),
}  # fmt: skip
"""By swing and whether a bar is held. With a fixed base the arm has to reach the whole
motion: the robot stands far from a door that it pulls and near to one that it pushes.
With a lever or knob it reaches less of doors that are pulled with the hinge on the
left, or pushed with the hinge on the right (docs/environment.md)."""

_PUSHING_LEFT: Final[Mapping[Handle, Stance]] = {
    # With a yaw on the bar the palm would hit the jamb beside the lock; without a yaw
    # it passes through the frame.
    "bar": replace(_DRIVING_LEFT, roll=0.0, closed_posture=_DRIVING.closed_posture),
    "lever": replace(_DRIVING_LEFT, radius=1.05),
    **dict.fromkeys(("knob", "paddle", "touch-bar", "handleset"), _DRIVING_LEFT),
}
"""Before doors that are pushed with the hinge on the left, with a base that drives.
Farther from the hinge the base hits the leaf; on a lever the hand is nearer to the
hinge."""


_STANCES: Final = dict(stances_of(_FIXED, (_DRIVING, _DRIVING, _DRIVING_TURNED))) | {
    StanceGroup("mobile", "push", handle, "left"): stance
    for handle, stance in _PUSHING_LEFT.items()
}

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
    stances=tuple(_STANCES.items()),
)
