"""The robot in MuJoCo: its URDF, with servos, sites, cameras and collision geometry.

Finger pads and handle collide in every scene; with a mobile base, base, torso and arm
also collide with leaf, frame and wall. Capsules approximate the robot: MuJoCo computes
contacts of capsules and boxes in closed form.
"""

import math
from collections.abc import Sequence
from typing import Final, Literal

import mujoco
import numpy as np

from gplfd_env.conventions.constants import INTANGIBLE, UNDRAWN, Base, Control
from gplfd_env.doors.config import DoorConfig, held_radius
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.description import PAD_BEHIND, described_robot
from gplfd_env.robot.mobile_base import add_mobile_base
from gplfd_env.robot.placement import gripper_rotation_w, quaternion, task_rotation_w

SERVO_STIFFNESS: Final = (2000.0, 100.0)
"""Cartesian servo: translation [N/m], rotation [N m/rad]."""
SERVO_DAMPING: Final = (179.0, 7.7)
"""Cartesian servo: translation [N s/m], rotation [N m s/rad]."""

TRANSLATION_SERVOS: Final = ("servo_x", "servo_y", "servo_z")
ROTATION_SERVOS: Final = tuple(f"servo_rotation_{axis}" for axis in "xyz")
"""One servo per axis of the hand's rotation vector, under impedance control."""
WRENCH_LIMITS: Final = (500.0, 50.0)
"""Saturation of the wrist sensor: force [N], torque [N m], per axis."""
COMMAND_LIMITS: Final = (1.0, math.pi / 2)
"""Largest commanded displacement [m] and rotation vector component [rad] per axis."""

_POSTURE_STIFFNESS: Final = 0.1
_FINGER_STIFFNESS: Final = 2000.0
_TORSO_STIFFNESS: Final = (5.0e4, 2.0e3)
_RIDGE_HEIGHT: Final = 0.008
_RIDGE_HALF_WIDTH: Final = 0.010
_RIDGE_HALF_THICKNESS: Final = 0.002
_RIDGE_PLAY: Final = 0.002
_RUBBER: Final = (0.22, 0.22, 0.23, 1.0)

Grasp = Literal["contact", "weld"]
"""Friction between the finger pads and the bar, or a rigid joint."""
Hold = Literal["contact", "weld", "gripper"]
"""How a scene holds the handle: a `Grasp`, or ``"gripper"``, friction of fingers that
open and close during an episode."""
SIDES: Final = ("right", "left")
"""Sides of the fingers, in the order of `RobotConfig.fingers`."""
GRIPS: Final = ("grip_right", "grip_left")
"""The fingers' servos."""


def load_robot(control: Control, door: DoorConfig, robot: RobotConfig) -> mujoco.MjSpec:
    """Read a robot and add gravity compensation, servos, sites and cameras.

    The hand site's axes coincide with the task frame when the door is closed, so the
    orientation servo's exponential-map input *is* θu (Eq. 8) without a conversion.
    Control by ``"pose"`` turns the hand by one servo on the whole orientation, by
    ``"impedance"`` by one per axis. Needs a ``task_frame`` site to compile.
    """
    spec = described_robot(robot)
    spec.modelname = "gplfd door opening"
    for body in spec.bodies:
        body.gravcomp = 1.0
    for name, armature in zip(robot.arm, robot.armature, strict=True):
        joint = spec.joint(name)
        joint.armature = armature
        joint.stiffness[0] = _POSTURE_STIFFNESS
    for joint in spec.joints:
        # Motors also carry the arm's weight, so it counts against their limits.
        joint.actgravcomp = True
    (coupling,) = spec.equalities
    coupling.name = "finger_coupling"

    tool, sensor = spec.body(robot.tool), spec.body(robot.sensor)
    to_task = gripper_rotation_w(door, robot).T @ task_rotation_w(door, robot)
    to_task = robot.grasp_axes @ to_task
    hand = {"name": "hand", "pos": robot.grasp_point, "quat": quaternion(to_task)}
    tool.add_site(**hand, **UNDRAWN)
    # The sensor site takes the hand site's axes.
    to_sensor = np.array(robot.sensor_rotation) @ to_task
    sensor.add_site(name="wrist_ft", quat=quaternion(to_sensor), **UNDRAWN)
    # A head with pan and tilt keeps the hand in the middle of its picture.
    body, place = robot.head
    aim = {"mode": mujoco.mjtCamLight.mjCAMLIGHT_TARGETBODY, "targetbody": robot.tool}
    spec.body(body).add_camera(name="head", pos=place, fovy=60.0, **aim)
    place, right, up = robot.hand_camera
    tool.add_camera(name="hand_camera", pos=place, xyaxes=[*right, *up], fovy=60.0)

    _add_axis_servos(spec, TRANSLATION_SERVOS, first=0)
    if control == "pose":
        servo = _hand_servo(spec, "servo_rotation", COMMAND_LIMITS[1])
        servo.set_to_orientation(kp=SERVO_STIFFNESS[1], kv=SERVO_DAMPING[1])
    else:
        _add_axis_servos(spec, ROTATION_SERVOS, first=3)
    on_joint = mujoco.mjtTrn.mjTRN_JOINT
    lift = spec.add_actuator(name="torso_hold", target=robot.lift, trntype=on_joint)
    lift.set_to_position(kp=_TORSO_STIFFNESS[0], kv=_TORSO_STIFFNESS[1])
    for side, finger, name in zip(SIDES, robot.fingers, GRIPS, strict=True):
        grip = spec.add_actuator(name=name, target=finger, trntype=on_joint)
        grip.set_to_position(kp=_FINGER_STIFFNESS)
        pad = spec.geom(f"{side}_finger_pad")
        pad.rgba = _RUBBER
        pad.contype, pad.conaffinity = 1, 0
    if door.handle != "bar":
        _add_hooks(spec, held_radius(door.handle))
    if robot.base == "mobile":
        add_mobile_base(spec, robot)
    return spec


