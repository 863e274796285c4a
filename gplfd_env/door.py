"""The door as MuJoCo bodies: frame, leaf, hinge, closer and vertical bar handle."""

from __future__ import annotations

import math
from typing import Final

import mujoco

from gplfd_env.config import DoorConfig
from gplfd_env.placement import handle_position_w, quaternion, task_rotation_w

BAR_RADIUS: Final = 0.011
BAR_HALF_LENGTH: Final = 0.10
HINGE_RANGE: Final = math.radians(100.0)
"""Angle at which the leaf meets its stop [rad]."""

_LEAF_HEIGHT: Final = 2.00
_LEAF_HALF_THICKNESS: Final = 0.02
_LEAF_BEYOND_HANDLE: Final = 0.08
_JAMB: Final = 0.05
_WOOD: Final = (0.78, 0.63, 0.46, 1.0)
_FRAME: Final = (0.88, 0.87, 0.85, 1.0)
_STEEL: Final = (0.55, 0.57, 0.60, 1.0)

_BOX: Final = mujoco.mjtGeom.mjGEOM_BOX
_CAPSULE: Final = mujoco.mjtGeom.mjGEOM_CAPSULE
_CYLINDER: Final = mujoco.mjtGeom.mjGEOM_CYLINDER


def add_door(spec: mujoco.MjSpec, door: DoorConfig) -> None:
    """Add a door to a scene.

    Everything hangs on a ``door_frame`` body whose frame is the task frame, so the
    numbers below read in task coordinates (x pull, y up, z left). Adds the site
    ``task_frame`` (fixed, at the closed handle), the joint ``hinge``, the geom
    ``handle_bar`` (the only one that collides), the site ``handle`` that moves with
    it, and the actuator ``door_closer``.

    Args:
        spec: The scene, with the robot in it; edited in place.
        door: Geometry and hinge.
    """
    frame = spec.worldbody.add_body(
        name="door_frame",
        pos=handle_position_w(door),
        quat=quaternion(task_rotation_w()),
    )
    frame.add_site(name="task_frame", size=[0.005] * 3, rgba=[0, 0, 0, 0])
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
    _add_handle(leaf, door)
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
            contype=0,
            conaffinity=0,
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
        contype=0,
        conaffinity=0,
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
        contype=0,
        conaffinity=0,
    )
    for name, height in (("hinge_upper", 0.55), ("hinge_lower", -0.55)):
        leaf.add_geom(
            name=name,
            type=_CYLINDER,
            fromto=[0, height - 0.05, 0, 0, height + 0.05, 0],
            size=[0.012, 0, 0],
            rgba=_STEEL,
            mass=0.0,
            contype=0,
            conaffinity=0,
        )
        leaf.add_geom(
            name=f"{name}_arm",
            type=_BOX,
            pos=[-door.handle_standoff / 2, height, 0],
            size=[door.handle_standoff / 2, 0.03, 0.004],
            rgba=_STEEL,
            mass=0.0,
            contype=0,
            conaffinity=0,
        )


def _add_handle(leaf: mujoco.MjsBody, door: DoorConfig) -> None:
    handle = (0.0, 0.0, door.radius)
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
    for name, height in (
        ("handle_post_upper", BAR_HALF_LENGTH),
        ("handle_post_lower", -BAR_HALF_LENGTH),
    ):
        leaf.add_geom(
            name=name,
            type=_CYLINDER,
            fromto=[
                *(0.0, height, door.radius),
                *(-door.handle_standoff + _LEAF_HALF_THICKNESS, height, door.radius),
            ],
            size=[0.009, 0, 0],
            rgba=_STEEL,
            mass=0.05,
            contype=0,
            conaffinity=0,
        )
    leaf.add_site(name="handle", pos=handle, size=[0.005] * 3, rgba=[0, 0, 0, 0])


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
