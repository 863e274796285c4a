"""How a leaf moves and what closes it, as functions of one coordinate.

Every door has one degree of freedom, `door_angle` φ: the opening angle of a leaf that
turns about a hinge. Any other leaf has moved by 85 % of its clear way at φ = 60°, as
much as a person needs. The scene and every forward kinematics use the joints of
`links_of`; `gplfd_env.scene.closer` models the torque of `CloserLaw`.

| motion | handle's path from its closed position, hinge on the right |
|---|---|
| hinged, flap | circle about a vertical, a horizontal axis |
| sliding | (0, -s) |
| parallel-sliding | w (1 - (1-u)⁴), -s (2u² - u³): out by w, then along |
| folding | trammel ellipse a sin ψ, -(2L-a) (1 - cos ψ); the leaf turns by -ψ |
| rising-butt | circle, and upwards by 10 to 13 mm per 90° |
| concealed-hinge | coupler of a four-bar; its centre of rotation moves by 15 mm |

assets/README.md names the sources of the dimensions.
"""

import functools
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final, NamedTuple

import numpy as np
from numpy.polynomial.polynomial import polyfit, polyval
from numpy.typing import ArrayLike

from gplfd_env.conventions.constants import SUCCESS_ANGLE, Array, Vector
from gplfd_env.conventions.one_and_many import (
    Flag,
    Number,
    anywhere,
    larger,
    magnitude,
    negated,
    sqrt,
    where,
)
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.hardware import CLEAR_WAY, sliding_gain
from gplfd_env.spatial.se3 import compose_rotvecs, cross

_ALONG_AT_SUCCESS: Final = 0.8656293468  # Root u of 2u² - u³ = 0.85.
_FOLD_GAIN: Final = math.acos(1.0 - CLEAR_WAY) / SUCCESS_ANGLE
_FLAT: Final = math.radians(88.0)  # Angle of the folded leaves at their stop [rad].

# Fixed pivots at (-13, -8.5) and (-48, -5.5) mm, moving ones at (-22.5, 34.5) and
# (-1, 16) mm, outwards and towards the lock from the corner of cabinet and leaf. The
# displacement of that corner, as polynomials of the leaf's angle, exact to 0.01 mm.
_FOUR_BAR_OUT: Final = (-8.7057e-3, -5.2375e-3, 4.7331e-3, -6.743e-4)
_FOUR_BAR_ALONG: Final = (-1.68670e-2, 1.08996e-2, -1.907e-4, -6.774e-4)
_DEGREE: Final = 4  # Degree of the polynomials in `LeafPath.tangent`.
_ALONG_NORMAL: Final = (1.0, *_DEGREE * (0.0,)), (_DEGREE + 1) * (0.0,)
STICTION_ANGLE: Final = math.radians(0.5)
"""Angle at which the stiction has faded [rad]."""

_SPEED: Final = 1e-3  # Speed below which a door counts as at rest [rad/s].


class Link(NamedTuple):
    """A joint between frame and leaf; the next link is fixed to what it moves."""

    name: str  # Name of the MuJoCo joint; the coordinate of "hinge" is φ.
    slides: bool  # Whether it slides along the axis; else it turns about it.
    axis: Vector  # In the door frame; its origin is the hand at the closed door.
    anchor: Vector  # A point of the axis, door frame [m].
    gains: tuple[float, ...]  # g₁, g₂, ...: the joint position is Σ gₖ φᵏ [m, rad].


