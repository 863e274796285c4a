"""Constants and choices that every part of the environment shares."""

from typing import Final, Literal

Control = Literal["pose", "impedance"]
"""What commands the servo: poses, or poses and stiffnesses."""

Base = Literal["fixed", "mobile"]
"""Whether the robot's base stands still or drives."""

Start = Literal["grasped", "approach"]
"""What an episode begins with: the handle in the hand, or a hand that has yet to reach
it."""

GRIPPER_WIDTH: Final = 0.09
"""Between the fingers of the open gripper [m]."""

CONTROL_PERIOD: Final = 0.01
"""Time between two commands [s]."""
