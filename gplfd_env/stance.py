"""Where a robot stands before a door, and which doors it reaches from there."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gplfd_env.config import DoorConfig
from gplfd_env.task import Base


@dataclass(frozen=True, kw_only=True, slots=True)
class Stance:
    """Where a robot stands before a closed door, and how its arm holds the handle.

    assets/README.md tells how the two were found.
    """

    handle_xy_w: tuple[float, float]
    """Closed handle in the base frame where the base stands as it should [m]."""

    torso_below_handle: float
    """Height of the grasped point minus torso lift [m]."""

    closed_posture: tuple[float, ...]
    """Arm joints that hold the closed handle, to 1 mrad [rad]; refined at build
    time."""

    roll: float
    """Turn of the wrist about the approach between a bar and a lever or knob, whose
    fingers close from above and below [rad]: the quarter that its range allows."""

    radius: float
    """Greatest handle-to-hinge distance that is opened to the task's angle [m]."""

    height: float
    """Greatest height at which the handle can be held all the way [m]."""


STANCES: Final[Mapping[Base, Stance]] = MappingProxyType(
    {
        "fixed": Stance(
            handle_xy_w=(0.7345, 0.7004),
            torso_below_handle=0.50,
            closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, 0.900),
            roll=-0.5 * math.pi,
            radius=0.65,
            height=0.90,
        ),
        "mobile": Stance(
            handle_xy_w=(0.814, 0.340),
            torso_below_handle=0.78,
            closed_posture=(1.119, 0.225, -1.569, 1.569, -1.352, -0.219, -1.564),
            roll=0.5 * math.pi,
            radius=0.95,
            height=1.22,
        ),
    }
)
"""By base: one that stands still has to reach everything with its arm; one that drives
keeps its arm where it is strong."""


def base_for(door: DoorConfig) -> Base:
    """Return which robot opens a door: one that stands still, or one that has to drive.

    Standing still it opens furniture: bars that are pulled, hinge on the right, as far
    as its arm reaches.
    """
    stance, furniture = STANCES["fixed"], DoorConfig().kind
    within = door.radius <= stance.radius and door.handle_height <= stance.height
    return "fixed" if within and door.kind == furniture else "mobile"


def check_reach(door: DoorConfig, base: Base) -> None:
    """Refuse a door that is out of a robot's reach.

    Raises:
        ValueError: Its handle is too far from the hinge, or too high.
    """
    stance = STANCES[base]
    for name, limit in (("radius", stance.radius), ("handle_height", stance.height)):
        if getattr(door, name) > limit:
            advice = '; give base="mobile"' if base == "fixed" else ""
            raise ValueError(
                f"DoorConfig.{name} = {getattr(door, name)!r} is out of reach with "
                f"base={base!r}, at most {limit:g} m{advice}"
            )
