"""Handle and latch as MuJoCo geoms.

The latch is a spring-loaded bolt, a slide joint in the leaf. Its round nose collides
only with the strike in the frame, a wedge whose upright face holds the door and whose
bevel pushes the bolt in when the door closes. The limit of a tendon retracts the bolt
with the handle beyond its dead travel; the handle returns without the bolt.
"""

import math
from collections.abc import Sequence
from typing import Any, Final

import mujoco
import numpy as np
from mujoco import MjModel, MjsBody, MjSpec

from gplfd_env.conventions.constants import INTANGIBLE, UNDRAWN, Array, Base
from gplfd_env.doors.config import BAR_RADIUS, KNOB_RADIUS, DoorConfig
from gplfd_env.doors.geometry import handle_axis
from gplfd_env.scene.shapes import STEEL, add_box, add_rod

BAR_HALF_LENGTH: Final = 0.10

# Distance from the grasped point to the ends of the rod of a paddle or thumb piece [m].
_ROD: Final = 0.05
_TOUCH_BAR: Final = 0.65  # Length of a touch bar, as a share of the leaf's width.
# Damping: about critical for the spring and inertia of a touch bar [N m s/rad].
_ROCKER_DAMPING: Final = 0.15
# The only geom that collides with the hand; its contact parameters have priority. A
# short time constant, above two physics steps, keeps the creep under a sustained pull
# small.
_HELD: Final[dict[str, Any]] = {
    "name": "handle_bar",
    "type": mujoco.mjtGeom.mjGEOM_CAPSULE,
    "rgba": STEEL,
    "contype": 0,
    "conaffinity": 1,
    "condim": 4,
    "friction": [1.0, 0.005, 0.0001],
    "solref": [0.005, 1.0],
    "priority": 1,
}
_BALL: Final = {**_HELD, "type": mujoco.mjtGeom.mjGEOM_SPHERE}


def add_bar(leaf: MjsBody, door: DoorConfig, foot: float, height: float) -> None:
    """Add a bar: the geom ``handle_bar`` and the site ``handle``.

    The leaf's surface is at `foot` along x, the grasped point `height` above the middle
    [m]. The bar of a flap is level; its site ``leaf_axes`` has axes along the motion,
    along the hinge and away from it.
    """
    level = door.level
    up = -1.0 if door.hinge_side == "top" else 1.0
    reach = (up if level else door.hinge_sign) * door.radius

    def point(x: float, along: float) -> list[float]:
        return [x, reach, along] if level else [x, along, reach]

    top, bottom = point(0, BAR_HALF_LENGTH), point(0, -BAR_HALF_LENGTH)
    leaf.add_geom(fromto=bottom + top, size=[BAR_RADIUS, 0, 0], mass=0.3, **_HELD)
    for name, end in (
        ("handle_post_upper", BAR_HALF_LENGTH),
        ("handle_post_lower", -BAR_HALF_LENGTH),
    ):
        add_rod(leaf, name, point(0.0, end) + point(foot, end), 0.009, mass=0.05)
    leaf.add_site(name="handle", pos=point(0.0, height), **UNDRAWN)
    if level:
        turn = [math.sqrt(0.5), -up * math.sqrt(0.5), 0.0, 0.0]
        leaf.add_site(name="leaf_axes", pos=point(0.0, 0.0), quat=turn, **UNDRAWN)


def add_turning_handle(leaf: MjsBody, door: DoorConfig, foot: float) -> None:
    """Add a lever that points to the hinge, or a knob, on the joint ``handle``.

    A positive angle presses the lever down; a knob turns the same way. The site
    ``handle`` turns with it; ``leaf_axes`` at the same place does not.
    """
    reach, grip = door.hinge_sign * door.radius, door.hinge_sign * door.hand_offset
    axis = [-door.hinge_sign, 0, 0]
    body = _add_turned_body(leaf, door, [0.0, 0.0, reach], axis, damping=0.02)
    if door.handle == "lever":
        end = -door.hinge_sign * (door.lockset.handle_length - BAR_RADIUS)
        lever = {"fromto": [0, 0, 0, 0, 0, end], "size": [BAR_RADIUS, 0, 0]}
        body.add_geom(mass=0.2, **lever, **_HELD)
    else:
        body.add_geom(size=[KNOB_RADIUS, 0, 0], mass=0.3, **_BALL)
    add_rod(body, "handle_neck", [0.0, 0.0, 0.0, foot, 0.0, 0.0], 0.009, mass=0.05)
    body.add_site(name="handle", pos=[0.0, 0.0, -grip], **UNDRAWN)
    leaf.add_site(name="leaf_axes", pos=[0.0, 0.0, reach - grip], **UNDRAWN)
    rose = [foot, 0.0, reach, foot + 0.008, 0.0, reach]
    add_rod(leaf, "handle_rose", rose, 0.026, mass=0.05)


