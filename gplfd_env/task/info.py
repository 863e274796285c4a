"""What an info says, by name and place, and two quantities of it."""

import math
from typing import Final

from gplfd_env.simulation.loads import Vector
from gplfd_env.task.observation import DoorReading

NUMBERS: Final = (
    "door_angle",
    "door_velocity",
    "door_radius",
    "slip",
    "force_tangential",
    "force_radial",
    "force_vertical",
    "push_force",
    "person_force",
    "person_energy",
    "base_shift",
    "stop_force",
    "handle_angle",
    "bolt",
    "closer_torque",
    "capability",
)
"""Numbers of an info, in the order of `gplfd_env.task.episode.Episode.row`."""

POSE: Final = slice(len(NUMBERS), len(NUMBERS) + 6)
"""Where in a row the handle's pose is."""

BASE_POSE: Final = slice(POSE.stop, POSE.stop + 3)
BASE_RATE: Final = slice(BASE_POSE.stop, BASE_POSE.stop + 3)
"""Where in a row pose and rate of the base are."""

TEXTS: Final = ("failure", "reason", "stage")
"""Words of an info, attributes of an episode."""

FLAGS: Final = ("success", "is_success", "grasped", "simulation_error")
"""Flags of an info, the last entries of a row."""


def distance(first: Vector, second: Vector) -> float:
    """Return the distance of two points [m]."""
    x, y, z = first[0] - second[0], first[1] - second[1], first[2] - second[2]
    return math.sqrt(x * x + y * y + z * z)


def handle_rotation(way: float, side: float, reading: DoorReading) -> Vector:
    """Return the handle's rotation vector [rad].

    Turned about its own axis, normal to the closed leaf, and then about the hinge.
    """
    about_up = side * way * reading.angle
    if reading.handle_angle == 0.0:
        return 0.0, about_up, 0.0
    turn = -side * reading.handle_angle
    # The quaternion of a turn about y times that of one about x.
    cy, sy = math.cos(0.5 * about_up), math.sin(0.5 * about_up)
    cx, sx = math.cos(0.5 * turn), math.sin(0.5 * turn)
    x, y, z = cy * sx, sy * cx, -sy * sx
    length = math.sqrt(x * x + y * y + z * z)
    scale = 2.0 * math.atan2(length, cy * cx) / length if length > 0.0 else 2.0
    return scale * x, scale * y, scale * z
