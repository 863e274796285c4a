"""Poses of the robot in front of a door, and the doors within reach from there."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from types import MappingProxyType
from typing import Final

from gplfd_env.conventions.constants import Base, Start
from gplfd_env.doors.config import DoorConfig, Handle, Swing


@dataclass(frozen=True, kw_only=True, slots=True)
class Stance:
    """Pose of the robot in front of a closed door; assets/README.md tells how found."""

    handle_xy_w: tuple[float, float]
    """Closed handle in the base frame, without placement error [m]."""
    door_yaw: float
    """Heading of "straight into the closed door" in the base frame [rad]."""
    grasp_yaw: float
    """Constant yaw of the hand on the handle, counter-clockwise from above [rad]. It is
    zero for a lever or knob, whose axis is the hand's: there it would turn a wrist
    that is nearly at its limit."""
    torso_below_handle: float
    """Height of the grasped point minus torso lift [m]."""
    closed_posture: tuple[float, ...]
    """Arm joints that hold the closed handle, to 1 mrad [rad]; refined at build
    time."""
    roll: float = 0.0
    """Roll of the wrist relative to the grasp of a vertical bar [rad]: a quarter turn
    for a lever or knob, which the fingers grasp from above and below."""
    radius: float
    """Greatest handle-to-hinge distance that is opened to the task's angle [m]."""
    height: float
    """Greatest height at which the handle can be held all the way [m]."""


_AT_BAR: Final = (1.119, 0.225, -1.569, 1.569, -1.352, -0.219, -1.564)

_DRIVING: Final = Stance(
    handle_xy_w=(0.814, 0.340),
    door_yaw=math.radians(26.05),
    grasp_yaw=math.radians(25.4),
    torso_below_handle=0.78,
    closed_posture=_AT_BAR,
    radius=1.05,
    height=1.22,
)
"""A mobile base keeps the arm in a posture in which it is strong."""

_DRIVING_TURNED: Final = Stance(
    handle_xy_w=(0.742, 0.602),
    door_yaw=0.692,
    grasp_yaw=0.0,
    torso_below_handle=0.86,
    closed_posture=(1.789, 0.634, -1.197, 1.295, -1.015, -0.662, 0.200),
    roll=math.pi / 2,
    radius=1.05,
    height=1.22,
)

_DRIVING_LEFT: Final = Stance(
    handle_xy_w=(0.814, 0.340),
    door_yaw=math.radians(51.45),
    grasp_yaw=0.0,
    torso_below_handle=0.78,
    closed_posture=(1.119, 0.225, -1.569, 1.569, -1.352, -0.219, 0.006),
    roll=math.pi / 2,
    radius=1.0,
    height=1.22,
)
"""To the left of the handle, where the passage of a left-hinged door is free."""

_DRIVING_LEFT_BAR: Final = replace(_DRIVING_LEFT, roll=0.0, closed_posture=_AT_BAR)
"""The same for a bar. With a yaw on the bar the palm would meet the jamb beside the
lock; without one it goes through the frame."""

BAR_STANCES: Final[Mapping[tuple[Base, Swing], Stance]] = MappingProxyType(
    {
        ("fixed", "pull"): Stance(
            handle_xy_w=(0.7345, 0.7004),
            door_yaw=math.radians(26.05),
            grasp_yaw=math.radians(25.4),
            torso_below_handle=0.50,
            closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, 0.900),
            radius=0.65,
            height=0.90,
        ),
        ("fixed", "push"): Stance(
            handle_xy_w=(0.593, -0.027),
            door_yaw=math.radians(67.2),
            grasp_yaw=0.0,
            torso_below_handle=0.72,
            closed_posture=(0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -2.019),
            radius=0.65,
            height=1.07,
        ),
        ("mobile", "pull"): _DRIVING,
        ("mobile", "push"): _DRIVING,
    }
)
"""By base and swing. With a fixed base the arm has to reach the whole motion: the robot
stands far from a door that it pulls and near to one that it pushes."""

