"""The door as MuJoCo bodies: frame, leaf, hinge, closer and vertical bar handle."""

import math
from typing import Final

import mujoco
import numpy as np
from numpy.typing import NDArray

from gplfd_env.config import DoorConfig
from gplfd_env.placement import (
    grasp_in_door_frame,
    handle_position_w,
    quaternion,
    task_rotation_w,
)
from gplfd_env.room import INTANGIBLE, UNDRAWN
from gplfd_env.task import Base
from gplfd_env.variation import Placement

BAR_RADIUS: Final = 0.011
BAR_HALF_LENGTH: Final = 0.10
HINGE_RANGE: Final = math.radians(100.0)
"""Angle at which the leaf meets its stop [rad]."""

NOMINAL_MASS: Final = 12.0
"""Mass of the leaf in a compiled scene, before `set_door_physics` [kg]."""

_LEAF_HEIGHT: Final = 2.00
_LEAF_HALF_THICKNESS: Final = 0.02
_LEAF_BEYOND_HANDLE: Final = 0.08
_JAMB: Final = 0.05
_WOOD: Final = (0.78, 0.63, 0.46, 1.0)
_FRAME: Final = (0.88, 0.87, 0.85, 1.0)
_STEEL: Final = (0.55, 0.57, 0.60, 1.0)

Matrix = NDArray[np.float64]

_BOX: Final = mujoco.mjtGeom.mjGEOM_BOX
_CAPSULE: Final = mujoco.mjtGeom.mjGEOM_CAPSULE
_CYLINDER: Final = mujoco.mjtGeom.mjGEOM_CYLINDER


def add_door(
    spec: mujoco.MjSpec,
    door: DoorConfig,
    placement: Placement | None = None,
    base: Base = "fixed",
) -> None:
    """Add a door to a scene.

    Everything hangs on a ``door_frame`` body at the closed handle, and the numbers
    below read in its axes (x pull, y up, z left). Adds the site ``task_frame`` (fixed,
    where the hand takes hold), the joint ``hinge``, the geom ``handle_bar`` (the only
    one that collides), the site ``handle`` that moves with it, and the actuator
    ``door_closer``.

    Args:
        spec: The scene, with the robot in it; edited in place.
        door: Geometry and hinge.
        placement: Where the robot stands and grasps; without error by default.
        base: Whose stance before the door it is.
    """
    placement = Placement() if placement is None else placement
    frame = spec.worldbody.add_body(
        name="door_frame",
        pos=handle_position_w(door, placement, base),
        quat=quaternion(task_rotation_w(placement.base_yaw)),
    )
    grasp, turn = grasp_in_door_frame(placement)
    frame.add_site(name="task_frame", pos=grasp, quat=turn, **UNDRAWN)
    _add_frame(frame, door)
    leaf = frame.add_body(name="door", pos=[0.0, 0.0, -door.radius])
    leaf.add_joint(
        name="hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=[0, 1, 0],
        range=[0.0, HINGE_RANGE],
        limited=True,
        damping=[door.hinge_damping, 0, 0],
        frictionloss=door.hinge_friction,
        # With MuJoCo's soft defaults a hinge creeps at loads below its friction.
        solref_friction=[0.004, 1.0],
        solimp_friction=[0.999, 0.999, 0.001, 0.5, 2.0],
        armature=0.01,
    )
    _add_leaf(leaf, door)
    _add_handle(leaf, door, placement.grasp_height)
    _add_closer(spec, door)


def _add_frame(frame: mujoco.MjsBody, door: DoorConfig) -> None:
    floor = -door.handle_height
    hinge_edge, lock_edge = _leaf_edges(door)
    middle = floor + _LEAF_HEIGHT / 2
    for name, edge in (
        ("jamb_hinge", hinge_edge - _JAMB / 2),
        ("jamb_lock", lock_edge + _JAMB / 2),
    ):
        frame.add_geom(
            name=name,
            type=_BOX,
            pos=[-door.handle_standoff, middle, edge],
            size=[0.06, _LEAF_HEIGHT / 2, _JAMB / 2],
            rgba=_FRAME,
            **INTANGIBLE,
        )
    frame.add_geom(
        name="lintel",
        type=_BOX,
        pos=[
            -door.handle_standoff,
            floor + _LEAF_HEIGHT + _JAMB / 2,
            (hinge_edge + lock_edge) / 2,
        ],
        size=[0.06, _JAMB / 2, (lock_edge - hinge_edge) / 2 + _JAMB],
        rgba=_FRAME,
        **INTANGIBLE,
    )


def _leaf_edges(door: DoorConfig) -> tuple[float, float]:
    """Return where the leaf ends towards hinge and lock, task-frame z [m]."""
    return -door.radius - 0.01, _LEAF_BEYOND_HANDLE


def _add_leaf(leaf: mujoco.MjsBody, door: DoorConfig) -> None:
    hinge_edge, lock_edge = _leaf_edges(door)
    leaf.add_geom(
        name="leaf",
        type=_BOX,
        pos=[
            -door.handle_standoff,
            _LEAF_HEIGHT / 2 - door.handle_height,
            (hinge_edge + lock_edge) / 2 + door.radius,
        ],
        size=[_LEAF_HALF_THICKNESS, _LEAF_HEIGHT / 2, (lock_edge - hinge_edge) / 2],
        rgba=_WOOD,
        mass=door.panel_mass,
        **INTANGIBLE,
    )
    for name, height in (("hinge_upper", 0.55), ("hinge_lower", -0.55)):
        leaf.add_geom(
            name=name,
            type=_CYLINDER,
            fromto=[0, height - 0.05, 0, 0, height + 0.05, 0],
            size=[0.012, 0, 0],
            rgba=_STEEL,
            mass=0.0,
            **INTANGIBLE,
        )
        leaf.add_geom(
            name=f"{name}_arm",
            type=_BOX,
            pos=[-door.handle_standoff / 2, height, 0],
            size=[door.handle_standoff / 2, 0.03, 0.004],
            rgba=_STEEL,
            mass=0.0,
            **INTANGIBLE,
        )