def add_rocker(leaf: MjsBody, door: DoorConfig, foot: float) -> None:
    """Add a paddle, a touch bar or a thumb piece on the joint ``handle``.

    The hand holds a horizontal rod that turns about an axis parallel to it. The geom
    that touches the hand, ``handle_bar``, is a sphere, so that the hand may turn about
    the vertical, as flat fingers can. The sites are those of a lever.
    """
    reach = door.hinge_sign * door.radius
    spindle, axis = handle_axis(door)
    place = [*spindle[:2], reach]
    body = _add_turned_body(leaf, door, place, axis, damping=_ROCKER_DAMPING)
    x, y = -spindle[:2]
    towards_hinge = _ROD
    if door.handle == "touch-bar":
        towards_hinge = _TOUCH_BAR * (door.radius + door.leaf.backset)
    ends = [x, y, door.hinge_sign * _ROD, x, y, -door.hinge_sign * towards_hinge]
    body.add_geom(pos=[x, y, 0.0], size=[BAR_RADIUS, 0, 0], mass=0.3, **_BALL)
    add_rod(body, "handle_rod", ends, 0.8 * BAR_RADIUS, mass=0.05)
    body.add_site(name="handle", pos=[x, y, 0.0], **UNDRAWN)
    leaf.add_site(name="leaf_axes", pos=[0.0, 0.0, reach], **UNDRAWN)
    # The plate between rod and axis, its mount on the leaf, and a handleset's grip.
    middle, half = (ends[2] + ends[5]) / 2.0, abs(ends[2] - ends[5]) / 2.0
    thick, high = max(abs(x) / 2.0, 0.004), max(abs(y) / 2.0, 0.004)
    place, size = [x / 2.0, y / 2.0, middle], [thick, high, 0.9 * half]
    add_box(body, "handle_plate", place, size, STEEL, mass=0.05)
    place = [(foot + spindle[0]) / 2.0, spindle[1], reach + middle]
    size = [max((spindle[0] - foot) / 2.0, 0.004), 0.012, half]
    add_box(leaf, "handle_mount", place, size, STEEL, mass=0.05)
    if door.handle == "handleset":
        grip = [-0.01, -0.04, reach, -0.01, -0.24, reach]
        add_rod(leaf, "handle_grip", grip, BAR_RADIUS, mass=0.05)


def _add_turned_body(
    leaf: MjsBody,
    door: DoorConfig,
    place: Sequence[float],
    axis: Sequence[float] | Array,
    damping: float,
) -> MjsBody:
    """Add body and joint ``handle`` with a return spring; damping in N m s/rad."""
    preload, stiffness = door.handle_spring
    body = leaf.add_body(name="handle", pos=place, gravcomp=1.0)
    body.add_joint(
        name="handle",
        type=mujoco.mjtJoint.mjJNT_HINGE,
        axis=axis,
        range=[0.0, door.handle_travel],
        limited=True,
        stiffness=[stiffness, 0, 0],
        springref=-preload / stiffness,
        damping=[damping, 0, 0],
        armature=1e-3,
    )
    return body


def set_spring(model: MjModel, joint: str, preload: float, stiffness: float) -> None:
    """Set a joint's spring towards zero: preload + stiffness times position."""
    handle = model.joint(joint)
    model.jnt_stiffness[handle.id] = stiffness
    model.qpos_spring[handle.qposadr[0]] = -preload / stiffness


_NOSE: Final = 0.003  # Radius of the bolt's nose [m].

GAP: Final = 0.003
"""Gap between leaf and frame: a bolt that protrudes by less does not hold the door
[m]."""

