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

OBSTACLES: Final = ("leaf", "jamb_hinge", "jamb_lock", "lintel")
"""Geoms of the door that collide with a mobile robot, besides the walls."""

BASE_RADIUS: Final = 0.27
"""Radius of the base's outline [m]."""

_ROBOT_BIT: Final = 2
_WALL_HALF_WIDTH: Final = 0.75
_PLASTER: Final = (0.80, 0.82, 0.83, 1.0)

_CAPSULES: Final[dict[str, tuple[str, tuple[float, ...], float]]] = {
    "base_body": ("base_link", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
    "column_body": ("torso_fixed_link", (-0.03, 0, 0.15, -0.03, 0, 0.5), 0.16),
    "chest_body": ("torso_lift_link", (0.03, 0, -0.15, 0.03, 0, -0.05), 0.16),
    "head_body": ("head_link", (0, 0, 0, 0, 0, 0.05), 0.12),
    "shoulder_body": ("arm_1_link", (0, 0, -0.03, 0.125, 0.0195, -0.031), 0.06),
    "upper_arm_body": ("arm_3_link", (0, 0, 0, -0.01, -0.013, -0.21), 0.055),
    "elbow_body": ("arm_4_link", (0, 0, 0.005, -0.162, 0.02, 0.027), 0.05),
    "forearm_body": ("arm_5_link", (0, 0, 0, 0, 0, 0.15), 0.045),
    "palm_body": ("gripper_link", (0, 0, 0.04, 0, 0, -0.06), 0.045),
}
"""Body, ends in its frame [m] and radius [m] of every capsule."""


def add_collisions(spec: mujoco.MjSpec) -> None:
    """Add the robot's collision geometry and enable contact with door and walls."""
    for name, (body, ends, radius) in _CAPSULES.items():
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

    With a fixed base that pushes, the arm passes beside the lock, where a wall would
    hide it: there the wall ends at the frame.
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
