"""Outputs of order one, for methods whose settings are absolute numbers."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.records import freeze
from gplfd_policies.demonstrations.aligned import FINEST


@dataclass(frozen=True, kw_only=True, slots=True)
class Standardisation:
    """Poses minus their average, over their standard deviation, per output."""

    offset: Float[np.ndarray, "6"]
    """Average over demonstrations and phases [m, rad]."""
    scale: Float[np.ndarray, "6"]
    """Standard deviation over both [m, rad]."""

    def __post_init__(self) -> None:
        freeze(self, "offset", "scale")

    @classmethod
    def of(cls, poses: Float[np.ndarray, "K M 6"]) -> "Standardisation":
        """The standardisation of these demonstrations."""
        scale = np.maximum(poses.std(axis=(0, 1)), FINEST)
        return cls(offset=poses.mean(axis=(0, 1)), scale=scale)

    def apply(self, poses: Float[np.ndarray, "... 6"]) -> Float[np.ndarray, "... 6"]:
        """Poses in standard deviations from their average."""
        return np.asarray((poses - self.offset) / self.scale)

    def undo(
        self, standardised: Float[np.ndarray, "... 6"]
    ) -> Float[np.ndarray, "... 6"]:
        """Poses [m, rad] of standardised ones."""
        return np.asarray(self.offset + self.scale * standardised)

    def moments(
        self, mean: Float[np.ndarray, "M 6"], variance: Float[np.ndarray, "M 6"]
    ) -> tuple[Float[np.ndarray, "M 6"], Float[np.ndarray, "M 6"]]:
        """Mean and standard deviation [m, rad] of standardised mean and variance."""
        return self.undo(mean), self.scale * np.sqrt(variance)

    def covariance(
        self, standardised: Float[np.ndarray, "6 M M"]
    ) -> Float[np.ndarray, "6 M M"]:
        """Covariance over time [m², rad²] of a standardised one."""
        return np.asarray(self.scale[:, None, None] ** 2 * standardised)
