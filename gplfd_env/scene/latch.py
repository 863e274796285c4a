"""The latch: a spring-loaded bolt in the leaf and its strike in the frame.

The bolt is a slide joint. Its round nose collides only with the strike, a wedge whose
upright face holds the door and whose bevel pushes the bolt in when the door closes. The
limit of a tendon retracts the bolt with the handle beyond its dead travel; the handle
returns without the bolt.
"""

import math
from typing import Final

import mujoco
import numpy as np

from gplfd_env.conventions.constants import INTANGIBLE, Base
from gplfd_env.doors.config import DoorConfig
from gplfd_env.scene.shapes import STEEL, add_rod

_NOSE: Final = 0.003
"""Radius of the bolt's nose [m]."""

GAP: Final = 0.003
"""Gap between leaf and frame: a bolt that protrudes by less does not hold the door
[m]."""

_CLEARANCE: Final = 0.001
"""Distance between the bolt of a closed door and the strike [m]."""

_BEVEL: Final = 0.018
"""Length and rise of the strike's bevel [m]; more than the longest bolt needs."""

_UNDERCUT: Final[dict[Base, float]] = {"fixed": 0.0, "mobile": math.radians(3.0)}
"""Angle by which the strike's upright face recedes behind its edge [rad]. The edge then
loads the flank of the bolt and does not push it in while the leaf deflects by less.
Without it, the 2 kN of a mobile robot that hits the door push the bolt in."""

_CONTACT: Final[dict[Base, list[float]]] = {
    "fixed": [0.9, 0.95, 0.001, 0.5, 2.0],
    "mobile": [0.99, 0.999, 0.001, 0.5, 2.0],
}
"""Impedance of bolt and strike (MuJoCo's ``solimp``; its default if the base is
fixed)."""

_HALF_HEIGHT: Final = 0.03

_MIRRORED: Final = {
    ("pull", "right"): (1.0, 0.0, 0.0, 0.0),
    ("push", "right"): (0.0, 0.0, 0.0, 1.0),
    ("pull", "left"): (0.0, 1.0, 0.0, 0.0),
    ("push", "left"): (0.0, 0.0, 1.0, 0.0),
}
"""Rotations by 180° that mirror the strike, which is symmetric above and below."""

_BOLT_MASS: Final = 0.1

PLAY: Final = math.radians(1.0)
"""A latched door opens by less than this [rad]."""


def add_latch(
    spec: mujoco.MjSpec,
    frame: mujoco.MjsBody,
    leaf: mujoco.MjsBody,
    door: DoorConfig,
    lock_edge: float,
    base: Base,
) -> None:
    """Add bolt, strike and the tendon that retracts the bolt.

    They are the joint ``bolt``, the geoms ``bolt_nose`` and ``strike``, and the tendon
    ``retraction`` between the joints ``handle`` and ``bolt``. The leaf's free edge is
    at `lock_edge`, task-frame z [m].
    """
    side = door.hinge_sign
    edge = side * (door.radius + door.leaf.backset)
    bolt = leaf.add_body(name="bolt", pos=[-door.leaf.handle_standoff, 0.0, edge])
    bolt.add_joint(
        name="bolt",
        type=mujoco.mjtJoint.mjJNT_SLIDE,
        axis=[0, 0, -side],
        range=[0.0, door.lockset.bolt_throw],
        limited=True,
        solref_limit=[0.005, 1.0],
        stiffness=[door.lockset.bolt_stiffness, 0, 0],
        springref=-door.lockset.bolt_preload / door.lockset.bolt_stiffness,
        damping=[2.0, 0, 0],
    )
    tip = side * (door.lockset.bolt_throw - _NOSE)
    ends, kind = [0.0, 0.0, tip - side * 0.03, 0.0, 0.0, tip], mujoco.mjtGeom
    add_rod(bolt, "bolt_nose", ends, _NOSE, type=kind.mjGEOM_CAPSULE, mass=_BOLT_MASS)
    # The strike is a wedge, in the plane of the leaf's motion.
    corners = [
        (0.0, 0.0),
        (1.5 * _BEVEL * math.tan(_UNDERCUT[base]), 1.5 * _BEVEL),
        (_BEVEL, _BEVEL),
        (_BEVEL, 1.5 * _BEVEL),
    ]
    mesh = spec.add_mesh(name="strike")
    mesh.uservert = np.array(
        [(x, y, z) for y in (-_HALF_HEIGHT, _HALF_HEIGHT) for x, z in corners]
    ).ravel()
    face = -door.leaf.handle_standoff + door.swing_sign * (_NOSE + _CLEARANCE)
    frame.add_geom(
        name="strike",
        type=mujoco.mjtGeom.mjGEOM_MESH,
        meshname="strike",
        pos=[face, 0.0, lock_edge + side * GAP],
        quat=_MIRRORED[door.swing, door.hinge_side],
        rgba=STEEL,
        **INTANGIBLE,
    )
    spec.add_pair(
        name="latch",
        geomname1="bolt_nose",
        geomname2="strike",
        condim=1,
        solref=[0.005, 1.0],
        solimp=_CONTACT[base],
    )
    ratio = door.lockset.bolt_throw / (door.handle_travel - door.lockset.dead_travel)
    retraction = spec.add_tendon(
        name="retraction",
        limited=True,
        range=[-ratio * door.lockset.dead_travel, 1.0],
        springlength=[0.0, 0.0],
        solref_limit=[0.005, 1.0],
    )
    retraction.wrap_joint("bolt", 1.0)
    retraction.wrap_joint("handle", -ratio)
