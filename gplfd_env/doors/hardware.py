"""Parts and fields of a `DoorConfig` from standards and manufacturers' tables.

assets/README.md names the clause or table of every number.
"""

import math
from typing import Any, Final, NamedTuple

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.doors.parts import Closer, Leaf
from gplfd_env.validation.fields import check_choice

GRAVITY: Final = 9.81


class CloserSize(NamedTuple):
    """A row of EN 1154, table 1, for a power size."""

    closing: tuple[float, float]  # Moment from 0 to 4°, least and greatest [N m].
    closing_open: float  # Least moment from 88 to 92° [N m].
    opening: float  # Greatest moment from 0 to 60° [N m].
    efficiency: float  # Least ratio of closing to opening moment from 0 to 4°.
    widest: float  # Greatest width of the leaf [m].
    heaviest: float  # Greatest mass of the leaf [kg].


EN_1154: Final = {
    1: CloserSize((9.0, 13.0), 3.0, 26.0, 0.50, 0.75, 20.0),
    2: CloserSize((13.0, 18.0), 4.0, 36.0, 0.50, 0.85, 40.0),
    3: CloserSize((18.0, 26.0), 6.0, 47.0, 0.55, 0.95, 60.0),
    4: CloserSize((26.0, 37.0), 9.0, 62.0, 0.60, 1.10, 80.0),
}
"""Rows by power size."""

# Angle at which a closer's additional moment near the frame is zero [rad]; assumed.
_FADED: Final = math.radians(30.0)

LEAF_HEIGHT: Final = 1.972
"""Height of a leaf by DIN 18101 [m]."""

CONSTRUCTIONS: Final = {
    "honeycomb": 8.0, "tubular-strips": 12.0, "tubular-core": 15.0, "chipboard": 23.0,
    "fire": 34.0,
}  # fmt: skip
"""Mass of a leaf per area, by its core [kg/m²]."""

BEARINGS: Final = {"ball": 0.04, "plain": 0.12, "worn": 0.25, "rusty": 0.55}
"""Coefficient of friction of a hinge."""
CLEAR_WAY: Final = 0.85
"""Share of its clear way that a leaf without a hinge has moved at `SUCCESS_ANGLE`."""

# Damping of a moving leaf, and the additional soft-close damping [N s/m]; assumed.
_ROLLER_DAMPING: Final = 8.0
_SOFT_CLOSE_DAMPING: Final = 60.0
_SOFT_CLOSE_WAY: Final = 0.1
_PIN_RADIUS: Final = 4.8e-3
_THRUST_RADIUS: Final = 7.5e-3
# Distance between the outer hinges of a leaf [m]; own assumption.
_HINGE_SPAN: Final = 1.5


def en1154(size: int, efficiency: float | None = None) -> Closer:
    """Return a hydraulic closer of a power size, 1 to 4.

    The closing moment M near the frame is the middle of the standard's range. With the
    efficiency η, by default halfway between the least allowed and 1, the opening moment
    there is M / η: the spring gives their mean and friction half their difference.
    Beyond 30° the closing moment is half of M; at 90° this exceeds the least allowed.
    Raises a ValueError for a size or an efficiency that the standard does not have.
    """
    check_choice("EN 1154 size", size, EN_1154)
    row = EN_1154[size]
    share = (row.efficiency + 1.0) / 2.0 if efficiency is None else efficiency
    closing = sum(row.closing) / 2.0
    if not (row.efficiency <= share <= 1.0 and closing / share <= row.opening):
        raise ValueError(
            f"efficiency = {share!r} of a closer of size {size} is outside "
            f"[{row.efficiency:g}, 1] (EN 1154, table 1)"
        )
    friction = closing * (1.0 / share - 1.0) / 2.0
    preload = 0.5 * closing + friction
    boost = {"boost": closing + friction - preload, "boost_angle": _FADED}
    return Closer(
        preload=preload,
        friction=friction,
        damping=4.0 + 2.0 * size,
        closing_damping=26.0 + 8.0 * size,
        backcheck_damping=40.0 + 20.0 * size,
        **boost,
    )


def spring_hinge(moment: float = 6.0) -> Closer:
    """Return a spring hinge; its moment at the closed door [N m] doubles over 90°."""
    return Closer(preload=moment, stiffness=moment / math.radians(90.0))


def rollers(
    mass: float, way: float, coefficient: float = 0.015, soft_close: float = 0.0
) -> dict[str, Any]:
    """Return the fields of a leaf that hangs on rollers.

    The arguments are its mass [kg], its clear way [m], the rollers' coefficient of
    friction, and the force [N] of a soft-close spring at the closed door, which fades
    over 10 cm. The torques do the same work as these forces per rad of `door_angle`.
    """
    gain = sliding_gain(way)
    friction = coefficient * mass * GRAVITY * gain
    fields: dict[str, Any] = {"panel_mass": mass, "hinge_friction": friction}
    fields["hinge_damping"] = _ROLLER_DAMPING * gain**2
    if soft_close > 0.0:
        fades, damping = _SOFT_CLOSE_WAY / gain, _SOFT_CLOSE_DAMPING * gain**2
        closer = {"boost_angle": fades, "closing_damping": damping}
        fields["closer"] = Closer(boost=soft_close * gain, **closer)
    return fields


def sliding_gain(way: float) -> float:
    """Return how far a sliding leaf with a clear way [m] moves, per `door_angle`."""
    return CLEAR_WAY * way / SUCCESS_ANGLE


def leaf(
    width: float,
    construction: str = "tubular-strips",
    *,
    backset: float = 0.055,
    bearing: str = "ball",
) -> dict[str, Any]:
    """Return the fields of a door with an unrebated leaf of `LEAF_HEIGHT`.

    The arguments are its width [m], a key of `CONSTRUCTIONS`, the distance from the
    lock's edge to the axis of the handle [m], and a key of `BEARINGS`. Raises a
    ValueError for an unknown construction or bearing.
    """
    check_choice("construction", construction, CONSTRUCTIONS)
    check_choice("bearing", bearing, BEARINGS)
    mass = CONSTRUCTIONS[construction] * width * LEAF_HEIGHT
    # Coulomb friction of the hinges, the bearing model of DoorBench's docs/PHYSICS.md:
    # μ (m g r_thrust + 2 F r_pin) with the horizontal load F = m g (W / 2) / span.
    weight = mass * GRAVITY
    sideways = weight * (width / 2.0) / _HINGE_SPAN
    moment = weight * _THRUST_RADIUS + 2.0 * sideways * _PIN_RADIUS
    fields = {"radius": width - backset, "leaf": Leaf(width=width, backset=backset)}
    return fields | {"panel_mass": mass, "hinge_friction": BEARINGS[bearing] * moment}
