"""What movements share that state mean and spread at any phase, and no derivatives."""

from abc import ABC, abstractmethod
from functools import partial

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.movements.movement import LearnedMovement
from gplfd_policies.movements.trajectory import GaussianTrajectory, checked_times

Moments = tuple[Float[np.ndarray, "M 6"], Float[np.ndarray, "M 6"]]
"""Mean and standard deviation at M phases, or mean and variance."""


class MomentMovement(LearnedMovement, ABC):
    """A movement whose rates are differences of its moments."""

    @abstractmethod
    def _moments(self, times: Float[np.ndarray, " M"]) -> Moments:
        """Mean and standard deviation of a repetition of the task [m, rad]."""

    @abstractmethod
    def _covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "6 M M"]:
        """Covariance over time of every output [m², rad²]."""

    @one_thread
    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution of the pose at ``times``.

        Args:
            times: phases, strictly increasing, shape (M,).

        Raises:
            ValueError: if there are no times, one is not finite, or they do not
                increase.
        """
        times = checked_times(times)
        mean, std = self._moments(times)
        covariance = partial(self._covariance, times)
        return GaussianTrajectory.from_moments(times, mean, std, covariance)
