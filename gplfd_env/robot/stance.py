"""The doors within reach of a robot, and the base that a door needs."""

from typing import Final

from gplfd_env.conventions.constants import Base, Start
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.config import RobotConfig

ABOUT_A_HINGE: Final = ("hinged", "rising-butt", "concealed-hinge")
"""Motions about an upright hinge, or nearly so; a fixed base reaches them."""


def base_for(door: DoorConfig, robot: RobotConfig) -> Base:
    """Return the base that a door needs.

    A fixed base is enough for furniture within reach of the arm: bars that are pulled,
    with the hinge on the right.
    """
    furniture = DoorConfig().kind
    kind = {name: value for name, value in door.kind.items() if name != "motion"}
    if kind != furniture or door.motion not in ABOUT_A_HINGE:
        return "mobile"
    stance = robot.on("fixed").stance(door)
    within = door.radius <= stance.radius and door.handle_height <= stance.height
    return "fixed" if within else "mobile"


def check_reach(door: DoorConfig, robot: RobotConfig, start: Start = "grasped") -> None:
    """Raise a ValueError if a door is beyond the reach of the robot.

    Either the handle is too far from the hinge or too high, or the episode starts in
    front of the handle and the robot stands too near to draw back its arm.
    """
    if (start, robot.base, door.swing) == ("approach", "fixed", "push"):
        raise ValueError(
            'start="approach" is out of reach before a door that is pushed with '
            'base="fixed": the robot stands too near to draw its hand back; give '
            'base="mobile"'
        )
    if robot.base == "fixed" and door.motion not in ABOUT_A_HINGE:
        raise ValueError(
            f"DoorConfig.motion = {door.motion!r} is out of reach with base='fixed': "
            'the arm alone cannot follow the handle; give base="mobile"'
        )
    stance = robot.stance(door)
    for name, limit in (("radius", stance.radius), ("handle_height", stance.height)):
        if getattr(door, name) > limit:
            advice = '; give base="mobile"' if robot.base == "fixed" else ""
            raise ValueError(
                f"DoorConfig.{name} = {getattr(door, name)!r} is out of reach with "
                f"base={robot.base!r}, at most {limit:g} m{advice}"
            )