def links_of(door: DoorConfig) -> tuple[Link, ...]:
    """Return the joints of a door, from the frame to the leaf."""
    side, way, origin = door.hinge_sign, door.swing_sign, (0.0, 0.0, 0.0)
    inwards, outwards, up = (0.0, 0.0, -side), (way, 0.0, 0.0), (0.0, 1.0, 0.0)
    upright = (0.0, side * way, 0.0)
    hinge = Link("hinge", False, upright, (0.0, 0.0, -side * door.hand_radius), (1.0,))
    if door.motion == "sliding":
        gain = sliding_gain(door.clear_width)
        return (Link("along", True, inwards, origin, (gain,)),)
    if door.motion == "parallel-sliding":
        u = _ALONG_AT_SUCCESS / SUCCESS_ANGLE
        w, s = door.mechanism.offset, door.clear_width
        out = (4.0 * w * u, -6.0 * w * u**2, 4.0 * w * u**3, -w * u**4)
        along = (0.0, 2.0 * s * u**2, -s * u**3)
        slide = Link("along", True, inwards, origin, along)
        return Link("out", True, outwards, origin, out), slide
    if door.motion == "folding":
        middle = (0.0, 0.0, -side * door.fold_distance)
        unfold = Link("unfold", False, upright, middle, (-2.0 * _FOLD_GAIN,))
        return Link("fold", False, upright, hinge.anchor, (_FOLD_GAIN,)), unfold
    if door.motion == "flap":
        down = -1.0 if door.hinge_side == "bottom" else 1.0
        anchor = (0.0, down * door.radius, 0.0)
        return (Link("hinge", False, (0.0, 0.0, down), anchor, (1.0,)),)
    if door.motion == "rising-butt":
        rise = door.mechanism.rise / (math.pi / 2.0)
        return Link("rise", True, up, origin, (rise,)), hinge
    if door.motion == "concealed-hinge":
        back = tuple(-gain for gain in _FOUR_BAR_ALONG)
        slide = Link("along", True, inwards, origin, back)
        return Link("out", True, outwards, origin, _FOUR_BAR_OUT), slide, hinge
    return (hinge,)


def end_angle(door: DoorConfig) -> float:
    """Return φ at which the leaf meets its stop [rad]."""
    straight = {"sliding": CLEAR_WAY, "parallel-sliding": _ALONG_AT_SUCCESS}
    ends = {motion: SUCCESS_ANGLE / way for motion, way in straight.items()}
    ends["folding"] = _FLAT / _FOLD_GAIN
    return min(door.stop_angle, ends.get(door.motion, door.stop_angle))


def roller_way(door: DoorConfig, angles: Array) -> Array:
    """Return how far the rollers of folding leaves move per φ, at angles φ [m/rad]."""
    leaves = door.radius + door.leaf.backset
    return np.asarray(leaves * _FOLD_GAIN * np.sin(_FOLD_GAIN * angles))


class LeafPath(NamedTuple):
    """Motion of the handle with the leaf, as numbers for one door or arrays (n,)."""

    swing_sign: Number = 1.0
    """`DoorConfig.swing_sign`."""
    hinge_sign: Number = 1.0
    """`DoorConfig.hinge_sign`."""
    upright: Number = 1.0
    """Rotation of the leaf about the upward axis, per φ."""
    level: Number = 0.0
    """Rotation of the leaf about the z axis of the door frame, per φ."""
    circle: Flag = True
    """Whether the handle always moves along the normal of the leaf."""
    tangent: tuple[tuple[Number, ...], tuple[Number, ...]] = _ALONG_NORMAL
    """Direction of the path in the leaf's axes (normal, away from the hinge), of any
    length: coefficients of polynomials in φ, the constant first."""

    @classmethod
    def of(cls, door: DoorConfig) -> "LeafPath":
        """Return the path of a door's handle."""
        turns = np.zeros(3)
        for link in links_of(door):
            if not link.slides:
                turns += link.gains[0] * np.array(link.axis)
        path = cls(door.swing_sign, door.hinge_sign, float(turns[1]), float(turns[2]))
        if door.motion in ("hinged", "flap", "rising-butt"):
            return path
        return path._replace(circle=False, tangent=_tangent(door))

    def split(
        self, angle: Number, normal: Number, outwards: Number
    ) -> tuple[Number, Number]:
        """Return a vector's components along the path and outwards, at φ [rad]."""
        if not anywhere(negated(self.circle)):
            return normal, outwards
        x, z = (
            functools.reduce(lambda total, gain: total * angle + gain, reversed(gains))
            for gains in self.tangent
        )
        length = sqrt(x * x + z * z)
        along = (x * normal + z * outwards) / length
        across = (x * outwards - z * normal) / length
        return where(self.circle, normal, along), where(self.circle, outwards, across)


