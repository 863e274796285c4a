"""The sensors that let MuJoCo itself compute what observation and info need."""

from typing import Final

import mujoco

from gplfd_env.conventions.constants import Base, Control
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.model import FINGER, ROTATION_SERVOS, WRENCH_LIMITS
from gplfd_env.robot.placement import ARM_JOINTS
from gplfd_env.scene.door import Structure

_SENSOR: Final = mujoco.mjtSensor
_SITE: Final = mujoco.mjtObj.mjOBJ_SITE
_JOINT: Final = mujoco.mjtObj.mjOBJ_JOINT
_GEOM: Final = mujoco.mjtObj.mjOBJ_GEOM
_ACTUATOR: Final = mujoco.mjtObj.mjOBJ_ACTUATOR
_TENDON: Final = mujoco.mjtObj.mjOBJ_TENDON

_CONTACT_FOUND: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
_CONTACT_FORCE: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
_NET_FORCE: Final = 3


def add_sensors(
    spec: mujoco.MjSpec,
    structure: Structure,
    control: Control = "pose",
    base: Base = "fixed",
    *,
    gripper: bool = False,
) -> None:
    """Add every sensor, in the order in which `gplfd_env.task.observation` reads them.

    Poses and twists of the hand are measured in the task frame; wrist force and torque
    in the sensor site's frame (the hand's axes); the leaf's axes and the contact force
    on the handle in the world frame. Handle and bolt come last, where there are any.
    """
    for axis in ("x", "y", "z"):
        _add(
            spec, f"hand_{axis}", _SENSOR.mjSENS_ACTUATORPOS, _ACTUATOR, f"servo_{axis}"
        )
    rotation = ("servo_rotation",) if control == "pose" else ROTATION_SERVOS
    for name in rotation:
        sensor = name.replace("servo_rotation", "hand_rotvec")
        _add(spec, sensor, _SENSOR.mjSENS_ACTUATORPOS, _ACTUATOR, name)
    _add(spec, "hand_linvel", _SENSOR.mjSENS_FRAMELINVEL, _SITE, "hand", "task_frame")
    _add(spec, "hand_angvel", _SENSOR.mjSENS_FRAMEANGVEL, _SITE, "hand", "task_frame")
    for name in ARM_JOINTS:
        _add(spec, f"{name}_pos", _SENSOR.mjSENS_JOINTPOS, _JOINT, name)
    for name in ARM_JOINTS:
        _add(spec, f"{name}_vel", _SENSOR.mjSENS_JOINTVEL, _JOINT, name)
    force = _add(spec, "wrist_force", _SENSOR.mjSENS_FORCE, _SITE, "wrist_ft")
    force.cutoff = WRENCH_LIMITS[0]
    torque = _add(spec, "wrist_torque", _SENSOR.mjSENS_TORQUE, _SITE, "wrist_ft")
    torque.cutoff = WRENCH_LIMITS[1]
    for axis in ("X", "Y", "Z"):
        kind = getattr(_SENSOR, f"mjSENS_FRAME{axis}AXIS")
        _add(spec, f"wrist_{axis.lower()}axis", kind, _SITE, "wrist_ft", "task_frame")
    for name in BASE_JOINTS if base == "mobile" else ():
        _add(spec, f"{name}_pos", _SENSOR.mjSENS_JOINTPOS, _JOINT, name)
    for name in BASE_JOINTS if base == "mobile" else ():
        _add(spec, f"{name}_vel", _SENSOR.mjSENS_JOINTVEL, _JOINT, name)
    if gripper:
        _add(spec, "finger", _SENSOR.mjSENS_JOINTPOS, _JOINT, FINGER)
    if base == "mobile":
        _add(spec, "hinge_end", _SENSOR.mjSENS_TENDONLIMITFRC, _TENDON, "hinge_end")
    _add(spec, "hinge_angle", _SENSOR.mjSENS_JOINTPOS, _JOINT, "hinge")
    _add(spec, "hinge_velocity", _SENSOR.mjSENS_JOINTVEL, _JOINT, "hinge")
    _add(spec, "handle_pos", _SENSOR.mjSENS_FRAMEPOS, _SITE, "handle", "task_frame")
    _add(spec, "hand_on_handle", _SENSOR.mjSENS_FRAMEPOS, _SITE, "hand", "handle")
    turning = structure.handle != "bar"
    axes = "leaf_axes" if turning else "handle"
    for axis in ("X", "Y", "Z"):
        kind = getattr(_SENSOR, f"mjSENS_FRAME{axis}AXIS")
        _add(spec, f"handle_{axis.lower()}axis", kind, _SITE, axes)
    for side in ("right", "left"):
        pad = _GEOM, f"{side}_finger_pad"
        finger = mujoco.mjtObj.mjOBJ_BODY, f"gripper_{side}_finger_link"
        touching = finger if turning else pad
        _add_contact(spec, f"{side}_pad_contact", touching, _CONTACT_FOUND)
    _add_contact(spec, "bar_force", None, _CONTACT_FORCE)
    _add(spec, "hinge_stop", _SENSOR.mjSENS_JOINTLIMITFRC, _JOINT, "hinge")
    if turning:
        _add(spec, "handle_angle", _SENSOR.mjSENS_JOINTPOS, _JOINT, "handle")
    if structure.latched:
        _add(spec, "bolt", _SENSOR.mjSENS_JOINTPOS, _JOINT, "bolt")


def _add(
    spec: mujoco.MjSpec,
    name: str,
    kind: mujoco.mjtSensor,
    object_type: mujoco.mjtObj,
    target: str,
    reference: str | None = None,
) -> mujoco.MjsSensor:
    sensor = spec.add_sensor(name=name, type=kind, objtype=object_type, objname=target)
    if reference is not None:
        sensor.reftype = _SITE
        sensor.refname = reference
    return sensor


def _add_contact(
    spec: mujoco.MjSpec,
    name: str,
    other: tuple[mujoco.mjtObj, str] | None,
    fields: int,
) -> None:
    """Add a contact sensor of the handle: with a pad or finger, or with all at once."""
    sensor = spec.add_sensor(
        name=name,
        type=_SENSOR.mjSENS_CONTACT,
        objtype=other[0] if other else mujoco.mjtObj.mjOBJ_UNKNOWN,
        objname=other[1] if other else "",
        reftype=_GEOM,
        refname="handle_bar",
    )
    sensor.intprm[:3] = [fields, _NET_FORCE if other is None else 0, 1]
