"""Where a robot stands before a door, and how its arm holds the closed handle."""

import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Final

from gplfd_env.config import DoorConfig, Swing


@dataclass(frozen=True, kw_only=True, slots=True)
class Stance:
    """A place before a closed door; assets/README.md tells how each was found."""

    handle_xy_w: tuple[float, float]
    """Closed handle in the base frame where the base stands as it should [m]."""

    door_yaw: float
    """Heading of "straight into the closed door" in the base frame [rad], of a door
    with a bar."""

    grasp_yaw: float
    """Constant yaw of the hand on a round bar, counter-clockwise from above [rad]."""

    torso_below_handle: float
    """Height of the grasped point minus torso lift [m]."""

    closed_posture: tuple[float, ...]
    """Arm joints that hold a bar, to 1 mrad [rad]; refined at build time."""

    roll: float
    """Turn of the wrist between a bar and a lever or knob, whose fingers close from
    above and below [rad]: a quarter to one side or the other."""

    def yaws(self, door: DoorConfig) -> tuple[float, float]:
        """Return the heading into a door, and the hand's yaw from it [rad].

        The axis of a lever or knob is the hand's: about another it would turn a wrist
        that is nearly stretched. So the robot stands before such a door turned by what
        is the hand's yaw on a bar.
        """
        if door.handle == "bar":
            return self.door_yaw, self.grasp_yaw
        return self.door_yaw + self.grasp_yaw, 0.0


STANCES: Final[Mapping[Swing, Stance]] = MappingProxyType(
    {
        "pull": Stance(
            handle_xy_w=(0.7345, 0.7004),
            door_yaw=math.radians(26.05),
            grasp_yaw=math.radians(25.4),
            torso_below_handle=0.50,
            closed_posture=(2.183, -0.730, -2.699, 0.803, 0.995, 0.034, 0.900),
            roll=-math.pi / 2,
        ),
        "push": Stance(
            handle_xy_w=(0.593, -0.027),
            door_yaw=math.radians(67.2),
            grasp_yaw=0.0,
            torso_below_handle=0.72,
            closed_posture=(0.200, 0.341, -1.368, 1.925, -0.969, 0.746, -2.019),
            roll=math.pi / 2,
        ),
    }
)
"""By which way the door opens: who pulls begins far off, who pushes begins near."""
