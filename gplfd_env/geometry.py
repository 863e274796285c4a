"""Where a door's hinge is: what decides every pose of a hand that holds its handle."""

from __future__ import annotations

import math
from dataclasses import dataclass, field

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, slots=True)
class DoorGeometry:
    """A hinge axis in the task frame, whose origin is the hand at the closed door.

    Raises:
        ValueError: A vector is not of three finite numbers, the axis has no direction,
            or it passes through the handle.
    """

    hinge: Array
    """The point of the hinge axis nearest to the origin [m], (3,); given as any point
    of the axis."""

    axis: Array
    """Its direction, (3,), a unit vector; given with any length. A positive turn about
    it opens the door."""

    radius: float = field(init=False)
    """Distance of the hand from the hinge axis [m]."""

    pull: Array = field(init=False)
    """Direction in which the closed handle begins to move, (3,), a unit vector."""

    def __post_init__(self) -> None:
        hinge, axis = (np.array(each, float) for each in (self.hinge, self.axis))
        for name, vector in (("hinge", hinge), ("axis", axis)):
            if vector.shape != (3,) or not np.isfinite(vector).all():
                raise ValueError(
                    f"DoorGeometry.{name} must be three finite numbers, got {vector}"
                )
        length = math.sqrt(axis @ axis)
        axis = axis / length if length > 0.0 else axis
        hinge = hinge - (hinge @ axis) * axis
        radius = math.sqrt(hinge @ hinge)
        if not (length > 0.0 and radius > 0.0):
            raise ValueError(
                f"no door turns about {self.axis} through {self.hinge}: the axis must "
                "have a direction and not pass through the handle, the origin"
            )
        pull = np.cross(hinge, axis) / radius
        for name, vector in (("hinge", hinge), ("axis", axis), ("pull", pull)):
            vector.setflags(write=False)
            object.__setattr__(self, name, vector)
        object.__setattr__(self, "radius", radius)

    @classmethod
    def nominal(cls, radius: float) -> DoorGeometry:
        """Return the door of a radius [m] before a robot that stands right."""
        return cls(hinge=np.array([0.0, 0.0, -radius]), axis=np.array([0.0, 1.0, 0.0]))

    def hand_poses(self, angle: ArrayLike) -> Array:
        """Return the poses of a hand that holds the handle rigidly, at opening angles.

        exp(φ a) (0 - h) + h for the hinge h and the axis a, turned by φ a.

        Args:
            angle: Opening angles φ [rad], (...).

        Returns:
            (..., 6) position [m] and rotation vector [rad], task frame.
        """
        angles = np.asarray(angle, dtype=np.float64)[..., None]
        forward = self.radius * np.sin(angles) * self.pull
        back = (1.0 - np.cos(angles)) * self.hinge
        return np.concatenate([forward + back, angles * self.axis], axis=-1)

    def direction(self, angle: float) -> Array:
        """Return where the hand moves at an angle [rad]: a unit vector, (3,)."""
        inwards = self.hinge / self.radius
        return math.cos(angle) * self.pull + math.sin(angle) * inwards

    def angle(self, position: ArrayLike) -> Array:
        """Return the opening angles [rad], (...), at hand positions, (..., 3)."""
        lever = np.asarray(position, dtype=np.float64) - self.hinge
        return np.arctan2(lever @ self.pull, lever @ -self.hinge / self.radius)
