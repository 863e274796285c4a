"""Handles that turn about a horizontal axis in the leaf, and the axis of every handle.

A *paddle* is a plate on a horizontal pin. It is pushed on one side of a door and pulled
on the other; the robot holds its edge, a horizontal rod. The *touch bar* of an exit
device is pushed towards the leaf. A real pad moves on a straight line; here it moves on
an arc of the same depth. A *handleset* is a fixed grip with a thumb piece above. A
gripper with two fingers cannot press the thumb piece while it holds the grip: it takes
the thumb piece itself between its fingers, presses it down and pulls or pushes the door
by it.
"""

import math
from typing import Final

import numpy as np

from gplfd_env.conventions.constants import Array
from gplfd_env.doors.config import DoorConfig

ROCKERS: Final = ("paddle", "touch-bar", "handleset")
"""Handles with a horizontal axis in the leaf, `DoorConfig.arm` from the hand."""


def handle_axis(door: DoorConfig) -> tuple[Array, Array]:
    """Return the axis about which a handle turns while the door is closed.

    A point of the axis relative to the grasped point [m], (3,), and its direction,
    (3,), both in the door frame. A positive turn retracts the bolt: it presses a lever
    or a thumb piece down, and moves a paddle or a touch bar the way the door opens.
    """
    if door.handle == "handleset":
        # When pulled, it is level at its stop; when pushed, it is level at rest. Thus
        # the force that opens the door does not lift it.
        tilt = door.handle_travel if door.swing_sign > 0.0 else 0.0
        back, below = math.cos(tilt), math.sin(tilt)
        spindle = np.array([-door.handle_arm * back, -door.handle_arm * below, 0.0])
        return spindle, np.array([0.0, 0.0, -1.0])
    if door.handle in ROCKERS:
        return np.array([0.0, door.handle_arm, 0.0]), np.array(
            [0.0, 0.0, door.swing_sign]
        )
    side = door.hinge_sign
    return np.array([0.0, 0.0, side * door.hand_offset]), np.array([-side, 0.0, 0.0])
