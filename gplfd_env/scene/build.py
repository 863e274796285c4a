"""Compilation of a door configuration to a MuJoCo model with a settled grasp.

A model is compiled once per robot and `Structure`; for another door only the fields in
which scenes differ are overwritten. A new geometry needs a compilation and a settled
grasp (4 ms) and is cached. Mass, hinge and closer are written directly.
"""

import dataclasses
from collections.abc import Mapping, Sequence
from functools import lru_cache
from types import MappingProxyType
from typing import Any, Final

import mujoco

from gplfd_env.conventions.constants import Array, Control
from gplfd_env.doors.config import MOTIONS, DoorConfig, held_radius
from gplfd_env.doors.variation import Placement, Standoff
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.robot.model import (
    GRIPS,
    ROTATION_SERVOS,
    SIDES,
    TRANSLATION_SERVOS,
    WRENCH_LIMITS,
    Hold,
    add_collisions,
    add_walls,
    load_robot,
)
from gplfd_env.robot.placement import (
    arm_addresses,
    check_reach,
    quaternion,
    solve_closed_posture,
    solve_standoff_posture,
    standoff_pose,
    task_in_door_frame,
)
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.arena import add_arena
from gplfd_env.scene.door import (
    NOMINAL_MASS,
    Structure,
    add_door,
    set_door_physics,
    structure_of,
)

GRASP_KEY: Final = 0
"""Index of the keyframe "grasp": door closed, handle held, everything at rest; with a
standoff, the open hand is in front of the handle."""

SCENE_FIELDS: Final = (
    "actuator_acc0", "actuator_length0", "body_inertia", "body_invweight0",
    "body_ipos", "body_iquat", "body_mass", "body_pos", "body_quat",
    "body_subtreemass", "bvh_aabb", "cam_mat0", "cam_pos", "cam_pos0", "cam_poscom0",
    "cam_quat", "dof_M0", "dof_invweight0", "dof_length", "eq_data", "geom_aabb",
    "geom_pos", "geom_quat", "geom_rbound", "geom_size", "jnt_axis", "jnt_pos",
    "jnt_range", "key_ctrl", "key_qpos", "light_pos0", "light_poscom0", "qpos_spring",
    "site_pos", "site_quat", "tendon_invweight0", "tendon_length0", "tendon_range",
    "wrap_prm",
)  # fmt: skip
"""Fields of the model in which the geometry of two scenes can differ."""

DOOR_FIELDS: Final = (
    *SCENE_FIELDS, "actuator_biasprm", "body_sameframe", "dof_damping",
    "dof_frictionloss", "geom_rgba", "geom_sameframe", "jnt_stiffness",
    "site_sameframe", "tendon_frictionloss", "tendon_lengthspring", "tendon_rgba",
    "tendon_solref_lim", "tendon_stiffness", "tendon_width",
)  # fmt: skip
"""All fields in which the models of two scenes of one `Structure` can differ."""

_SITE: Final = mujoco.mjtObj.mjOBJ_SITE
_JOINT: Final = mujoco.mjtObj.mjOBJ_JOINT
_CONTACT_FOUND: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FOUND)
_CONTACT_FORCE: Final = 1 << int(mujoco.mjtConDataField.mjCONDATA_FORCE)
_NET_FORCE: Final = 3
_PLAIN: Final = DoorConfig(panel_mass=NOMINAL_MASS)
# Fields of a door and its parts that `set_door_physics` writes into a scene.
_WRITTEN_LATER: Final = {
    "": "panel_mass hinge_friction hinge_damping stiction seal seal_angle closer",
    "lockset": "handle_preload handle_stiffness bolt_preload bolt_stiffness",
    "mechanism": "strut_stiffness strut_dead_angle roller_friction",
}
_SETTLING_TIME: Final = 0.4
# Penetration of the bar's soft contact under the fingers' 16 N [m].
_BAR_INDENTATION: Final = 7.3e-5


