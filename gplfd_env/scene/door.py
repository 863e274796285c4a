"""The door as MuJoCo bodies: frame, leaf, hinge, mounted parts, and what is only seen.

Visual-only geoms (casing, panels, far handle, closer) are in the geom group `GROUP` and
have neither mass nor contact.
"""

import math
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
from mujoco import MjData, MjModel, MjsBody, MjSpec

from gplfd_env.conventions.constants import DRY_FRICTION, UNDRAWN, Array
from gplfd_env.doors.config import (
    BAR_RADIUS,
    KNOB_RADIUS,
    OVERHANG,
    DoorConfig,
    Handle,
    Motion,
)
from gplfd_env.doors.geometry import ROCKERS
from gplfd_env.doors.motion import Link, end_angle, has_tendons, links_of
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.mobile_base import HARD_STOP, SOFT_STOP
from gplfd_env.robot.placement import (
    grasp_height,
    handle_position_w,
    quaternion,
    task_in_door_frame,
    task_rotation_w,
)
from gplfd_env.scene.arena import DOOR_HEIGHT, FLAP_WIDTH
from gplfd_env.scene.closer import add_closer, set_closer
from gplfd_env.scene.handle import (
    add_bar,
    add_latch,
    add_rocker,
    add_turning_handle,
    set_spring,
)
from gplfd_env.scene.shapes import STEEL, add_box, add_rod

NOMINAL_MASS: Final = 12.0
"""Mass of the leaf in a compiled scene, before `set_door_physics` [kg]."""

_JAMB: Final = 0.05
_GAP: Final = 0.004  # Gap between a leaf and the parts beside it [m].
_WOOD: Final = (0.78, 0.63, 0.46, 1.0)
_FRAME: Final = (0.88, 0.87, 0.85, 1.0)


class Structure(NamedTuple):
    """Parts of a door. Scenes with the same structure differ only in numbers."""

    handle: Handle
    latched: bool
    closer: bool
    motion: Motion
    rollers: bool


def structure_of(door: DoorConfig) -> Structure:
    """Return the structure of a door."""
    latched, rollers = door.latch != "none", door.mechanism.roller_friction > 0.0
    return Structure(door.handle, latched, has_tendons(door), door.motion, rollers)


def add_door(
    spec: MjSpec,
    door: DoorConfig,
    placement: Placement,
    structure: Structure,
    robot: RobotConfig,
) -> None:
    """Add a door to a scene.

    All parts are children of a body ``door_frame`` at the grasped point of the closed
    handle; numbers below are in its axes (x pull, y up, z left). Adds the site
    ``task_frame`` (fixed, at the grasped point), the joint ``hinge``, the geom
    ``handle_bar`` (the only one that touches the hand), the site ``handle`` that moves
    with it, for a turning handle the site ``leaf_axes`` that does not turn with it, the
    latch, and the actuator ``door_closer``.
    """
    axes = task_rotation_w(door, robot, placement.base_yaw)
    middle = handle_position_w(door, placement, robot)
    turn = quaternion(axes)
    frame = spec.worldbody.add_body(name="door_frame", pos=middle, quat=turn)
    grasp, axes = task_in_door_frame(door, placement, robot)
    frame.add_site(name="task_frame", pos=grasp, quat=quaternion(axes), **UNDRAWN)
    # Edges of the leaf at hinge and lock, relative to the handle's axis [m].
    edges = -door.radius - door.overhang, door.leaf.backset
    hinge_z, lock_z = _edges(door)
    # Jambs and lintel around the leaf; a sliding leaf is in front of the wall.
    upright, out = [0.06, DOOR_HEIGHT / 2, _JAMB / 2], door.hinge_sign * _JAMB / 2
    level = [0.06, _JAMB / 2, abs(lock_z - hinge_z) / 2 + _JAMB]
    halfway, above = DOOR_HEIGHT / 2 - door.handle_height, _top(door) + _JAMB / 2
    x = -door.leaf.handle_standoff
    if door.motion == "sliding":
        x -= upright[0] + door.leaf.thickness / 2 + _GAP
    for name, y, z, size in (
        ("jamb_hinge", halfway, hinge_z - out, upright),
        ("jamb_lock", halfway, lock_z + out, upright),
        ("lintel", above, (hinge_z + lock_z) / 2, level),
    ):
        add_box(frame, name, [x, y, z], size, _FRAME, mass=math.nan)

    leaf = _add_joints(spec, frame, door, robot)
    if door.level:
        _add_flap(frame, leaf, door)
    elif door.motion == "folding":
        inner = spec.body("inner_door")
        _add_leaf(inner, "inner_leaf", door, (edges[0], -door.fold_distance))
        _add_hinges(inner, door)
        _add_leaf(leaf, "leaf", door, (-door.fold_distance, edges[1]))
        if structure.rollers:
            _add_rollers(spec, frame, leaf, door)
    else:
        _add_leaf(leaf, "leaf", door, edges)
        if door.motion in ("sliding", "parallel-sliding"):
            # The rail on which the leaf hangs, above and beside the opening.
            far = hinge_z - door.hinge_sign * door.clear_width
            place = [-door.leaf.handle_standoff, _top(door) + 0.025, (far + lock_z) / 2]
            size = [door.leaf.thickness, 0.02, abs(lock_z - far) / 2]
            add_box(frame, "rail", place, size, STEEL)
        else:
            _add_hinges(leaf, door)
    foot = -door.leaf.handle_standoff + door.leaf.thickness / 2
    if door.handle == "bar":
        add_bar(leaf, door, foot, grasp_height(door, placement))
    elif door.handle in ROCKERS:
        add_rocker(leaf, door, foot)
    else:
        add_turning_handle(leaf, door, foot)
    if structure.latched:
        add_latch(spec, frame, leaf, door, lock_z, robot.base)
    add_closer(spec, door, tendons=structure.closer)

    _add_visuals(spec, frame, leaf, door, structure)


