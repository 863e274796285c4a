"""Visual-only geoms of a building's door: casing, panels, far handle, closer.

All of them are in the geom group `GROUP` and have neither mass nor contact, so they do
not change the physics. Doors with a bar have only the visuals of a closer.
"""

from typing import Any, Final

import mujoco

from gplfd_env.conventions.constants import UNDRAWN
from gplfd_env.doors.config import BAR_RADIUS, KNOB_RADIUS, DoorConfig
from gplfd_env.scene.shapes import STEEL, add_box, add_rod

GROUP: Final = 2
"""Visual-only geom group."""

CLOSER_ARM: Final = "closer_arm"
"""Tendon that joins the geoms of a closer."""

_CLOSER_PARTS: Final = ("closer_box", "closer_shoe")
_PAINT: Final = (0.96, 0.96, 0.94, 1.0)
_PANEL: Final = (0.72, 0.57, 0.40, 1.0)
_BRASS: Final = (0.72, 0.64, 0.42, 1.0)
_ALUMINIUM: Final = (0.66, 0.68, 0.70)
_ARM_RADIUS: Final = 0.007


def add_building_visuals(
    frame: mujoco.MjsBody,
    leaf: mujoco.MjsBody,
    door: DoorConfig,
    edges: tuple[float, float],
    top: float,
) -> None:
    """Add the casing around the opening, raised panels and the lock.

    The edges of the leaf are in z of the frame, its top in y [m].
    """
    wide, gap, deep, side = 0.035, 0.013, 0.072, door.hinge_sign
    hinge, lock = edges[0] - side * (gap + wide), edges[1] + side * (gap + wide)
    floor, x = -door.handle_height, -door.leaf.handle_standoff
    middle, half = (floor + top) / 2.0, (top - floor) / 2.0
    above, across = top + gap + wide, abs(lock - hinge) / 2.0 + wide
    for name, y, z, height, width in (
        ("casing_hinge", middle, hinge, half, wide),
        ("casing_lock", middle, lock, half, wide),
        ("casing_top", above, (hinge + lock) / 2.0, wide, across),
    ):
        add_box(frame, name, [x, y, z], [deep, height, width], _PAINT, group=GROUP)
    thick, free_edge = door.leaf.thickness / 2.0, door.radius + door.leaf.backset
    width = door.leaf.backset - (-door.radius - door.overhang)
    z = side * (free_edge - width / 2.0)
    for name, low, high in (
        ("panel_lower", floor + 0.20, floor + 0.84),
        ("panel_upper", floor + 1.02, floor + 1.84),
    ):
        size = [thick + 0.004, (high - low) / 2.0, width / 2.0 - 0.11]
        add_box(leaf, name, [x, (low + high) / 2.0, z], size, _PANEL, group=GROUP)
    reach = side * door.radius
    ends = [x - (thick + 0.006), -0.09, reach, x + (thick + 0.006), -0.09, reach]
    add_rod(leaf, "lock_cylinder", ends, 0.014, _BRASS, group=GROUP)


def add_far_handle(
    leaf: mujoco.MjsBody, handle: mujoco.MjsBody, door: DoorConfig
) -> None:
    """Add the mirrored handle on the other side of the leaf."""
    far, reach = -2.0 * door.leaf.handle_standoff, door.hinge_sign * door.radius
    foot = -door.leaf.handle_standoff - door.leaf.thickness / 2.0
    shown: Any = {"group": GROUP}
    add_rod(handle, "far_neck", [foot, 0.0, 0.0, far, 0.0, 0.0], 0.009, **shown)
    if door.handle == "lever":
        end = -door.hinge_sign * (door.lockset.handle_length - BAR_RADIUS)
        kind, ends = mujoco.mjtGeom.mjGEOM_CAPSULE, [far, 0.0, 0.0, far, 0.0, end]
        add_rod(handle, "far_handle", ends, BAR_RADIUS, type=kind, **shown)
    else:
        ball, size = mujoco.mjtGeom.mjGEOM_SPHERE, [KNOB_RADIUS, 0, 0]
        add_box(handle, "far_handle", [far, 0, 0], size, STEEL, type=ball, **shown)
    rose = [foot, 0.0, reach, foot - 0.008, 0.0, reach]
    add_rod(leaf, "far_rose", rose, 0.026, **shown)


def add_lock_plate(leaf: mujoco.MjsBody, door: DoorConfig) -> None:
    """Add the plate around the bolt on the leaf's free edge."""
    edge = door.hinge_sign * (door.radius + door.leaf.backset)
    place, size = [-door.leaf.handle_standoff, 0.0, edge], [0.010, 0.10, 0.0008]
    add_box(leaf, "lock_plate", place, size, STEEL, group=GROUP)


def add_closer_visuals(
    spec: mujoco.MjSpec,
    frame: mujoco.MjsBody,
    leaf: mujoco.MjsBody,
    door: DoorConfig,
    top: float,
) -> None:
    """Add a closer's box on the leaf, its shoe on the frame, and the arm between.

    The arm is one straight tendon without force; two links would need additional bodies
    and joints. Doors without a visible closer have the same parts, but transparent.
    """
    opacity, radius = _looks_of_closer(door)
    colour, side = (*_ALUMINIUM, opacity), door.hinge_sign
    x = -door.leaf.handle_standoff + door.leaf.thickness / 2.0 + 0.022
    box, size = [x, top - 0.065, side * 0.20], [0.022, 0.027, 0.125]
    add_box(leaf, _CLOSER_PARTS[0], box, size, colour, group=GROUP)
    leaf.add_site(name="closer_spindle", pos=[x, top - 0.03, side * 0.24], **UNDRAWN)
    foot = 0.084 - door.leaf.handle_standoff
    shoe, size = [foot, top + 0.03, side * (0.42 - door.hand_radius)], [0.012, 0.012]
    add_box(frame, _CLOSER_PARTS[1], shoe, [*size, 0.03], colour, group=GROUP)
    frame.add_site(name="closer_foot", pos=shoe, **UNDRAWN)
    # Otherwise the resting length would be that of the compiled door.
    looks = {"width": radius, "rgba": colour, "springlength": [0.0, 0.0]}
    arm = spec.add_tendon(name=CLOSER_ARM, **looks)
    arm.wrap_site("closer_spindle")
    arm.wrap_site("closer_foot")


def show_closer(model: mujoco.MjModel, door: DoorConfig) -> None:
    """Show or hide the closer of a compiled scene."""
    opacity, radius = _looks_of_closer(door)
    for part in _CLOSER_PARTS:
        model.geom_rgba[model.geom(part).id, 3] = opacity
    arm = model.tendon(CLOSER_ARM).id
    model.tendon_rgba[arm, 3], model.tendon_width[arm] = opacity, radius


def _looks_of_closer(door: DoorConfig) -> tuple[float, float]:
    """Return opacity and arm radius [m]; only a hydraulic closer is visible."""
    if door.closer.closing_damping + door.closer.backcheck_damping > 0.0:
        return 1.0, _ARM_RADIUS
    # A transparent tendon would still cast a shadow, and MuJoCo rejects a zero radius.
    return 0.0, 1e-5
