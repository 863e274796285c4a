"""Collision geometry of a mobile robot, and the walls beside the door.

Finger pads and handle collide in every scene. With a mobile base, base, torso and arm
also collide with leaf, frame and wall. Capsules approximate the robot: MuJoCo computes
contacts of capsules and boxes in closed form, and an upright capsule meets an upright
wall as a cylinder does.
"""

from typing import Final

import mujoco

from gplfd_env.conventions.constants import INTANGIBLE, Base
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.config import RobotConfig

OBSTACLES: Final = ("leaf", "jamb_hinge", "jamb_lock", "lintel")
"""Geoms of the door that collide with a mobile robot, besides the walls."""

_ROBOT_BIT: Final = 2
_WALL_HALF_WIDTH: Final = 0.75
_PLASTER: Final = (0.80, 0.82, 0.83, 1.0)


def add_collisions(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Add the robot's collision geometry and enable contact with door and walls."""
    for name, body, ends, radius in robot.capsules:
        spec.body(body).add_geom(
            name=name,
            type=mujoco.mjtGeom.mjGEOM_CAPSULE,
            fromto=ends,
            size=[radius, 0, 0],
            # The links keep their own inertias and visual shapes.
            mass=0.0,
            rgba=[0, 0, 0, 0],
            contype=_ROBOT_BIT,
            conaffinity=0,
        )
    for name in (*OBSTACLES, "wall_hinge", "wall_lock"):
        spec.geom(name).conaffinity = _ROBOT_BIT


def add_walls(spec: mujoco.MjSpec, door: DoorConfig, base: Base) -> None:
    """Add the walls on both sides of the frame, without contact.

    If a robot with a fixed base pushes, its arm passes beside the lock, where a wall
    would hide it: there the wall ends at the frame.
    """
    for side in ("hinge", "lock"):
        jamb, other = spec.geom(f"jamb_{side}"), spec.geom("lintel")
        outwards = 1.0 if jamb.pos[2] > other.pos[2] else -1.0
        x, y, z = jamb.pos
        thick, high, wide = jamb.size
        free = (base, door.swing, side) == ("fixed", "push", "lock")
        # Every scene needs the same number of geoms.
        half_width = 1e-3 if free else _WALL_HALF_WIDTH
        spec.body("door_frame").add_geom(
            name=f"wall_{side}",
            type=mujoco.mjtGeom.mjGEOM_BOX,
            pos=[x, y, z + outwards * (wide + half_width)],
            size=[thick, high, half_width],
            rgba=_PLASTER,
            mass=0.0,
            **INTANGIBLE,
        )
