"""Position of hinge and handle axis, and the poses of a hand that holds the handle.

A *paddle* is a plate on a horizontal pin: the robot holds its edge, a horizontal rod.
The *touch bar* of an exit device is pushed towards the leaf; a real pad moves on a
straight line, here on an arc of the same depth. A *handleset* is a fixed grip with a
thumb piece above. Two fingers cannot press the thumb piece while they hold the grip:
they take the thumb piece itself, press it down and pull or push the door by it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from numpy.typing import ArrayLike

from gplfd_env.conventions.constants import Array
from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.motion import Link, carried, links_of, rotated
from gplfd_env.spatial.se3 import compose_rotvecs

ROCKERS: Final = ("paddle", "touch-bar", "handleset")
"""Handles with a horizontal axis in the leaf, `DoorConfig.handle_arm` from the hand."""

# Rotation of a hand per rotation of the leaf when it pushes a handle that it can hold
# from any side, and for a flap.
_TURN: Final = 0.5
_LEVEL_TURN: Final = 0.25
# The hinge axis counts as level if its upward component is below this.
_LEVEL: Final = 0.5
_SMALL: Final = 1e-6  # Step angle for numerical differentiation of paths [rad].
_ANGLES: Final = np.radians(np.linspace(-5.0, 100.0, 1051))
_NOT_TURNED: Final = ((1.0, 0.0, 0.0), (0.0, 1.0, 0.0), (0.0, 0.0, 1.0))
# An axis counts as across the pull if the cosine of their angle is below this.
_ACROSS: Final = 0.5
# A handle counts as a knob if it is nearer than this to its axis [m].
_ROUND: Final = 0.03


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorGeometry:
    """A hinge axis in the task frame, whose origin is the hand at the closed door.

    Raises a ValueError if a vector is not of three finite numbers, the axis has no
    direction, or it passes through the handle.
    """

    hinge: Array
    """The point of the axis nearest to the origin [m], (3,); given as any point."""
    axis: Array
    """Direction of the axis, (3,), given with any length; a positive turn opens the
    door."""
    spindle: Array | None = None
    """A point of the closed handle's axis [m], (3,); None if it does not turn."""
    turn: Array | None = None
    """Direction of that axis, (3,), given with any length; a positive turn retracts the
    bolt."""
    travel: float = 0.0
    """How far the handle can be turned [rad]; 0 if it does not turn."""
    links: tuple[Link, ...] = ()
    """Joints between frame and leaf, task frame; empty if the leaf only turns about
    this hinge. With links, `hinge`, `axis` and `radius` describe the upright axis at
    the jamb to which the leaf moves."""
    radius: float = field(init=False)
    """Distance of the hand from the hinge axis [m]."""
    pull: Array = field(init=False)
    """Direction in which the closed handle begins to move, (3,), a unit vector."""

    def __post_init__(self) -> None:
        hinge, axis = (np.array(vector, float) for vector in (self.hinge, self.axis))
        for name, vector in (("hinge", hinge), ("axis", axis)):
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise ValueError(f"DoorGeometry.{name} needs three numbers: {vector}")
        length = math.sqrt(axis @ axis)
        axis = axis / length if length > 0.0 else axis
        hinge = hinge - (hinge @ axis) * axis
        radius = math.sqrt(hinge @ hinge)
        if not (length > 0.0 and radius > 0.0):
            raise ValueError(
                f"no door turns about {self.axis} through {self.hinge}: it must have a "
                "direction and not pass through the handle, the origin"
            )
        pull = np.cross(hinge, axis) / radius
        if self.links:
            moved = carried(self.links, _SMALL, np.zeros(6))[:3]
            pull = moved / math.sqrt(moved @ moved)
        vectors = {"hinge": hinge, "axis": axis, "pull": pull}
        if self.spindle is not None and self.turn is not None:
            spindle, turn = np.array(self.spindle, float), np.array(self.turn, float)
            turn = turn / math.sqrt(turn @ turn)
            vectors |= {"spindle": spindle, "turn": turn}
        for name, vector in vectors.items():
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)
        object.__setattr__(self, "radius", radius)

    @classmethod
    def of(
        cls,
        door: DoorConfig,
        position: ArrayLike = (0.0, 0.0, 0.0),
        rotation: ArrayLike = _NOT_TURNED,
    ) -> DoorGeometry:
        """Return a door's geometry for a grasp at a position [m] with axes (3, 3)."""
        to_task, origin = np.asarray(rotation, float).T, np.asarray(position, float)
        side, turns = door.hinge_sign, door.handle != "bar"
        hinge = np.array([0.0, 0.0, -side * door.hand_radius])
        axis = np.array([0.0, side * door.swing_sign, 0.0])
        links = links_of(door)
        if len(links) == 1 and links[0].name == "hinge":
            hinge, axis, links = np.array(links[0].anchor), np.array(links[0].axis), ()
        spindle, turn = handle_axis(door)
        return cls(
            hinge=to_task @ (hinge - origin),
            axis=to_task @ axis,
            spindle=to_task @ (spindle - origin) if turns else None,
            turn=to_task @ turn if turns else None,
            travel=door.handle_travel if turns else 0.0,
            links=tuple(
                link._replace(
                    axis=tuple((to_task @ link.axis).tolist()),
                    anchor=tuple((to_task @ (link.anchor - origin)).tolist()),
                )
                for link in links
            ),
        )

    def seen_from(self, position: ArrayLike) -> DoorGeometry:
        """Return the same door in a frame with its origin at a position, (3,) [m]."""
        origin = np.asarray(position, dtype=np.float64)
        spindle = None if self.spindle is None else self.spindle - origin
        moved = [tuple((link.anchor - origin).tolist()) for link in self.links]
        pairs = zip(self.links, moved, strict=True)
        links = tuple(link._replace(anchor=anchor) for link, anchor in pairs)
        return replace(self, hinge=self.hinge - origin, spindle=spindle, links=links)

    def hand_poses(self, angle: ArrayLike, turn: ArrayLike = 0.0) -> Array:
        """Return the poses (..., 6) [m, rad] of a hand that holds the handle rigidly.

        At an opening angle φ [rad] the hand is at exp(φ a) (p - h) + h, rotated by φ a,
        for the hinge h, its axis a and the position p of the hand at the closed door.
        While the handle is not turned, p is the origin. When it is turned by θ [rad], p
        is s - exp(θ t) s, rotated by θ t, for the spindle s and its axis t. Angles
        broadcast. Raises a ValueError if `turn` is not 0, but the handle does not turn.
        """
        angles = np.asarray(angle, dtype=np.float64)[..., None]
        turns = np.asarray(turn, dtype=np.float64)[..., None]
        if turns.any() and (self.spindle is None or self.turn is None):
            raise ValueError("the handle of this door does not turn, but turn is not 0")
        if self.links:
            held = np.zeros((*np.broadcast_shapes(angles.shape, turns.shape)[:-1], 6))
            if self.spindle is not None and self.turn is not None:
                held[..., :3] = self.spindle - rotated(self.spindle, self.turn, turns)
                held[..., 3:] = turns * self.turn
            return carried(self.links, angle, held)
        forward = self.radius * np.sin(angles) * self.pull
        back = (1.0 - np.cos(angles)) * self.hinge
        opened = np.concatenate([forward + back, angles * self.axis], axis=-1)
        if self.spindle is None or self.turn is None or not turns.any():
            return opened
        turned = self.spindle - rotated(self.spindle, self.turn, turns)
        moved = rotated(turned, self.axis, angles)
        rotation = compose_rotvecs(angles * self.axis, turns * self.turn)
        position = opened[..., :3] + moved
        position, rotation = np.broadcast_arrays(position, rotation)
        return np.concatenate([position, rotation], axis=-1)

    def easy_hand_poses(self, angle: ArrayLike, turn: ArrayLike = 0.0) -> Array:
        """Return the poses of a hand that opens the door without straining its arm.

        Bars and knobs, and handles that turn about an axis across the pull, can be held
        from any side. When the hand pushes them, it turns by half as much as the leaf,
        so that the arm goes through the frame and not into the jamb. It also turns by
        half on a folding leaf, and by a quarter on the level bar of a flap. All other
        handles are held rigidly, as in `hand_poses`.
        """
        poses = self.hand_poses(angle, turn)
        spindle = self.spindle
        is_round = spindle is None or float(spindle @ spindle) < _ROUND**2
        if self.turn is not None:
            is_round |= abs(float(self.turn @ self.pull)) < _ACROSS
        share = 1.0
        if is_round and abs(self.axis[1]) < _LEVEL:
            share = _LEVEL_TURN
        # A folding leaf is hinged to another leaf that turns.
        elif is_round and (
            self.pull[0] < 0.0 or sum(not link.slides for link in self.links) > 1
        ):
            share = _TURN
        if share < 1.0:
            poses[..., 3:] = self.hand_poses(share * np.asarray(angle), turn)[..., 3:]
        return poses

    def direction(self, angle: float) -> Array:
        """Return the hand's direction of motion at an angle [rad], a unit vector."""
        if self.links:
            ends = self.hand_poses([angle - _SMALL, angle + _SMALL])[:, :3]
            step = ends[1] - ends[0]
            return np.asarray(step / math.sqrt(step @ step))
        inwards = self.hinge / self.radius
        return math.cos(angle) * self.pull + math.sin(angle) * inwards

    def angle(self, position: ArrayLike) -> Array:
        """Return opening angles [rad], (...), at hand positions, (..., 3), to 0.05°."""
        if self.links:
            path = self.hand_poses(_ANGLES)[:, :3]
            away = np.asarray(position, dtype=np.float64)[..., None, :] - path
            return np.asarray(_ANGLES[(away**2).sum(axis=-1).argmin(axis=-1)])
        lever = np.asarray(position, dtype=np.float64) - self.hinge
        return np.arctan2(lever @ self.pull, lever @ -self.hinge / self.radius)


def handle_axis(door: DoorConfig) -> tuple[Array, Array]:
    """Return point [m] and direction, (3,) each, of a closed handle's axis, door frame.

    The point is relative to the grasped point. A positive turn retracts the bolt: it
    presses a lever or a thumb piece down, and moves a paddle or a touch bar the way the
    door opens.
    """
    if door.handle == "handleset":
        # When pulled, it is level at its stop; when pushed, it is level at rest. Thus
        # the force that opens the door does not lift it.
        tilt = door.handle_travel if door.swing_sign > 0.0 else 0.0
        back, below = math.cos(tilt), math.sin(tilt)
        spindle = np.array([-door.handle_arm * back, -door.handle_arm * below, 0.0])
        return spindle, np.array([0.0, 0.0, -1.0])
    if door.handle in ROCKERS:
        turn = np.array([0.0, 0.0, door.swing_sign])
        return np.array([0.0, door.handle_arm, 0.0]), turn
    side = door.hinge_sign
    return np.array([0.0, 0.0, side * door.hand_offset]), np.array([-side, 0.0, 0.0])