def build_spec(
    door: DoorConfig,
    grasp: Hold,
    placement: Placement,
    control: Control,
    structure: Structure,
    robot: RobotConfig,
) -> mujoco.MjSpec:
    """Assemble a scene; a ``"weld"`` adds a rigid joint between hand and handle."""
    spec = load_robot(control, door, robot)
    add_arena(spec, door, robot)
    add_door(spec, door, placement, structure, robot)
    _add_sensors(spec, structure, control, robot, grasp)
    add_walls(spec, door, robot.base)
    if robot.base == "mobile":
        add_collisions(spec, robot)
    spec.add_key(name="grasp")
    if grasp == "weld":
        kind = {"type": mujoco.mjtEq.mjEQ_WELD, "objtype": mujoco.mjtObj.mjOBJ_SITE}
        ends = {"name1": "hand", "name2": "handle", "solref": [0.01, 1.0]}
        spec.add_equality(name="grasp_weld", **kind, **ends)
    return spec


def build_scene(
    door: DoorConfig,
    grasp: Hold = "contact",
    *,
    placement: Placement | None = None,
    standoff: Standoff | None = None,
    control: Control = "pose",
    robot: RobotConfig = TIAGO_LIKE,
) -> mujoco.MjModel:
    """Return a model of a scene with a settled grasp; callers may edit it.

    Its keyframe `GRASP_KEY` is the state after a reset: the hand holds the handle, or
    is in front of it at the `standoff`. Raises a ValueError if that is out of reach.
    """
    model = _template(structure_of(door), grasp, control, robot).__copy__()
    data = mujoco.MjData(model)
    load_scene(model, data, door, grasp, placement, standoff, control, robot)
    return model


def load_scene(
    model: mujoco.MjModel,
    data: mujoco.MjData,
    door: DoorConfig,
    grasp: Hold = "contact",
    placement: Placement | None = None,
    standoff: Standoff | None = None,
    control: Control = "pose",
    robot: RobotConfig = TIAGO_LIKE,
) -> None:
    """Write another door of the same structure into a scene's model, in place.

    The result equals that of `build_scene` bit for bit. If the handle is out of reach,
    raises a ValueError and leaves the model unchanged. Reset `data` to the keyframe
    afterwards.
    """
    check_reach(door, robot, "grasped" if standoff is None else "approach")
    placement = Placement() if placement is None else placement
    geometry, structure = _nominal(door), structure_of(door)
    settled = _settled(geometry, structure, placement, standoff, grasp, control, robot)
    for name, values in settled.items():
        getattr(model, name)[...] = values
    set_door_physics(model, data, door)


def _nominal(door: DoorConfig) -> DoorConfig:
    """Return a door of the same geometry, with defaults of what is written later."""
    fields = {name: getattr(_PLAIN, name) for name in _WRITTEN_LATER[""].split()}
    for part in ("lockset", "mechanism"):
        names = _WRITTEN_LATER[part].split()
        plain = {name: getattr(getattr(_PLAIN, part), name) for name in names}
        fields[part] = dataclasses.replace(getattr(door, part), **plain)
    return dataclasses.replace(door, **fields)


@lru_cache(maxsize=32)
def _template(
    structure: Structure, grasp: Hold, control: Control, robot: RobotConfig
) -> mujoco.MjModel:
    door = DoorConfig(
        handle=structure.handle,
        latch="spring" if structure.latched else "none",
        motion=structure.motion,
        hinge_side="bottom" if MOTIONS[structure.motion].level else "right",
        swing="push" if structure.handle == "touch-bar" else "pull",
        panel_mass=NOMINAL_MASS,
    )
    return build_spec(door, grasp, Placement(), control, structure, robot).compile()


