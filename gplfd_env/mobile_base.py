"""A base that moves: three planar joints at the robot's root, and their drives."""

from typing import Final

import mujoco

BASE_JOINTS: Final = ("base_x_joint", "base_y_joint", "base_yaw_joint")
"""Ahead and to the left of where the base stood at the reset, and turned left."""

BASE_DRIVES: Final = ("drive_x", "drive_y", "drive_yaw")

_WHEEL_FORCE: Final = 315.0
"""Of four wheels with 6 N m and a radius of 0.0762 m each [N]."""
_WHEEL_TORQUE: Final = 147.0
"""The same about the vertical, with half track and half wheelbase, 0.2236 and 0.244 m,
as lever [N m]."""
_DAMPING: Final = (2.0e4, 2.0e3)
"""Of the drives: force per difference of speed [N s/m, N m s/rad]."""


def add_mobile_base(spec: mujoco.MjSpec) -> None:
    """Give the robot planar joints and drives that hold a commanded rate.

    Args:
        spec: The robot; edited in place.
    """
    root = spec.body("base_footprint")
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    kinds = (slide, (1, 0, 0)), (slide, (0, 1, 0)), (hinge, (0, 0, 1))
    limits = (
        (_WHEEL_FORCE, _DAMPING[0]),
        (_WHEEL_FORCE, _DAMPING[0]),
        (
            _WHEEL_TORQUE,
            _DAMPING[1],
        ),
    )
    for name, drive, (kind, axis), (limit, damping) in zip(
        BASE_JOINTS, BASE_DRIVES, kinds, limits, strict=True
    ):
        root.add_joint(name=name, type=kind, axis=axis)
        servo = spec.add_actuator(
            name=drive,
            target=name,
            trntype=mujoco.mjtTrn.mjTRN_JOINT,
            forcelimited=True,
            forcerange=[-limit, limit],
        )
        servo.set_to_velocity(kv=damping)
