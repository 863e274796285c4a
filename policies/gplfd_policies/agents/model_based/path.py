"""Path of the hand through one opening, in stretches."""

import math
from typing import Final

import numpy as np
from jaxtyping import Float

Point = Float[np.ndarray, " 3"]

_PULL: Final = np.array([1.0, 0.0, 0.0])
"""The direction in which a closed door is pulled, task frame."""


class HandPath:
    """The hand's path since the closed door in stretches, a mean position of each.

    Args:
        spacing: Length of a stretch [m]: several times the noise of a position, so that
            a hand that stands still adds nothing. Tuned.
        chord: Number of stretches that the last displacement spans. Tuned.
    """

    def __init__(self, *, spacing: float = 0.005, chord: int = 12) -> None:
        self._spacing, self._chord = spacing, chord
        self.reset()

    @property
    def points(self) -> Float[np.ndarray, "N 3"]:
        """Mean position of every stretch so far [m]."""
        return self._points

    def reset(self) -> None:
        """Begin at the closed door."""
        self._points, self._last = np.zeros((0, 3)), np.zeros(3)
        self._sum, self._count = np.zeros(3), 0

    def add(self, position: Point) -> bool:
        """Add a position of the hand [m]; return whether it ends a stretch."""
        self._sum += position
        self._count += 1
        if math.dist(position, self._last) < self._spacing:
            return False
        self._last = position.copy()
        self._points = np.vstack([self._points, self._sum / self._count])
        self._sum, self._count = np.zeros(3), 0
        return True

    def direction(self) -> Point:
        """Return the direction of the last displacement; at first that of the pull."""
        missing = self._chord - len(self._points)
        if missing == self._chord:
            return _PULL
        start = -missing * self._spacing * _PULL
        if missing <= 0:
            start = self._points[-self._chord]
        chord = self._points[-1] - start
        return np.asarray(chord / np.sqrt(chord @ chord))


def turned_towards(direction: Point) -> Point:
    """Return the shortest turn from the pull onto a unit vector, a rotation vector."""
    _, up, left = direction
    across = np.array([0.0, -left, up])
    sine = math.hypot(up, left)
    scale = math.atan2(sine, direction[0]) / sine if sine > 1e-9 else 1.0
    return np.asarray(scale * across)
