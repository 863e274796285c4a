"""Learning around a prior mean: processes of what it leaves over.

A Gaussian process with the prior mean m(t) of Eq. (1) in Arduengo et al.,
*Gaussian-Process-based Robot Learning from Demonstration*, arXiv:2002.09979, is m(t)
plus a process of prior mean zero, learned from y − m(t). Far from the demonstrations it
returns to m(t); variances do not depend on m(t). Via-points are shifted likewise
(``test_adaptation_is_that_of_the_residual_plus_the_prior_mean``).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import (
    AdaptationForm,
    LearnedMovement,
    Movement,
)
from gplfd_policies.movements.prior_mean import PriorMean
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint


@dataclass(frozen=True, kw_only=True, repr=False)
class ResidualMovement(LearnedMovement):
    """A prior mean and a movement learned from the rest; made by `fit_residual`."""

    prior_mean: PriorMean
    """m(t)."""
    residual: Movement
    """Learned from the demonstrations less m(t), with a prior mean of zero."""

    def save(self, path: str | Path) -> None:
        """Refuse: a prior mean may be any code, which no file of arrays holds.

        Raises:
            ValueError: always.
        """
        raise ValueError(
            f"a movement around a prior mean cannot be saved to {path}: the prior mean "
            "may be any code. Save the demonstrations, and learn from them again"
        )

    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution of the pose at ``times``.

        Args:
            times: phases, shape (M,). Far outside the demonstrated range the mean is
                the prior mean.
        """
        return _raised(self.residual.predict(times), self.prior_mean)


def fit_residual(
    aligned: AlignedDemonstrations,
    prior_mean: PriorMean,
    fit: Callable[[AlignedDemonstrations], Movement],
) -> ResidualMovement:
    """Learn a movement around a prior mean.

    Args:
        aligned: D demonstrations on common phases.
        prior_mean: m(t).
        fit: learns the residual with a prior mean of zero, such as
            ``partial(fit_skill, centred=False)``.

    Raises:
        ValueError: if the prior mean is not a finite pose at every phase.
    """
    expected = np.asarray(prior_mean.mean(aligned.times))
    if expected.shape != aligned.poses.shape[1:] or not np.isfinite(expected).all():
        raise ValueError(
            f"a prior mean must give a finite pose at each of {len(aligned.times)} "
            f"phases, an array of shape {aligned.poses.shape[1:]}; got {expected}"
        )
    # A repetition that runs late is late on m(t), too, of which the residual knows
    # nothing: phases are certain here.
    rest = replace(aligned, poses=aligned.poses - expected, clocks=None)
    return ResidualMovement(aligned=aligned, prior_mean=prior_mean, residual=fit(rest))


class ResidualAdaptation:
    """Online adaptation of a residual, reported with its prior mean.

    Args:
        form: adapts the residual.
        movement: what was learned.
        grid: phases at which the distribution is reported, shape (M,).
    """

    def __init__(
        self,
        form: AdaptationForm,
        movement: ResidualMovement,
        grid: Float[np.ndarray, " M"],
    ) -> None:
        self._prior_mean = movement.prior_mean
        self._expected = movement.prior_mean.mean(grid)
        self._residual = form(movement.residual, grid)

    def observe(self, via_point: ViaPoint) -> None:
        """Take one more via-point, in place."""
        self._residual.observe(_lowered(via_point, self._prior_mean))

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """Current mean on the grid [m, rad], read-only."""
        mean: np.ndarray = self._expected + self._residual.mean
        mean.setflags(write=False)
        return mean

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid [m, rad]."""
        return self._residual.std

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid."""
        return _raised(self._residual.trajectory(), self._prior_mean)


def _raised(rest: GaussianTrajectory, prior_mean: PriorMean) -> GaussianTrajectory:
    """Add the prior mean to the distribution of a residual."""
    return replace(
        rest,
        mean=rest.mean + prior_mean.mean(rest.times),
        mean_rate=rest.mean_rate + prior_mean.rate(rest.times),
    )


def _lowered(via_point: ViaPoint, prior_mean: PriorMean) -> ViaPoint:
    """Subtract the prior mean from a via-point; outputs left free stay so."""
    expected = prior_mean.mean(np.array([via_point.phase]))[0]
    return replace(via_point, pose=via_point.pose - expected)
