"""Outputs of order one, for methods whose settings are absolute numbers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

_SMALLEST_STD = 1e-6
"""No output is scaled more finely than a micrometre or a microradian."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Standardisation:
    """Poses minus their average, over their standard deviation, per output."""

    offset: Float[np.ndarray, "6"]
    """Average over demonstrations and phases [m, rad]."""
    scale: Float[np.ndarray, "6"]
    """Standard deviation over both [m, rad]."""

    @classmethod
    def of(cls, poses: Float[np.ndarray, "K M 6"]) -> "Standardisation":
        """The standardisation of these demonstrations."""
        scale = np.maximum(poses.std(axis=(0, 1)), _SMALLEST_STD)
        offset = poses.mean(axis=(0, 1))
        for array in (offset, scale):
            array.setflags(write=False)
        return cls(offset=offset, scale=scale)

    def apply(self, poses: Float[np.ndarray, "... 6"]) -> Float[np.ndarray, "... 6"]:
        """Standardised poses."""
        standardised: np.ndarray = (poses - self.offset) / self.scale
        return standardised

    def undo(
        self, standardised: Float[np.ndarray, "... 6"]
    ) -> Float[np.ndarray, "... 6"]:
        """Poses [m, rad]."""
        poses: np.ndarray = self.offset + self.scale * standardised
        return poses