def _add_joints(
    spec: MjSpec, frame: MjsBody, door: DoorConfig, robot: RobotConfig
) -> MjsBody:
    """Add the joints between frame and leaf; return the leaf's body.

    The coordinate of the joint ``hinge`` is φ of `gplfd_env.doors.motion`, if need be
    on a body without a shape. Equality constraints couple the other joints to it.
    """
    links, leaf = links_of(door), frame
    origin = np.array([0.0, 0.0, -door.hinge_sign * door.hand_radius])
    if door.level:
        origin = np.array(links[-1].anchor)
    if door.motion == "folding":
        leaf = leaf.add_body(name="inner_door", pos=origin)
        _add_joint(spec, leaf, links[0], origin)
        leaf, links = leaf.add_body(name="door"), links[1:]
    else:
        leaf = leaf.add_body(name="door", pos=origin)
    bearer, axis = leaf, links[-1].axis
    if links[-1].name != "hinge":
        bearer = frame.add_body(name="coordinate", mass=1e-3, inertia=3 * [1e-6])
        axis = (0.0, door.hinge_sign, 0.0)
    for link in links:
        if link.name != "hinge":
            _add_joint(spec, leaf, link, origin)
    hinge = bearer.add_joint(
        name="hinge",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=axis,
        range=[0.0, end_angle(door)],
        limited=True,
        damping=[door.hinge_damping + door.closer.damping, 0, 0],
        frictionloss=door.friction,
        armature=0.01,
        **DRY_FRICTION,
    )
    if robot.base == "mobile":
        # The limit of the hinge itself, which disturbances move, stays softer.
        hinge.solref_limit = SOFT_STOP
        stop = {"range": [0.0, end_angle(door)], "solref_limit": HARD_STOP}
        end = spec.add_tendon(name="hinge_end", limited=True, **stop)
        end.wrap_joint("hinge", 1.0)
    return leaf


