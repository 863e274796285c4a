"""MuJoCo sensors for all quantities in observation and info."""

from collections.abc import Sequence
from typing import Final

import mujoco

from gplfd_env.conventions.constants import Control
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

_SENSOR: Final = mujoco.mjtSensor
_SITE: Final = mujoco.mjtObj.mjOBJ_SITE
_JOINT: Final = mujoco.mjtObj.mjOBJ_JOINT
_GEOM: Final = mujoco.mjtObj.mjOBJ_GEOM
_ACTUATOR: Final = mujoco.mjtObj.mjOBJ_ACTUATOR
_TENDON: Final = mujoco.mjtObj.mjOBJ_TENDON

_AXES: Final = {
    "x": _SENSOR.mjSENS_FRAMEXAXIS,
    "y": _SENSOR.mjSENS_FRAMEYAXIS,
    "z": _SENSOR.mjSENS_FRAMEZAXIS,
}

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
        name: str,
        kind: mujoco.mjtSensor,
        of: mujoco.mjtObj,
        target: str,
        reference: str | None = None,
    ) -> mujoco.MjsSensor:
        sensor = spec.add_sensor(name=name, type=kind, objtype=of, objname=target)
        if reference is not None:
            sensor.reftype, sensor.refname = _SITE, reference
        return sensor

    def add_joints(names: Sequence[str]) -> None:
        for name in names:
            add(f"{name}_pos", _SENSOR.mjSENS_JOINTPOS, _JOINT, name)
        for name in names:
            add(f"{name}_vel", _SENSOR.mjSENS_JOINTVEL, _JOINT, name)

    def add_axes(first: str, site: str, reference: str | None = None) -> None:
        for axis, kind in _AXES.items():
            add(f"{first}_{axis}axis", kind, _SITE, site, reference)

    servos = ("servo_rotation",) if control == "pose" else ROTATION_SERVOS
    for name in (*TRANSLATION_SERVOS, *servos):
        sensor = name.replace("servo_rotation", "hand_rotvec").replace("servo", "hand")
        add(sensor, _SENSOR.mjSENS_ACTUATORPOS, _ACTUATOR, name)
    add("hand_linvel", _SENSOR.mjSENS_FRAMELINVEL, _SITE, "hand", "task_frame")
    add("hand_angvel", _SENSOR.mjSENS_FRAMEANGVEL, _SITE, "hand", "task_frame")
    add_joints(robot.arm)
    force = add("wrist_force", _SENSOR.mjSENS_FORCE, _SITE, "wrist_ft")
    torque = add("wrist_torque", _SENSOR.mjSENS_TORQUE, _SITE, "wrist_ft")
    force.cutoff, torque.cutoff = WRENCH_LIMITS
    add_axes("wrist", "wrist_ft", "task_frame")
    if robot.base == "mobile":
        add_joints(BASE_JOINTS)
    if grasp == "gripper":
        add("finger", _SENSOR.mjSENS_JOINTPOS, _JOINT, robot.fingers[0])
    if robot.base == "mobile":
        add("hinge_end", _SENSOR.mjSENS_TENDONLIMITFRC, _TENDON, "hinge_end")
    add("hinge_angle", _SENSOR.mjSENS_JOINTPOS, _JOINT, "hinge")
    add("hinge_velocity", _SENSOR.mjSENS_JOINTVEL, _JOINT, "hinge")
    add("handle_pos", _SENSOR.mjSENS_FRAMEPOS, _SITE, "handle", "task_frame")
    add("hand_on_handle", _SENSOR.mjSENS_FRAMEPOS, _SITE, "hand", "handle")
    turning = structure.handle != "bar"
    level = structure.motion == "flap"
    add_axes("handle", "leaf_axes" if turning or level else "handle")
    for side, finger in zip(SIDES, robot.fingers, strict=True):
        touching = _GEOM, f"{side}_finger_pad"
        if turning:
            body = spec.joint(finger).parent.name
            touching = mujoco.mjtObj.mjOBJ_BODY, body
        _add_contact(spec, f"{side}_pad_contact", touching, _CONTACT_FOUND)
    _add_contact(spec, "bar_force", None, _CONTACT_FORCE)
    add("hinge_stop", _SENSOR.mjSENS_JOINTLIMITFRC, _JOINT, "hinge")
    if turning:
        add("handle_angle", _SENSOR.mjSENS_JOINTPOS, _JOINT, "handle")
    if structure.latched:
        add("bolt", _SENSOR.mjSENS_JOINTPOS, _JOINT, "bolt")


def _add_contact(
    spec: mujoco.MjSpec, name: str, other: tuple[mujoco.mjtObj, str] | None, fields: int
) -> None:
    """Add a contact sensor between the handle and a pad, a finger, or anything."""
    sensor = spec.add_sensor(
        name=name,
        type=_SENSOR.mjSENS_CONTACT,
        objtype=other[0] if other else mujoco.mjtObj.mjOBJ_UNKNOWN,
        objname=other[1] if other else "",
        reftype=_GEOM,
        refname="handle_bar",
    )
    sensor.intprm[:3] = [fields, _NET_FORCE if other is None else 0, 1]