@lru_cache(maxsize=128)
def _settled(
    geometry: DoorConfig,
    structure: Structure,
    placement: Placement,
    standoff: Standoff | None,
    grasp: Hold,
    control: Control,
    robot: RobotConfig,
) -> Mapping[str, Array]:
    """Compile a scene, settle the grasp and return its `SCENE_FIELDS`."""
    true = placement.true
    model = build_spec(geometry, grasp, true, control, structure, robot).compile()
    data = mujoco.MjData(model)
    configuration = solve_closed_posture(model, data, geometry, placement, robot)
    # Close the fingers on the handle and store the state at rest as the keyframe.
    mujoco.mj_resetData(model, data)
    data.qpos[:] = configuration
    arm = arm_addresses(model, robot)
    model.qpos_spring[arm] = data.qpos[arm]
    for finger in robot.fingers:
        data.joint(finger).qpos = held_radius(geometry.handle) - _BAR_INDENTATION
    data.actuator("torso_hold").ctrl = data.joint(robot.lift).qpos
    mujoco.mj_step(model, data, nstep=round(_SETTLING_TIME / model.opt.timestep))
    model.key_qpos[GRASP_KEY] = data.qpos
    model.key_qvel[GRASP_KEY] = 0.0
    model.key_ctrl[GRASP_KEY] = data.ctrl
    if standoff is not None:
        # With a standoff: the open hand at a pose in front of the believed handle.
        if any(placement.belief):
            position, axes = task_in_door_frame(geometry, placement, robot)
            frame = model.site("task_frame")
            frame.pos[:], frame.quat[:] = position, quaternion(axes)
            # It was compiled at its body's own frame, whose pose would be taken.
            model.site_sameframe[frame.id] = 0
        pose = standoff_pose(geometry, standoff, robot)
        mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
        mujoco.mj_kinematics(model, data)
        solve_standoff_posture(model, data, robot, pose)
        for finger, grip in zip(robot.fingers, GRIPS, strict=True):
            data.joint(finger).qpos = robot.finger_stroke
            data.actuator(grip).ctrl = robot.finger_stroke
        data.ctrl[:6] = pose
        model.key_qpos[GRASP_KEY] = data.qpos
        model.key_ctrl[GRASP_KEY] = data.ctrl
    return MappingProxyType({n: getattr(model, n).copy() for n in SCENE_FIELDS})


def _add_sensors(
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
        name: str, kind: str, of: Any, target: str, frame: str = "", **more: Any
    ) -> None:
        type_of = getattr(mujoco.mjtSensor, f"mjSENS_{kind}")
        more |= {"reftype": _SITE, "refname": frame} if frame else {}
        spec.add_sensor(name=name, type=type_of, objtype=of, objname=target, **more)

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
    add("wrist_force", "FORCE", _SITE, "wrist_ft", cutoff=WRENCH_LIMITS[0])
    add("wrist_torque", "TORQUE", _SITE, "wrist_ft", cutoff=WRENCH_LIMITS[1])
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
    held: Any = {"reftype": mujoco.mjtObj.mjOBJ_GEOM, "refname": "handle_bar"}
    for side, finger in zip(SIDES, robot.fingers, strict=True):
        touching = mujoco.mjtObj.mjOBJ_GEOM, f"{side}_finger_pad"
        if turning:
            touching = mujoco.mjtObj.mjOBJ_BODY, spec.joint(finger).parent.name
        touched = [_CONTACT_FOUND, 0, 1]
        add(f"{side}_pad_contact", "CONTACT", *touching, intprm=touched, **held)
    anything, force = mujoco.mjtObj.mjOBJ_UNKNOWN, [_CONTACT_FORCE, _NET_FORCE, 1]
    add("bar_force", "CONTACT", anything, "", intprm=force, **held)
    add("hinge_stop", "JOINTLIMITFRC", _JOINT, "hinge")
    if turning:
        add("handle_angle", "JOINTPOS", _JOINT, "handle")
    if structure.latched:
        add("bolt", "JOINTPOS", _JOINT, "bolt")