def _add_axis_servos(spec: mujoco.MjSpec, names: Sequence[str], first: int) -> None:
    """Add a servo per axis of the hand's translation (first 0) or rotation (3)."""
    kind = first // 3
    for axis, name in enumerate(names, start=first):
        servo = _hand_servo(spec, name, COMMAND_LIMITS[kind])
        servo.gear = np.eye(6)[axis]
        servo.set_to_position(kp=SERVO_STIFFNESS[kind], kv=SERVO_DAMPING[kind])


def _hand_servo(spec: mujoco.MjSpec, name: str, limit: float) -> mujoco.MjsActuator:
    """Add an actuator between the hand and the task frame."""
    limits = {"ctrllimited": True, "ctrlrange": [-limit, limit]}
    to_site = {"refsite": "task_frame", "trntype": mujoco.mjtTrn.mjTRN_SITE}
    return spec.add_actuator(name=name, target="hand", **to_site, **limits)


def _add_hooks(spec: mujoco.MjSpec, radius: float) -> None:
    """Add ridges to the finger pads, which hold a round handle with 2 mm of play."""
    waist = radius - _RIDGE_HEIGHT
    reach = math.sqrt(radius**2 - waist**2) + _RIDGE_PLAY / 2 + _RIDGE_HALF_THICKNESS
    for side, inwards in zip(SIDES, (-1.0, 1.0), strict=True):
        pad = spec.geom(f"{side}_finger_pad")
        axes = np.zeros(9)
        mujoco.mju_quat2Mat(axes, pad.quat)
        across, _, back = axes.reshape(3, 3).T
        # The pad's inner face, at the height of the grasped point.
        face = np.array(pad.pos) + inwards * pad.size[0] * across - PAD_BEHIND * back
        for place, along in (("tip", -reach), ("palm", reach)):
            pad.parent.add_geom(
                name=f"{side}_finger_ridge_{place}",
                pos=face + inwards * _RIDGE_HEIGHT / 2 * across + along * back,
                quat=pad.quat,
                size=[_RIDGE_HEIGHT / 2, _RIDGE_HALF_WIDTH, _RIDGE_HALF_THICKNESS],
                type=mujoco.mjtGeom.mjGEOM_BOX,
                rgba=_RUBBER,
                mass=0.0,
                contype=1,
                conaffinity=0,
            )


OBSTACLES: Final = ("leaf", "jamb_hinge", "jamb_lock", "lintel")
"""Geoms of the door that collide with a mobile robot, besides the walls."""

_ROBOT_BIT: Final = 2
_WALL_HALF_WIDTH: Final = 0.75
_PLASTER: Final = (0.80, 0.82, 0.83, 1.0)


def add_collisions(spec: mujoco.MjSpec, robot: RobotConfig) -> None:
    """Add the robot's collision geometry and enable contact with door and walls."""
    for name, body, ends, radius in robot.capsules:
        shape = {"type": mujoco.mjtGeom.mjGEOM_CAPSULE, "size": [radius, 0, 0]}
        # The links keep their own inertias and visual shapes.
        shape |= {"mass": 0.0, "rgba": [0, 0, 0, 0]}
        touches = {"contype": _ROBOT_BIT, "conaffinity": 0}
        spec.body(body).add_geom(name=name, fromto=ends, **shape, **touches)
    for name in (*OBSTACLES, "wall_hinge", "wall_lock"):
        spec.geom(name).conaffinity = _ROBOT_BIT


def add_walls(spec: mujoco.MjSpec, door: DoorConfig, base: Base) -> None:
    """Add walls without contact, but none where the arm of a fixed base pushes."""
    for side in ("hinge", "lock"):
        jamb, other = spec.geom(f"jamb_{side}"), spec.geom("lintel")
        outwards = 1.0 if jamb.pos[2] > other.pos[2] else -1.0
        x, y, z = jamb.pos
        thick, high, wide = jamb.size
        free = (base, door.swing, side) == ("fixed", "push", "lock")
        # Every scene needs the same number of geoms.
        half_width = 1e-3 if free else _WALL_HALF_WIDTH
        place, size = [x, y, z + outwards * (wide + half_width)], [thick, high]
        wall = {"type": mujoco.mjtGeom.mjGEOM_BOX, "rgba": _PLASTER, "mass": 0.0}
        wall |= {"name": f"wall_{side}", "pos": place, "size": [*size, half_width]}
        spec.body("door_frame").add_geom(**wall, **INTANGIBLE)
