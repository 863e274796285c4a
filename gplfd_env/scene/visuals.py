"""Visual-only geoms of a building's door: casing, panels, far handle, closer.

All of them are in the geom group `GROUP` and have neither mass nor contact, so they do
not change the physics. Doors with a bar have only the visuals of a closer.
"""

from collections.abc import Sequence
from typing import Any, Final

import mujoco

from gplfd_env.conventions.constants import INTANGIBLE, UNDRAWN
from gplfd_env.doors.config import BAR_RADIUS, KNOB_RADIUS, DoorConfig
from gplfd_env.scene.handle import STEEL

GROUP: Final = 2
"""Visual-only geom group."""

CLOSER_PARTS: Final = ("closer_box", "closer_shoe")
"""Geoms of a closer; the tendon `CLOSER_ARM` joins them."""

CLOSER_ARM: Final = "closer_arm"

_SEEN: Final[dict[str, Any]] = {**INTANGIBLE, "mass": 0.0, "group": GROUP}
_PAINT: Final = (0.96, 0.96, 0.94, 1.0)
_PANEL: Final = (0.72, 0.57, 0.40, 1.0)
_BRASS: Final = (0.72, 0.64, 0.42, 1.0)
_ALUMINIUM: Final = (0.66, 0.68, 0.70)
_ARM_RADIUS: Final = 0.007

_BOX: Final = mujoco.mjtGeom.mjGEOM_BOX
_CAPSULE: Final = mujoco.mjtGeom.mjGEOM_CAPSULE
_CYLINDER: Final = mujoco.mjtGeom.mjGEOM_CYLINDER
_SPHERE: Final = mujoco.mjtGeom.mjGEOM_SPHERE


def add_casing(
    frame: mujoco.MjsBody, door: DoorConfig, edges: tuple[float, float], top: float
) -> None:
    """Add the flat boards around the opening, on both sides of the wall."""
    wide, gap, deep, side = 0.035, 0.013, 0.072, door.hinge_sign
    hinge, lock = edges[0] - side * (gap + wide), edges[1] + side * (gap + wide)
    floor = -door.handle_height
    x, middle = -door.leaf.handle_standoff, (floor + top) / 2.0
    upright = [deep, (top - floor) / 2.0, wide]
    for name, place in (("casing_hinge", hinge), ("casing_lock", lock)):
        _add_box(frame, name, [x, middle, place], upright, _PAINT)
    across = [deep, wide, abs(lock - hinge) / 2.0 + wide]
    above = [x, top + gap + wide, (hinge + lock) / 2.0]
    _add_box(frame, "casing_top", above, across, _PAINT)


def add_panels(leaf: mujoco.MjsBody, door: DoorConfig, width: float) -> None:
    """Add two raised panels, visible on both sides of the leaf, and the lock."""
    stile, floor, x = 0.11, -door.handle_height, -door.leaf.handle_standoff
    free_edge = door.radius + door.leaf.backset
    thick = door.leaf.thickness / 2.0
    size = [thick + 0.004, 0.0, width / 2.0 - stile]
    place = door.hinge_sign * (free_edge - width / 2.0)
    for name, low, high in (
        ("panel_lower", floor + 0.20, floor + 0.84),
        ("panel_upper", floor + 1.02, floor + 1.84),
    ):
        size[1] = (high - low) / 2.0
        _add_box(leaf, name, [x, (low + high) / 2.0, place], size, _PANEL)
    reach = door.hinge_sign * door.radius
    near, far = x - (thick + 0.006), x + (thick + 0.006)
    through = [near, -0.09, reach, far, -0.09, reach]
    _add_rod(leaf, "lock_cylinder", through, 0.014, _BRASS)


def add_far_handle(
    leaf: mujoco.MjsBody, handle: mujoco.MjsBody, door: DoorConfig
) -> None:
    """Add the mirrored handle on the other side of the leaf."""
    far, surface = -2.0 * door.leaf.handle_standoff, door.leaf.thickness / 2.0
    foot = -door.leaf.handle_standoff - surface
    _add_rod(handle, "far_neck", [foot, 0.0, 0.0, far, 0.0, 0.0], 0.009, STEEL)
    if door.handle == "lever":
        end = -door.hinge_sign * (door.lockset.handle_length - BAR_RADIUS)
        ends = [far, 0.0, 0.0, far, 0.0, end]
        _add_rod(handle, "far_handle", ends, BAR_RADIUS, STEEL, _CAPSULE)
    else:
        handle.add_geom(
            name="far_handle",
            type=_SPHERE,
            pos=[far, 0.0, 0.0],
            size=[KNOB_RADIUS, 0, 0],
            rgba=STEEL,
            **_SEEN,
        )
    reach = door.hinge_sign * door.radius
    _add_rod(
        leaf, "far_rose", [foot, 0.0, reach, foot - 0.008, 0.0, reach], 0.026, STEEL
    )


def add_lock_plate(leaf: mujoco.MjsBody, door: DoorConfig) -> None:
    """Add the plate around the bolt on the leaf's free edge."""
    edge = door.hinge_sign * (door.radius + door.leaf.backset)
    place = [-door.leaf.handle_standoff, 0.0, edge]
    _add_box(leaf, "lock_plate", place, [0.010, 0.10, 0.0008], STEEL)


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
    box = [x, top - 0.065, side * 0.20]
    _add_box(leaf, "closer_box", box, [0.022, 0.027, 0.125], colour)
    leaf.add_site(name="closer_spindle", pos=[x, top - 0.03, side * 0.24], **UNDRAWN)
    foot = 0.084 - door.leaf.handle_standoff
    shoe = [foot, top + 0.03, side * (0.42 - door.hand_radius)]
    _add_box(frame, "closer_shoe", shoe, [0.012, 0.012, 0.03], colour)
    frame.add_site(name="closer_foot", pos=shoe, **UNDRAWN)
    # Otherwise the resting length would be that of the compiled door.
    arm = spec.add_tendon(
        name=CLOSER_ARM, width=radius, rgba=colour, springlength=[0.0, 0.0]
    )
    arm.wrap_site("closer_spindle")
    arm.wrap_site("closer_foot")


def show_closer(model: mujoco.MjModel, door: DoorConfig) -> None:
    """Show or hide the closer of a compiled scene."""
    opacity, radius = _looks_of_closer(door)
    for part in CLOSER_PARTS:
        model.geom_rgba[model.geom(part).id, 3] = opacity
    arm = model.tendon(CLOSER_ARM).id
    model.tendon_rgba[arm, 3], model.tendon_width[arm] = opacity, radius


def _looks_of_closer(door: DoorConfig) -> tuple[float, float]:
    """Return opacity and arm radius [m]; only a hydraulic closer is visible."""
    if door.closer.closing_damping + door.closer.backcheck_damping > 0.0:
        return 1.0, _ARM_RADIUS
    # A transparent tendon would still cast a shadow, and MuJoCo rejects a zero radius.
    return 0.0, 1e-5


def _add_box(
    body: mujoco.MjsBody,
    name: str,
    place: Sequence[float],
    size: Sequence[float],
    colour: Sequence[float],
) -> None:
    body.add_geom(name=name, type=_BOX, pos=place, size=size, rgba=colour, **_SEEN)


def _add_rod(
    body: mujoco.MjsBody,
    name: str,
    ends: Sequence[float],
    radius: float,
    colour: Sequence[float],
    kind: mujoco.mjtGeom = _CYLINDER,
) -> None:
    size = [radius, 0, 0]
    body.add_geom(name=name, type=kind, fromto=ends, size=size, rgba=colour, **_SEEN)
