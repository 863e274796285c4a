"""What an agent remembers of its hand's way through one opening."""

import math
from typing import Final

import numpy as np
from jaxtyping import Float

Point = Float[np.ndarray, " 3"]

_SPACING: Final = 0.005
"""Length of a stretch [m]: several times the noise of a position, so that a hand that
stands still adds nothing."""
_CHORD: Final = 12
"""Stretches that the last displacement spans: six centimetres."""
_PULL: Final = np.array([1.0, 0.0, 0.0])
"""The direction in which a closed door is pulled, task frame."""


class HandPath:
    """The hand's way since the closed door in stretches, a mean position of each."""

    def __init__(self) -> None:
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
        """Take in where the hand is [m]; return whether this ends a stretch."""
        self._sum += position
        self._count += 1
        if math.dist(position, self._last) < _SPACING:
            return False
        self._last = position.copy()
        self._points = np.vstack([self._points, self._sum / self._count])
        self._sum, self._count = np.zeros(3), 0
        return True

    def direction(self) -> Point:
        """Return the direction of the last displacement, a unit vector.

        Before there is any it is the direction of the pull: as if the hand had come
        straight to the handle.
        """
        missing = _CHORD - len(self._points)
        if missing == _CHORD:
            return _PULL
        start = -missing * _SPACING * _PULL if missing > 0 else self._points[-_CHORD]
        chord = self._points[-1] - start
        return np.asarray(chord / np.sqrt(chord @ chord))


def turned_towards(direction: Point) -> Point:
    """Return the shortest rotation from the pull onto a unit vector, a rotation vector.

    A hand that turns so keeps the angle at which it took the handle.
    """
    _, up, left = direction
    across = np.array([0.0, -left, up])
    sine = math.hypot(up, left)
    scale = math.atan2(sine, direction[0]) / sine if sine > 1e-9 else 1.0
    return np.asarray(scale * across)
