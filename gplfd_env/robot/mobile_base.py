"""A base that moves: three planar joints, and wheels that grip the floor up to a limit.

The motors turn at the commanded rates whatever happens. Each of the four wheels passes
on a force to the base that opposes its slip, as Coulomb friction does, up to the force
at which its motor gives way. Nothing else in the robot pushes the base: the torques of
the arm's joints act between its links.
"""

from typing import Final

import mujoco

from gplfd_env.robot.config import RobotConfig

BASE_JOINTS: Final = ("base_x_joint", "base_y_joint", "base_yaw_joint")
"""Ahead and to the left of where the base stood at the reset, and turned left."""

BASE_DRIVES: Final = ("drive_x", "drive_y", "drive_yaw")

WHEELS: Final = {
    "wheel_front_left": (1.0, -1.0, -1.0),
    "wheel_front_right": (1.0, 1.0, 1.0),
    "wheel_rear_left": (1.0, 1.0, -1.0),
    "wheel_rear_right": (1.0, -1.0, 1.0),
}
"""How a mecanum wheel rolls when the base goes ahead, to the left, and turns left."""

WHEEL_FORCE: Final = 6.0 / 0.0762
"""Of one wheel: greatest torque of its motor over its radius [N]."""

WHEEL_LEVER: Final = 0.2236 + 0.244
"""Of a wheel's force about the vertical: half of track and wheelbase [m]."""

_ROTOR_INERTIA: Final = (1e3, 1e3, 1e2)
"""Of the motors [kg, kg, kg m²]: more than the base's, which therefore cannot slow them
down."""
_TRACKING: Final = 2.0e6
"""Gain with which motors keep their rate [N s/m, N m s/rad]."""
_NO_FORCE: Final = 1e-6
"""Limit of a force that is none: MuJoCo asks for a range [N, N m]."""

HARD_STOP: Final = (0.005, 1.0)
"""Time constant [s] and damping ratio of the ends of hinge and fingers where the robot
drives: two and a half physics steps. With MuJoCo's 0.02 s a base of 60 kg that runs
into the leaf presses it into the frame by more than a degree."""

SOFT_STOP: Final = (0.015, 1.0)
"""The same of a stop that a disturbance sets."""

_RIGID: Final = (0.99, 0.999, 0.001, 0.5, 2.0)
"""Impedance of the fingers' ends. Fast arm motion deflects the limits of the fingers by
at most 1 cm."""


def add_mobile_base(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Give the robot planar joints, and wheels that are driven at a commanded rate."""
    root = spec.body(robot.root)
    motors = spec.worldbody.add_body(
        name="motors", explicitinertial=True, mass=1.0, inertia=[1.0, 1.0, 1.0]
    )
    slide, hinge = mujoco.mjtJoint.mjJNT_SLIDE, mujoco.mjtJoint.mjJNT_HINGE
    kinds = (slide, (1, 0, 0)), (slide, (0, 1, 0)), (hinge, (0, 0, 1))
    for name, drive, (kind, axis), inertia in zip(
        BASE_JOINTS, BASE_DRIVES, kinds, _ROTOR_INERTIA, strict=True
    ):
        root.add_joint(
            name=name,
            type=kind,
            axis=axis,
            actfrclimited=True,
            actfrcrange=[-_NO_FORCE, _NO_FORCE],
        )
        motors.add_joint(name=f"{drive}_joint", type=kind, axis=axis, armature=inertia)
        servo = spec.add_actuator(
            name=drive, target=f"{drive}_joint", trntype=mujoco.mjtTrn.mjTRN_JOINT
        )
        servo.set_to_velocity(kv=_TRACKING)
    for name in robot.fingers:
        finger = spec.joint(name)
        finger.solref_limit, finger.solimp_limit = HARD_STOP, _RIGID
    for name, (ahead, left, turn) in WHEELS.items():
        slip = spec.add_tendon(
            name=name,
            frictionloss=WHEEL_FORCE,
            solref_friction=[0.004, 1.0],
            solimp_friction=[0.999, 0.999, 0.001, 0.5, 2.0],
        )
        for base, drive, way in zip(
            BASE_JOINTS, BASE_DRIVES, (ahead, left, WHEEL_LEVER * turn), strict=True
        ):
            slip.wrap_joint(base, way)
            slip.wrap_joint(f"{drive}_joint", -way)
