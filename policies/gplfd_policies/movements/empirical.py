"""The demonstrations' own mean and spread, whatever method learns from them."""

from functools import partial

import numpy as np
from jaxtyping import Float

from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.trajectory import GaussianTrajectory


class EmpiricalDistribution:
    """Sample mean and sample standard deviation of aligned demonstrations, by phase.

    Says where demonstrations were, for methods that predict no uncertainty. Between
    the phases of the alignment the demonstrations are interpolated linearly. A single
    demonstration has no spread: its standard deviation is zero.

    Args:
        aligned: The demonstrations.
    """

    def __init__(self, aligned: AlignedDemonstrations) -> None:
        self._aligned = aligned

    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution at phases ``times``; constant beyond the demonstrations."""
        poses = self._aligned.poses
        curves = np.stack(
            [
                [np.interp(times, self._aligned.times, output) for output in pose.T]
                for pose in poses
            ]
        )
        deviations = curves - curves.mean(axis=0)
        root = deviations / np.sqrt(max(len(poses) - 1, 1))
        return GaussianTrajectory.from_moments(
            times=times,
            mean=curves.mean(axis=0).T,
            std=np.sqrt(np.sum(root**2, axis=0)).T,
            covariance_function=partial(np.einsum, "kom,kon->omn", root, root),
        )