TURNED_STANCES: Final[Mapping[tuple[Base, Swing], Stance]] = MappingProxyType(
    {
        ("fixed", "pull"): Stance(
            handle_xy_w=(0.7345, 0.7004),
            door_yaw=math.radians(51.45),
            grasp_yaw=0.0,
            torso_below_handle=0.50,
            closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, -0.671),
            roll=-math.pi / 2,
            radius=0.91,
            height=1.07,
        ),
        ("fixed", "push"): Stance(
            handle_xy_w=(0.593, -0.027),
            door_yaw=math.radians(67.2),
            grasp_yaw=0.0,
            torso_below_handle=0.72,
            closed_posture=(0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -0.448),
            roll=math.pi / 2,
            radius=0.91,
            height=1.07,
        ),
        ("mobile", "pull"): _DRIVING_TURNED,
        ("mobile", "push"): _DRIVING_TURNED,
    }
)
"""The same for a lever or knob. With a fixed base the arm reaches the whole motion of
doors that are pulled with the hinge on the right, or pushed with the hinge on the left;
on the other side it reaches less (docs/environment.md)."""


ABOUT_A_HINGE: Final = ("hinged", "rising-butt", "concealed-hinge")
"""Motions about an upright hinge, or nearly so; a fixed base reaches them."""
_PUSHING_LEFT: Final[Mapping[Handle, Stance]] = MappingProxyType(
    {
        "bar": _DRIVING_LEFT_BAR,
        "lever": replace(_DRIVING_LEFT, radius=1.05),
        "knob": _DRIVING_LEFT,
        "paddle": _DRIVING_LEFT,
        "touch-bar": _DRIVING_LEFT,
        "handleset": _DRIVING_LEFT,
    }
)
"""Before doors that are pushed with the hinge on the left, with a base that drives.
Farther from the hinge the base meets the leaf; the hand on a lever is nearer to it."""


def stance_of(door: DoorConfig, base: Base) -> Stance:
    """Return the stance of the robot in front of a door."""
    if (base, door.swing, door.hinge_side) == ("mobile", "push", "left"):
        return _PUSHING_LEFT[door.handle]
    if door.handle == "bar" and door.motion != "flap":
        return BAR_STANCES[base, door.swing]
    return TURNED_STANCES[base, door.swing]


def base_for(door: DoorConfig) -> Base:
    """Return the base that a door needs.

    A fixed base opens furniture within reach of the arm: bars that are pulled, with the
    hinge on the right.
    """
    stance, furniture = stance_of(door, "fixed"), DoorConfig().kind
    within = door.radius <= stance.radius and door.handle_height <= stance.height
    kind = {name: own for name, own in door.kind.items() if name != "motion"}
    turns = door.motion in ABOUT_A_HINGE
    return "fixed" if within and turns and kind == furniture else "mobile"


def check_reach(door: DoorConfig, base: Base, start: Start = "grasped") -> None:
    """Raise a ValueError if a door is beyond the reach of the robot.

    The handle is too far from the hinge or too high, or the episode starts in front of
    a handle at which the robot stands too near to draw back its arm.
    """
    if (start, base, door.swing) == ("approach", "fixed", "push"):
        raise ValueError(
            'start="approach" is out of reach before a door that is pushed with '
            'base="fixed": the robot stands too near to draw its hand back; give '
            'base="mobile"'
        )
    if base == "fixed" and door.motion not in ABOUT_A_HINGE:
        raise ValueError(
            f"DoorConfig.motion = {door.motion!r} is out of reach with base='fixed': "
            'the arm alone cannot follow the handle; give base="mobile"'
        )
    stance = stance_of(door, base)
    for name, limit in (("radius", stance.radius), ("handle_height", stance.height)):
        if getattr(door, name) > limit:
            advice = '; give base="mobile"' if base == "fixed" else ""
            raise ValueError(
                f"DoorConfig.{name} = {getattr(door, name)!r} is out of reach with "
                f"base={base!r}, at most {limit:g} m{advice}"
            )