def _add_handle(leaf: mujoco.MjsBody, door: DoorConfig, height: float) -> None:
    foot = -door.handle_standoff + _LEAF_HALF_THICKNESS
    # The only geom that touches the hand; its contact parameters rule (priority). A
    # short time constant keeps the creep of a sustained pull below a millimetre; it
    # must stay above two physics steps.
    leaf.add_geom(
        name="handle_bar",
        type=_CAPSULE,
        fromto=[0, -BAR_HALF_LENGTH, door.radius, 0, BAR_HALF_LENGTH, door.radius],
        size=[BAR_RADIUS, 0, 0],
        rgba=_STEEL,
        mass=0.3,
        contype=0,
        conaffinity=1,
        condim=4,
        friction=[1.0, 0.005, 0.0001],
        solref=[0.005, 1.0],
        priority=1,
    )
    for name, end in (
        ("handle_post_upper", BAR_HALF_LENGTH),
        ("handle_post_lower", -BAR_HALF_LENGTH),
    ):
        leaf.add_geom(
            name=name,
            type=_CYLINDER,
            fromto=[0.0, end, door.radius, foot, end, door.radius],
            size=[0.009, 0, 0],
            rgba=_STEEL,
            mass=0.05,
            **INTANGIBLE,
        )
    leaf.add_site(name="handle", pos=[0.0, height, door.radius], **UNDRAWN)


def _add_closer(spec: mujoco.MjSpec, door: DoorConfig) -> None:
    # A pure bias force, -(preload + stiffness * angle): a spring's reference angle
    # could not give a preload without a stiffness. Its control input has no gain.
    closer = spec.add_actuator(
        name="door_closer", target="hinge", trntype=mujoco.mjtTrn.mjTRN_JOINT
    )
    closer.gaintype = mujoco.mjtGain.mjGAIN_FIXED
    closer.gainprm[0] = 0.0
    closer.biastype = mujoco.mjtBias.mjBIAS_AFFINE
    closer.biasprm[0] = -door.closer_preload
    closer.biasprm[1] = -door.closer_stiffness


def set_hinge(model: mujoco.MjModel, stop: float, friction: float) -> bool:
    """Set where a door stops and how its hinge rubs; return whether that was a change.

    Args:
        model: The scene; edited in place.
        stop: Angle at which the leaf meets its stop [rad].
        friction: Coulomb friction [N m].
    """
    joint = model.joint("hinge")
    dof = int(joint.dofadr[0])
    now = model.jnt_range[joint.id, 1], model.dof_frictionloss[dof]
    if now == (stop, friction):
        return False
    model.jnt_range[joint.id, 1], model.dof_frictionloss[dof] = stop, friction
    return True


def set_door_physics(
    model: mujoco.MjModel, data: mujoco.MjData, door: DoorConfig
) -> None:
    """Give a compiled door, of `NOMINAL_MASS`, its mass, hinge and closer.

    Args:
        model: The scene; edited in place.
        data: Of the same model; left in its reference configuration.
        door: Of the geometry that the scene was compiled with.
    """
    hinge = int(model.joint("hinge").dofadr[0])
    model.dof_frictionloss[hinge] = door.hinge_friction
    model.dof_damping[hinge] = door.hinge_damping
    closer = model.actuator("door_closer").id
    model.actuator_biasprm[closer, :2] = -door.closer_preload, -door.closer_stiffness
    _add_leaf_mass(model, door.panel_mass - NOMINAL_MASS)
    mujoco.mj_setConst(model, data)


def _add_leaf_mass(model: mujoco.MjModel, mass: float) -> None:
    """Add mass to the leaf: the body's mass, centre and inertia by Steiner's theorem.

    Inertias are collected about the body's origin, (3, 3) [kg m²].
    """
    body, leaf = model.body("door").id, model.geom("leaf").id
    centre, size = model.geom_pos[leaf], model.geom_size[leaf]
    solid = np.diag(size @ size - size**2) / 3.0
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    before, com = float(model.body_mass[body]), model.body_ipos[body].copy()
    inertia = (
        axes @ np.diag(model.body_inertia[body]) @ axes.T
        + before * _steiner(com)
        + mass * (solid + _steiner(centre))
    )
    total = before + mass
    com = (before * com + mass * centre) / total
    principal, turn, quaternion = np.zeros(3), np.zeros(9), np.zeros(4)
    about_com = inertia - total * _steiner(com)
    mujoco.mju_eig3(principal, turn, quaternion, about_com.reshape(9))
    model.body_mass[body], model.body_ipos[body] = total, com
    model.body_inertia[body], model.body_iquat[body] = principal, quaternion


def _steiner(offset: Matrix) -> Matrix:
    """Return the inertia of a unit mass at an offset, |c|² 1 - c cᵀ [m²]."""
    return np.asarray((offset @ offset) * np.eye(3) - np.outer(offset, offset))
