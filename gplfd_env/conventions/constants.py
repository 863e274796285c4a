"""Constants, choices and types that every part of the environment shares."""

import math
from typing import Any, Final, Literal

import numpy as np
from numpy.typing import NDArray

Array = NDArray[np.float64]
Mask = NDArray[np.bool_]
Info = dict[str, Any]
Vector = tuple[float, float, float]

Control = Literal["pose", "impedance"]
"""What an action commands: poses, or poses and stiffnesses."""
ActionForm = Literal["pose", "relative", "stiffness"]
"""Actions at waypoints: position [m] and quaternion (x, y, z, w), (7,); relative to the
hand as in `RelativeAction`, (6,); or pose and stiffness [N/m, N m/rad], (13,)."""
TASK: Final = "open the door"
"""What a policy that reads is told."""
Base = Literal["fixed", "mobile"]
"""Whether the robot's base stands still or drives."""
Start = Literal["grasped", "approach"]
"""Start of an episode: the hand holds the handle, or has yet to reach it."""
GRIPPER_WIDTH: Final = 0.09
"""Distance between the fingers of the open gripper [m]."""
CONTROL_PERIOD: Final = 0.01
"""Time between two commands [s]."""
SUCCESS_ANGLE: Final = math.radians(60.0)
"""Opening angle that counts as success [rad]; for a leaf that does not turn about a
hinge, see `gplfd_env.doors.motion`."""
INTANGIBLE: Final[dict[str, Any]] = {"contype": 0, "conaffinity": 0}
"""Attributes of a geom that touches nothing."""

_STIFF: Final = [0.999, 0.999, 0.001, 0.5, 2.0]
DRY_FRICTION: Final = {"solref_friction": [0.004, 1.0], "solimp_friction": _STIFF}
"""Stiff Coulomb friction: MuJoCo's soft default lets things creep below it."""

UNDRAWN: Final[dict[str, Any]] = {"size": [0.005] * 3, "rgba": [0, 0, 0, 0]}
"""Attributes of a site that only marks a frame."""