@functools.lru_cache(maxsize=256)
def _tangent(door: DoorConfig) -> tuple[tuple[float, ...], tuple[float, ...]]:
    """Fit polynomials to the direction of the handle's path in the leaf's axes."""
    angles, step = np.linspace(0.0, end_angle(door), 33), 1e-6
    links, closed = links_of(door), np.zeros((33, 6))
    before, after = (carried(links, angles + shift, closed) for shift in (-step, step))
    x, _, z = (after - before)[:, :3].T / (2.0 * step)
    cosine, sine = (np.cos(before[:, 4]), np.sin(before[:, 4]))
    along = door.swing_sign * (cosine * x - sine * z)
    outwards = door.hinge_sign * (sine * x + cosine * z)
    fits = [polyfit(angles, part, _DEGREE) for part in (along, outwards)]
    return tuple(fits[0].tolist()), tuple(fits[1].tolist())


def carried(links: Sequence[Link], angle: ArrayLike, poses: Array) -> Array:
    """Move poses (..., 6) [m, rad] on the leaf, in the links' frame, by φ [rad]."""
    angles, moved = np.asarray(angle, dtype=np.float64)[..., None], poses.copy()
    for link in reversed(links):
        axis, anchor = np.array(link.axis), np.array(link.anchor)
        place = np.asarray(polyval(angles, (0.0, *link.gains)), dtype=np.float64)
        if link.slides:
            moved[..., :3] += place * axis
            continue
        moved[..., :3] = anchor + rotated(moved[..., :3] - anchor, axis, place)
        moved[..., 3:] = compose_rotvecs(place * axis, moved[..., 3:])
    return moved


def rotated(vector: Array, axis: Array, angles: Array) -> Array:
    """Return a vector, (..., 3), turned about a unit axis by angles [rad], (..., 1)."""
    along = (vector * axis).sum(axis=-1, keepdims=True) * axis
    across = vector - along
    aside = np.sin(angles) * cross(axis, across)
    return np.asarray(along + np.cos(angles) * across + aside)


def fading_torques(door: DoorConfig) -> tuple[tuple[float, float], ...]:
    """Return torques at the closed door [N m] and the angles [rad] of their zeros."""
    boost = door.closer.boost, door.closer.boost_angle
    return (door.stiction, STICTION_ANGLE), (door.seal, door.seal_angle), boost


def has_tendons(door: DoorConfig) -> bool:
    """Return whether the closer has more than preload, stiffness and friction."""
    one_way = door.closer.closing_damping + door.closer.backcheck_damping
    return one_way > 0.0 or any(torque > 0.0 for torque, _ in fading_torques(door))


@dataclass(frozen=True, kw_only=True, slots=True)
class CloserLaw:
    """The closing torque of a door's closer, seal and stiction; friction if it moves.

    Fields are those of a `DoorConfig`, or arrays (n,) for n doors; `fading` is the
    result of `fading_torques`.
    """

    preload: Number
    stiffness: Number
    fading: tuple[tuple[Number, Number], ...]
    friction: Number
    damping: Number
    closing_damping: Number
    backcheck_damping: Number
    backcheck_angle: Number
    springs_alone: Flag
    """Whether only preload and stiffness are not zero, as for most doors."""

    @classmethod
    def of(cls, door: DoorConfig) -> "CloserLaw":
        """Return the closer law of a door."""
        further = door.closer.friction or door.closer.damping or has_tendons(door)
        preload, stiffness = door.closing_spring
        return cls(
            preload=preload,
            stiffness=stiffness,
            fading=fading_torques(door),
            friction=door.closer.friction,
            damping=door.closer.damping,
            closing_damping=door.closer.closing_damping,
            backcheck_damping=door.closer.backcheck_damping,
            backcheck_angle=door.closer.backcheck_angle,
            springs_alone=not further,
        )

    def torque(self, angle: Number, velocity: Number) -> Number:
        """Return the closing torque [N m] at an angle [rad] and its rate [rad/s]."""
        opened = where(angle > 0.0, angle, 0.0)
        torque = self.preload + self.stiffness * opened
        if not anywhere(negated(self.springs_alone)):
            return torque
        for closed, faded in self.fading:
            torque = torque + closed * larger(1.0 - opened / faded, 0.0)
        backcheck = where(angle > self.backcheck_angle, self.backcheck_damping, 0.0)
        damping = self.damping + where(velocity < 0.0, self.closing_damping, backcheck)
        friction = where(velocity < 0.0, -self.friction, self.friction)
        torque = torque + where(magnitude(velocity) > _SPEED, friction, 0.0)
        return torque + damping * velocity
