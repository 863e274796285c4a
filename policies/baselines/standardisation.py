"""Outputs of order one, for methods whose settings are absolute numbers."""

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np
from jaxtyping import Float

from policies.aligned import FINEST
from policies.records import freeze
from policies.trajectory import GaussianTrajectory


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

    def trajectory(
        self,
        times: Float[np.ndarray, " M"],
        mean: Float[np.ndarray, "M 6"],
        variance: Float[np.ndarray, "M 6"],
        covariance: Callable[[np.ndarray], np.ndarray],
    ) -> GaussianTrajectory:
        """The distribution of poses of which these are the standardised moments.

        Args:
            times: phases, strictly increasing, shape (M,).
            mean: standardised.
            variance: standardised.
            covariance: gives that over time, (6, M, M), standardised, for ``times``.
        """
        return GaussianTrajectory.from_moments(
            times,
            self.undo(mean),
            self.scale * np.sqrt(variance),
            partial(self._covariance, covariance, times),
        )

    def _covariance(
        self,
        standardised: Callable[[np.ndarray], np.ndarray],
        times: Float[np.ndarray, " M"],
    ) -> Float[np.ndarray, "6 M M"]:
        return np.asarray(self.scale[:, None, None] ** 2 * standardised(times))
