"""MuJoCo sensors for all quantities in observation and info."""

from collections.abc import Sequence
from typing import Final

import mujoco

from gplfd_env.conventions.constants import Control
from gplfd_env.doors.config import MOTIONS
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.model import (
    ROTATION_SERVOS,
    SIDES,
    TRANSLATION_SERVOS,
    WRENCH_LIMITS,
    Hold,
)
from gplfd_env.scene.door import Structure

_SITE: Final = mujoco.mjtObj.mjOBJ_SITE
_JOINT: Final = mujoco.mjtObj.mjOBJ_JOINT
_CONTACT_FOUND: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
_CONTACT_FORCE: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
_NET_FORCE: Final = 3


def add_sensors(
    spec: mujoco.MjSpec,
    structure: Structure,
    control: Control,
    robot: RobotConfig,
    grasp: Hold,
) -> None:
    """Add every sensor, in the order in which `gplfd_env.task.observation` reads them.

    Poses and twists of the hand are measured in the task frame; wrist force and torque
    in the sensor site's frame (the hand's axes); the leaf's axes and the contact force
    on the handle in the world frame. Handle and bolt, if there are any, come last.
    """

    def add(
        name: str, kind: str, of: mujoco.mjtObj, target: str, reference: str = ""
    ) -> mujoco.MjsSensor:
        kind_of = getattr(mujoco.mjtSensor, f"mjSENS_{kind}")
        sensor = spec.add_sensor(name=name, type=kind_of, objtype=of, objname=target)
        if reference:
            sensor.reftype, sensor.refname = _SITE, reference
        return sensor

    def add_joints(names: Sequence[str]) -> None:
        for suffix in ("pos", "vel"):
            for name in names:
                add(f"{name}_{suffix}", f"JOINT{suffix.upper()}", _JOINT, name)

    def add_axes(first: str, site: str, reference: str = "") -> None:
        for axis in "xyz":
            kind = f"FRAME{axis.upper()}AXIS"
            add(f"{first}_{axis}axis", kind, _SITE, site, reference)

    servos = ("servo_rotation",) if control == "pose" else ROTATION_SERVOS
    for name in (*TRANSLATION_SERVOS, *servos):
        sensor = name.replace("servo_rotation", "hand_rotvec").replace("servo", "hand")
        add(sensor, "ACTUATORPOS", mujoco.mjtObj.mjOBJ_ACTUATOR, name)
    add("hand_linvel", "FRAMELINVEL", _SITE, "hand", "task_frame")
    add("hand_angvel", "FRAMEANGVEL", _SITE, "hand", "task_frame")
    add_joints(robot.arm)
    add("wrist_force", "FORCE", _SITE, "wrist_ft").cutoff = WRENCH_LIMITS[0]
    add("wrist_torque", "TORQUE", _SITE, "wrist_ft").cutoff = WRENCH_LIMITS[1]
    add_axes("wrist", "wrist_ft", "task_frame")
    if robot.base == "mobile":
        add_joints(BASE_JOINTS)
    if grasp == "gripper":
        add("finger", "JOINTPOS", _JOINT, robot.fingers[0])
    if robot.base == "mobile":
        add("hinge_end", "TENDONLIMITFRC", mujoco.mjtObj.mjOBJ_TENDON, "hinge_end")
    add("hinge_angle", "JOINTPOS", _JOINT, "hinge")
    add("hinge_velocity", "JOINTVEL", _JOINT, "hinge")
    add("handle_pos", "FRAMEPOS", _SITE, "handle", "task_frame")
    add("hand_on_handle", "FRAMEPOS", _SITE, "hand", "handle")
    turning = structure.handle != "bar"
    level = MOTIONS[structure.motion].level
    add_axes("handle", "leaf_axes" if turning or level else "handle")
    for side, finger in zip(SIDES, robot.fingers, strict=True):
        touching = mujoco.mjtObj.mjOBJ_GEOM, f"{side}_finger_pad"
        if turning:
            touching = mujoco.mjtObj.mjOBJ_BODY, spec.joint(finger).parent.name
        _add_contact(spec, f"{side}_pad_contact", *touching, _CONTACT_FOUND)
    anything = mujoco.mjtObj.mjOBJ_UNKNOWN, ""
    _add_contact(spec, "bar_force", *anything, _CONTACT_FORCE, _NET_FORCE)
    add("hinge_stop", "JOINTLIMITFRC", _JOINT, "hinge")
    if turning:
        add("handle_angle", "JOINTPOS", _JOINT, "handle")
    if structure.latched:
        add("bolt", "JOINTPOS", _JOINT, "bolt")


def _add_contact(
    spec: mujoco.MjSpec,
    name: str,
    of: mujoco.mjtObj,
    target: str,
    fields: int,
    reduction: int = 0,
) -> None:
    """Add a sensor of the contact between the handle and a pad, finger or anything."""
    handle = {"reftype": mujoco.mjtObj.mjOBJ_GEOM, "refname": "handle_bar"}
    kind = mujoco.mjtSensor.mjSENS_CONTACT
    other = {"objtype": of, "objname": target}
    sensor = spec.add_sensor(name=name, type=kind, **other, **handle)
    sensor.intprm[:3] = [fields, reduction, 1]