def _add_joint(spec: MjSpec, body: MjsBody, link: Link, origin: Array) -> None:
    """Add a joint to a body at an origin, door frame [m]; couple it to ``hinge``."""
    kind, place = mujoco.mjtJoint.mjJNT_HINGE, np.array(link.anchor) - origin
    if link.slides:
        kind, place = mujoco.mjtJoint.mjJNT_SLIDE, np.zeros(3)
    body.add_joint(name=link.name, type=kind, pos=place, axis=link.axis)
    joints = {"type": mujoco.mjtEq.mjEQ_JOINT, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
    stiff = {"solref": [0.004, 1.0], "solimp": [0.999, 0.9999, 0.001, 0.5, 2.0]}
    names = {"name": link.name, "name1": link.name, "name2": "hinge"}
    tie = spec.add_equality(**names, **joints, **stiff)
    tie.data[: len(link.gains) + 1] = 0.0, *link.gains


def _add_leaf(
    body: MjsBody, name: str, door: DoorConfig, edges: tuple[float, float]
) -> None:
    """Add a leaf between its edges at hinge and lock, from the handle's axis [m]."""
    hinge, lock = edges
    whole = door.leaf.backset + door.radius + door.overhang
    share = (lock - hinge) / whole if door.motion == "folding" else 1.0
    y = DOOR_HEIGHT / 2 - door.handle_height
    z = door.hinge_sign * ((hinge + lock) / 2 + door.radius)
    size = [door.leaf.thickness / 2, DOOR_HEIGHT / 2, (lock - hinge) / 2]
    place = [-door.leaf.handle_standoff, y, z]
    add_box(body, name, place, size, _WOOD, mass=share * door.panel_mass)


def _add_hinges(leaf: MjsBody, door: DoorConfig) -> None:
    """Add the two visible hinges of a leaf."""
    x = door.leaf.handle_standoff / 2
    for name, y in (("hinge_upper", 0.55), ("hinge_lower", -0.55)):
        add_rod(leaf, name, [0, y - 0.05, 0, 0, y + 0.05, 0], 0.012)
        add_box(leaf, f"{name}_arm", [-x, y, 0], [x, 0.03, 0.004], STEEL)


def _add_rollers(spec: MjSpec, frame: MjsBody, leaf: MjsBody, door: DoorConfig) -> None:
    """Add the friction of the guided edge on its rail, as a tendon from the jamb."""
    friction = door.mechanism.roller_friction
    rail = spec.add_tendon(name="rollers", frictionloss=friction, **DRY_FRICTION)
    for name, body, z in (
        ("jamb_pivot", frame, -door.radius),
        ("rollers", leaf, door.radius + door.leaf.backset),
    ):
        body.add_site(name=name, pos=[0.0, 0.0, door.hinge_sign * z], **UNDRAWN)
        rail.wrap_site(name)


def _add_flap(frame: MjsBody, leaf: MjsBody, door: DoorConfig) -> None:
    """Add a leaf with a level hinge, and the front of its cabinet below and above."""
    to_handle = -float(leaf.pos[1]) / door.radius
    edge, x = door.radius + door.leaf.backset, -door.leaf.handle_standoff
    thick, high, wide = door.leaf.thickness / 2, (edge + OVERHANG) / 2, FLAP_WIDTH / 2
    y = to_handle * (edge - OVERHANG) / 2
    place, size = [x, y, 0.0], [thick, high, wide]
    add_box(leaf, "leaf", place, size, _WOOD, mass=door.panel_mass)
    middle, floor = float(leaf.pos[1]) + y, -door.handle_height
    for name, bottom, top in (
        ("front_below", floor, middle - high - _GAP),
        ("front_above", middle + high + _GAP, floor + DOOR_HEIGHT),
    ):
        size = [thick, max((top - bottom) / 2, 0.001), wide]
        add_box(frame, name, [x, (bottom + top) / 2, 0.0], size, _FRAME)


def set_hinge(model: MjModel, stop: float, friction: float) -> bool:
    """Set stop [rad] and friction [N m] of the hinge; return whether they changed."""
    joint = model.joint("hinge")
    dof = int(joint.dofadr[0])
    now = model.jnt_range[joint.id, 1], model.dof_frictionloss[dof]
    if now == (stop, friction):
        return False
    model.jnt_range[joint.id, 1], model.dof_frictionloss[dof] = stop, friction
    return True


def set_door_physics(model: MjModel, data: MjData, door: DoorConfig) -> None:
    """Set mass, hinge, springs and closer of a door compiled with `NOMINAL_MASS`."""
    hinge = int(model.joint("hinge").dofadr[0])
    model.dof_frictionloss[hinge] = door.friction
    model.dof_damping[hinge] = door.hinge_damping + door.closer.damping
    if door.handle != "bar":
        set_spring(model, "handle", *door.handle_spring)
    if door.latch == "spring":
        bolt = door.lockset
        set_spring(model, "bolt", bolt.bolt_preload, bolt.bolt_stiffness)
    more = door.panel_mass - NOMINAL_MASS
    if door.motion == "folding":
        width = door.leaf.backset + door.radius + door.overhang
        outer = more * (door.leaf.backset + door.fold_distance) / width
        _add_leaf_mass(model, "door", "leaf", outer)
        _add_leaf_mass(model, "inner_door", "inner_leaf", more - outer)
    else:
        _add_leaf_mass(model, "door", "leaf", more)
    mujoco.mj_setConst(model, data)
    set_closer(model, door)
    if has_tendons(door):
        opacity, radius = _looks_of_closer(door)
        for part in _CLOSER_PARTS:
            model.geom_rgba[model.geom(part).id, 3] = opacity
        arm = model.tendon(CLOSER_ARM).id
        model.tendon_rgba[arm, 3], model.tendon_width[arm] = opacity, radius
    rolling = door.mechanism.roller_friction
    if rolling > 0.0:
        model.tendon_frictionloss[model.tendon("rollers").id] = rolling


def _add_leaf_mass(model: MjModel, of: str, geom: str, mass: float) -> None:
    """Add mass to a leaf: the body's mass, centre and inertia (Steiner's theorem)."""
    body, leaf = model.body(of).id, model.geom(geom).id
    centre, size = model.geom_pos[leaf], model.geom_size[leaf]
    solid = np.diag(size @ size - size**2) / 3.0
    rotation = np.zeros(9)
    mujoco.mju_quat2Mat(rotation, model.body_iquat[body])
    axes = rotation.reshape(3, 3)
    before, com = float(model.body_mass[body]), model.body_ipos[body].copy()
    inertia = axes @ np.diag(model.body_inertia[body]) @ axes.T + before * _steiner(com)
    inertia = inertia + mass * (solid + _steiner(centre))
    total = before + mass
    com = (before * com + mass * centre) / total
    principal, turn, quaternion = np.zeros(3), np.zeros(9), np.zeros(4)
    about_com = inertia - total * _steiner(com)
    mujoco.mju_eig3(principal, turn, quaternion, about_com.reshape(9))
    model.body_mass[body], model.body_ipos[body] = total, com
    model.body_inertia[body], model.body_iquat[body] = principal, quaternion


def _steiner(offset: Array) -> Array:
    """Return the inertia of a unit mass at an offset, |c|² 1 - c cᵀ [m²]."""
    return np.asarray((offset @ offset) * np.eye(3) - np.outer(offset, offset))


GROUP: Final = 2
"""Visual-only geom group."""
CLOSER_ARM: Final = "closer_arm"
"""Tendon that joins the geoms of a closer."""

_CLOSER_PARTS: Final = ("closer_box", "closer_shoe")
_PAINT: Final = (0.96, 0.96, 0.94, 1.0)
_PANEL: Final = (0.72, 0.57, 0.40, 1.0)
_BRASS: Final = (0.72, 0.64, 0.42, 1.0)
_ALUMINIUM: Final = (0.66, 0.68, 0.70)


def _add_visuals(
    spec: MjSpec, frame: MjsBody, leaf: MjsBody, door: DoorConfig, structure: Structure
) -> None:
    """Add closer, lock, casing around the opening, raised panels, and far handle."""
    side, x, top = door.hinge_sign, -door.leaf.handle_standoff, _top(door)
    free_edge, reach = door.radius + door.leaf.backset, side * door.radius
    thick, floor = door.leaf.thickness / 2.0, -door.handle_height
    seen: Any = {"group": GROUP}
    if structure.closer:
        opacity, radius = _looks_of_closer(door)
        colour, out, above = (*_ALUMINIUM, opacity), x + thick + 0.022, top - 0.065
        box, size = [out, above, side * 0.20], [0.022, 0.027, 0.125]
        add_box(leaf, _CLOSER_PARTS[0], box, size, colour, **seen)
        place = [out, top - 0.03, side * 0.24]
        leaf.add_site(name="closer_spindle", pos=place, **UNDRAWN)
        shoe = [0.084 + x, top + 0.03, side * (0.42 - door.hand_radius)]
        add_box(frame, _CLOSER_PARTS[1], shoe, [0.012, 0.012, 0.03], colour, **seen)
        frame.add_site(name="closer_foot", pos=shoe, **UNDRAWN)
        # Otherwise the resting length would be that of the compiled door.
        looks = {"width": radius, "rgba": colour, "springlength": [0.0, 0.0]}
        arm = spec.add_tendon(name=CLOSER_ARM, **looks)
        arm.wrap_site("closer_spindle")
        arm.wrap_site("closer_foot")
    if structure.latched:
        plate, size = [x, 0.0, side * free_edge], [0.010, 0.10, 0.0008]
        add_box(leaf, "lock_plate", plate, size, STEEL, **seen)
    if door.handle == "bar":
        return
    wide, gap = 0.035, 0.013
    hinge, lock = _edges(door)
    hinge, lock = hinge - side * (gap + wide), lock + side * (gap + wide)
    across = abs(lock - hinge) / 2.0 + wide
    for name, y, z, high, half in (
        ("casing_hinge", (floor + top) / 2.0, hinge, (top - floor) / 2.0, wide),
        ("casing_lock", (floor + top) / 2.0, lock, (top - floor) / 2.0, wide),
        ("casing_top", top + gap + wide, (hinge + lock) / 2.0, wide, across),
    ):
        add_box(frame, name, [x, y, z], [0.072, high, half], _PAINT, **seen)
    width = door.leaf.backset + door.radius + door.overhang
    z = side * (free_edge - width / 2.0)
    for name, low, upper in (
        ("panel_lower", floor + 0.20, floor + 0.84),
        ("panel_upper", floor + 1.02, floor + 1.84),
    ):
        size = [thick + 0.004, (upper - low) / 2.0, width / 2.0 - 0.11]
        add_box(leaf, name, [x, (low + upper) / 2.0, z], size, _PANEL, **seen)
    ends = [x - (thick + 0.006), -0.09, reach, x + (thick + 0.006), -0.09, reach]
    add_rod(leaf, "lock_cylinder", ends, 0.014, _BRASS, **seen)
    if door.handle not in ("lever", "knob"):
        return
    far, foot, handle = 2.0 * x, x - thick, spec.body("handle")
    add_rod(handle, "far_neck", [foot, 0.0, 0.0, far, 0.0, 0.0], 0.009, **seen)
    if door.handle == "lever":
        end = -side * (door.lockset.handle_length - BAR_RADIUS)
        kind, ends = mujoco.mjtGeom.mjGEOM_CAPSULE, [far, 0.0, 0.0, far, 0.0, end]
        add_rod(handle, "far_handle", ends, BAR_RADIUS, type=kind, **seen)
    else:
        ball, size = mujoco.mjtGeom.mjGEOM_SPHERE, [KNOB_RADIUS, 0, 0]
        add_box(handle, "far_handle", [far, 0, 0], size, STEEL, type=ball, **seen)
    rose = [foot, 0.0, reach, foot - 0.008, 0.0, reach]
    add_rod(leaf, "far_rose", rose, 0.026, **seen)


def _top(door: DoorConfig) -> float:
    """Return the height of the leaf's top above the handle [m]."""
    return DOOR_HEIGHT - door.handle_height


def _edges(door: DoorConfig) -> tuple[float, float]:
    """Return the edges of the leaf at hinge and lock, in z of the frame [m]."""
    if door.level:
        return -FLAP_WIDTH / 2.0, FLAP_WIDTH / 2.0
    hinge, lock = -door.radius - door.overhang, door.leaf.backset
    shift = door.hand_offset
    return door.hinge_sign * (hinge + shift), door.hinge_sign * (lock + shift)


def _looks_of_closer(door: DoorConfig) -> tuple[float, float]:
    """Return opacity and arm radius [m]; only a hydraulic closer is visible."""
    if door.closer.closing_damping + door.closer.backcheck_damping > 0.0:
        return 1.0, 0.007
    # A transparent tendon would still cast a shadow, and MuJoCo rejects a zero radius.
    return 0.0, 1e-5
