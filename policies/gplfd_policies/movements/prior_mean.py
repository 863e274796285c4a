"""Prior means of movements, and learning around them.

A Gaussian process with the prior mean m(t) of Eq. (1) is m(t) plus a process of prior
mean zero, learned from the residual y − m(t), with the same variances
(``test_adaptation_is_that_of_the_residual_plus_the_prior_mean``).
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import cached_property
from pathlib import Path
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy

from gplfd_policies.arrays.records import own_arrays, short_repr
from gplfd_policies.arrays.shapes import Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import (
    AdaptationForm,
    GaussianTrajectory,
    LearnedMovement,
    Movement,
    ViaPoint,
    as_movement,
)


@runtime_checkable
class PriorMean(Protocol):
    """Expected poses far from demonstrations.

    Phases are those of the aligned demonstrations, 0 to 1, and later ones for methods
    that continue beyond the end. Rotation vectors are on the demonstrations' branch.
    """

    def mean(self, times: Times) -> Outputs:
        """Poses [m, rad] at phases, task frame."""

    def rate(self, times: Times) -> Outputs:
        """Derivative of these poses, per unit phase."""


@dataclass(frozen=True, kw_only=True)
class PosePath:
    """A prior mean through given poses, each output by a cubic without overshoot.

    Before the first and after the last pose it is constant.

    Raises:
        ValueError: A wrong shape, numbers that are not finite, phases not increasing.
    """

    phases: Float[np.ndarray, " N"]
    """At least two phases, strictly increasing; may lie outside [0, 1]."""
    poses: Float[np.ndarray, "N 6"]
    """Pose at each phase [m, rad], task frame."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        own_arrays(self, "phases", "poses")
        phases, poses = self.phases, self.poses
        if phases.ndim != 1 or phases.size < 2 or poses.shape != (phases.size, 6):
            raise ValueError(
                "a path needs phases of shape (N,) and poses of shape (N, 6), N at "
                f"least 2; got {phases.shape} and {poses.shape}"
            )
        if not np.isfinite(poses).all() or not (np.diff(phases) > 0.0).all():
            raise ValueError(
                "phases of a path must increase strictly and poses be finite, got "
                f"{phases} and {poses}"
            )

    @cached_property
    def _curve(self) -> Any:
        return scipy.interpolate.PchipInterpolator(self.phases, self.poses, axis=0)

    def mean(self, times: Times) -> Outputs:
        """Poses [m, rad] at phases."""
        within = np.clip(times, self.phases[0], self.phases[-1])
        return np.asarray(self._curve(within))

    def rate(self, times: Times) -> Outputs:
        """Derivative of the poses, per unit phase; zero beyond the ends."""
        within = (times >= self.phases[0]) & (times <= self.phases[-1])
        return np.where(within[:, None], self._curve(times, nu=1), 0.0)


@dataclass(frozen=True, kw_only=True, repr=False)
class ResidualMovement(LearnedMovement):
    """A prior mean and a movement learned from the residual; made by `fit_residual`."""

    prior_mean: PriorMean
    residual: Movement
    """Movement learned from the demonstrations minus m(t), with prior mean zero."""

    def expected(self, times: Times) -> Outputs:
        """Poses m(t) at phases of the continued demonstrations [m, rad]."""
        return self.prior_mean.mean(1.0 / self.aligned.end * times)

    def raised(self, rest: GaussianTrajectory) -> GaussianTrajectory:
        """Add the prior mean to a distribution of the residual."""
        factor = 1.0 / self.aligned.end
        rate = factor * self.prior_mean.rate(factor * rest.times)
        return replace(
            rest,
            mean=rest.mean + self.expected(rest.times),
            mean_rate=rest.mean_rate + rate,
        )

    def save(self, path: str | Path) -> None:
        """Raise an error: a prior mean may be any code, so it cannot be saved."""
        raise ValueError(
            f"a movement around a prior mean cannot be saved to {path}: save the "
            "demonstrations, and learn from them again"
        )

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at ``times``; far from demonstrations, the prior mean."""
        return self.raised(self.residual.predict(times))


def fit_residual(
    aligned: AlignedDemonstrations,
    prior_mean: PriorMean,
    fit: Callable[[AlignedDemonstrations], object],
) -> ResidualMovement:
    """Learn a movement around a prior mean on phases of the demonstrations.

    They are 0 to 1 for what was demonstrated, and later ones for its continuation. The
    fit must use a prior mean of zero: ``partial(fit_skill, centred=False)``.
    """
    expected = np.asarray(prior_mean.mean(1.0 / aligned.end * aligned.times))
    if expected.shape != aligned.poses.shape[1:] or not np.isfinite(expected).all():
        raise ValueError(
            f"a prior mean must give a finite pose at each of {len(aligned.times)} "
            f"phases, an array of shape {aligned.poses.shape[1:]}; got {expected}"
        )
    # A late repetition is late on m(t), too, which the residual cannot express.
    rest = replace(aligned, poses=aligned.poses - expected, clocks=None)
    residual = as_movement(fit(rest), rest)
    return ResidualMovement(aligned=aligned, prior_mean=prior_mean, residual=residual)


class ResidualAdaptation:
    """Online adaptation of a residual, reported with its prior mean."""

    def __init__(
        self, form: AdaptationForm, movement: ResidualMovement, grid: Times
    ) -> None:
        self._movement, self._expected = movement, movement.expected(grid)
        self._residual = form(movement.residual, grid)

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on another via-point, in place."""
        # Unconstrained outputs stay unconstrained.
        expected = self._movement.expected(np.array([via_point.phase]))[0]
        self._residual.observe(replace(via_point, pose=via_point.pose - expected))

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid [m, rad]."""
        return np.asarray(self._expected + self._residual.mean)

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid [m, rad]."""
        return self._residual.std

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid."""
        return self._movement.raised(self._residual.trajectory())
