"""Mobile base: three planar joints, and wheels with limited traction.

The motors always turn at the commanded rates. Each of the four wheels transmits a force
to the base that opposes its slip, like Coulomb friction, up to the force that its motor
can hold. Nothing else in the robot pushes the base: the torques of the arm's joints act
between its links.
"""

from typing import Final

import mujoco

from gplfd_env.conventions.constants import DRY_FRICTION
from gplfd_env.robot.config import RobotConfig

BASE_JOINTS: Final = ("base_x_joint", "base_y_joint", "base_yaw_joint")
"""Displacement ahead, to the left, and rotation to the left, since the reset."""

BASE_DRIVES: Final = ("drive_x", "drive_y", "drive_yaw")

WHEELS: Final = {
    "wheel_front_left": (1.0, -1.0, -1.0),
    "wheel_front_right": (1.0, 1.0, 1.0),
    "wheel_rear_left": (1.0, 1.0, -1.0),
    "wheel_rear_right": (1.0, -1.0, 1.0),
}
"""Rolling of a mecanum wheel when the base moves ahead, to the left, and turns left."""

WHEEL_FORCE: Final = 6.0 / 0.0762
"""Greatest force of one wheel: torque of its motor over its radius [N]."""
WHEEL_LEVER: Final = 0.2236 + 0.244
"""Lever arm of a wheel's force about the vertical: half of (track + wheelbase) [m]."""

# Inertia of the motors [kg, kg, kg m²]: much more than the base's, so that the base
# cannot slow them down.
_ROTOR_INERTIA: Final = (1e3, 1e3, 1e2)
_TRACKING: Final = 2.0e6  # Gain of the motors' rate control [N s/m, N m s/rad].
# Limit of a force that is practically zero: MuJoCo requires a range [N, N m].
_NO_FORCE: Final = 1e-6

HARD_STOP: Final = (0.005, 1.0)
"""Time constant [s] and damping ratio of the joint limits of hinge and fingers with a
mobile base: two and a half physics steps. With MuJoCo's 0.02 s a base of 60 kg that
runs into the leaf presses it into the frame by more than a degree."""
SOFT_STOP: Final = (0.015, 1.0)
"""The same for a stop that a disturbance sets."""

# Impedance of the fingers' limits. Fast arm motion deflects them by at most 1 cm.
_RIGID: Final = (0.99, 0.999, 0.001, 0.5, 2.0)


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
        free = {"actfrclimited": True, "actfrcrange": [-_NO_FORCE, _NO_FORCE]}
        root.add_joint(name=name, type=kind, axis=axis, **free)
        motors.add_joint(name=f"{drive}_joint", type=kind, axis=axis, armature=inertia)
        joint = {"target": f"{drive}_joint", "trntype": mujoco.mjtTrn.mjTRN_JOINT}
        servo = spec.add_actuator(name=drive, **joint)
        servo.set_to_velocity(kv=_TRACKING)
    for name in robot.fingers:
        finger = spec.joint(name)
        finger.solref_limit, finger.solimp_limit = HARD_STOP, _RIGID
    for name, (ahead, left, turn) in WHEELS.items():
        slip = spec.add_tendon(name=name, frictionloss=WHEEL_FORCE, **DRY_FRICTION)
        for base, drive, way in zip(
            BASE_JOINTS, BASE_DRIVES, (ahead, left, WHEEL_LEVER * turn), strict=True
        ):
            slip.wrap_joint(base, way)
            slip.wrap_joint(f"{drive}_joint", -way)
