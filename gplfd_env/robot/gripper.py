"""When the fingers open and close, in episodes in which they do."""

import math
from typing import Final

from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH, Start
from gplfd_env.doors.config import DoorConfig, held_radius
from gplfd_env.robot.model import Grasp, Hold

SPEED: Final = 0.1
"""At which the commanded width changes: 0.05 m/s per finger, as TIAGo's [m/s]."""

AT_HANDLE: Final = (0.01, 0.1)
"""A gripper that nobody commands closes where the hand is this near to the pose that
holds the closed handle [m, rad]."""


def hold_of(grasp: Grasp, start: Start, *, commanded: bool) -> Hold:
    """Return how a scene holds the handle.

    Args:
        grasp: What the caller asks for.
        start: What episodes begin with.
        commanded: Whether actions command the gripper.

    Raises:
        ValueError: A rigid joint in the place of a gripper that opens and closes.
    """
    if start == "grasped" and not commanded:
        return grasp
    if grasp == "weld":
        cause = "with a commanded gripper" if commanded else 'with start="approach"'
        raise ValueError(
            f'grasp="weld" does not go {cause}: the joint would hold the handle '
            'without the fingers; leave it at grasp="contact"'
        )
    return "gripper"


class Gripper:
    """What the fingers are told in an episode.

    Args:
        door: Whose handle they are to hold.
        width: Told at the beginning [m].

    Attributes:
        width: What they are told now, after the limit of their speed [m].
    """

    def __init__(self, door: DoorConfig, width: float) -> None:
        self._thickness = 2.0 * held_radius(door.handle)
        self.width = width

    @property
    def opened(self) -> bool:
        """Whether they are told to be farther apart than the handle is thick."""
        return self.width > self._thickness

    def obey(self, width: float) -> None:
        """Go on towards a commanded width [m], clamped to [0, `GRIPPER_WIDTH`]."""
        step = SPEED * CONTROL_PERIOD
        change = min(max(width, 0.0), GRIPPER_WIDTH) - self.width
        self.width += min(max(change, -step), step)

    def close_at_handle(self, hand: list[float], *, taken: bool) -> None:
        """Close if the hand is at the handle or has taken it, else open.

        Args:
            hand: Its pose, task frame, (6,) [m, rad].
            taken: Whether it has taken hold of the handle and not let it go.
        """
        near = math.hypot(*hand[:3]) <= AT_HANDLE[0]
        aligned = math.hypot(*hand[3:]) <= AT_HANDLE[1]
        self.obey(0.0 if taken or (near and aligned) else GRIPPER_WIDTH)