# Distance between the bolt of a closed door and the strike [m].
_CLEARANCE: Final = 0.001
# Length and rise of the strike's bevel [m]; more than the longest bolt needs.
_BEVEL: Final = 0.018
# Angle by which the strike's upright face recedes behind its edge [rad]: the edge then
# loads the flank of the bolt, and the 2 kN of a mobile robot do not push the bolt in.
_UNDERCUT: Final[dict[Base, float]] = {"fixed": 0.0, "mobile": math.radians(3.0)}
# Impedance of bolt and strike (MuJoCo's ``solimp``).
_CONTACT: Final[dict[Base, list[float]]] = {
    "fixed": [0.9, 0.95, 0.001, 0.5, 2.0],
    "mobile": [0.99, 0.999, 0.001, 0.5, 2.0],
}
_HALF_HEIGHT: Final = 0.03
# Rotations by 180° that mirror the strike, which is symmetric above and below.
_MIRRORED: Final = {
    ("pull", "right"): (1.0, 0.0, 0.0, 0.0),
    ("push", "right"): (0.0, 0.0, 0.0, 1.0),
    ("pull", "left"): (0.0, 1.0, 0.0, 0.0),
    ("push", "left"): (0.0, 0.0, 1.0, 0.0),
}
_BOLT_MASS: Final = 0.1

PLAY: Final = math.radians(1.0)
"""A latched door opens by less than this [rad]."""


def add_latch(
    spec: MjSpec,
    frame: MjsBody,
    leaf: MjsBody,
    door: DoorConfig,
    lock_edge: float,
    base: Base,
) -> None:
    """Add the joint ``bolt``, the geoms ``bolt_nose`` and ``strike``, and a tendon.

    The tendon ``retraction`` between the joints ``handle`` and ``bolt`` retracts the
    bolt. The leaf's free edge is at `lock_edge`, task-frame z [m].
    """
    side = door.hinge_sign
    edge = side * (door.radius + door.leaf.backset)
    bolt = leaf.add_body(name="bolt", pos=[-door.leaf.handle_standoff, 0.0, edge])
    throw, stiffness = door.lockset.bolt_throw, door.lockset.bolt_stiffness
    bolt.add_joint(
        name="bolt",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, -side],
        springref=-door.lockset.bolt_preload / stiffness,
        stiffness=[stiffness, 0, 0],
        damping=[2.0, 0, 0],
        range=[0.0, throw],
        limited=True,
        solref_limit=[0.005, 1.0],
    )
    tip = side * (throw - _NOSE)
    ends, kind = [0.0, 0.0, tip - side * 0.03, 0.0, 0.0, tip], mujoco.mjtGeom
    add_rod(bolt, "bolt_nose", ends, _NOSE, type=kind.mjGEOM_CAPSULE, mass=_BOLT_MASS)
    # The strike is a wedge, in the plane of the leaf's motion.
    far, back = 1.5 * _BEVEL, 1.5 * _BEVEL * math.tan(_UNDERCUT[base])
    corners = [(0.0, 0.0), (back, far), (_BEVEL, _BEVEL), (_BEVEL, far)]
    mesh = spec.add_mesh(name="strike")
    mesh.uservert = np.array(
        [(x, y, z) for y in (-_HALF_HEIGHT, _HALF_HEIGHT) for x, z in corners]
    ).ravel()
    face = -door.leaf.handle_standoff + door.swing_sign * (_NOSE + _CLEARANCE)
    place = [face, 0.0, lock_edge + side * GAP]
    turn = _MIRRORED[door.swing, door.hinge_side]
    shape: Any = {"type": kind.mjGEOM_MESH, "meshname": "strike", "rgba": STEEL}
    frame.add_geom(name="strike", pos=place, quat=turn, **shape, **INTANGIBLE)
    names = {"name": "latch", "geomname1": "bolt_nose", "geomname2": "strike"}
    spec.add_pair(condim=1, solref=[0.005, 1.0], solimp=_CONTACT[base], **names)
    ratio = door.lockset.bolt_throw / (door.handle_travel - door.lockset.dead_travel)
    limits = {"limited": True, "range": [-ratio * door.lockset.dead_travel, 1.0]}
    springs = {"springlength": [0.0, 0.0], "solref_limit": [0.005, 1.0]}
    retraction = spec.add_tendon(name="retraction", **limits, **springs)
    retraction.wrap_joint("bolt", 1.0)
    retraction.wrap_joint("handle", -ratio)
