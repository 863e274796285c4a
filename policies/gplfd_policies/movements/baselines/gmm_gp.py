"""A Gaussian process whose prior is a Gaussian mixture regression.

Equation numbers refer to Jaquier, Ginsbourger, Calinon, *Learning from demonstration
with model-based Gaussian process*, CoRL 2019.

The prior mean is the mean m(t) of the regression, the prior covariance between two
phases

    K(t, t') = Σ_l h_l(t) h_l(t') Σ̂_l k_l(t, t'),

with the responsibilities h_l and conditional covariances Σ̂_l (6 × 6) of the mixture and
a Matérn-5/2 correlation k_l per component. Demonstrations teach the mixture and the
length-scales; then they are discarded, and only via-points are conditioned on. Beyond
the length-scales, and where no component is shared, the movement stays as demonstrated.

Note:
    K(t, t) = Σ_l h_l² Σ̂_l is less than the covariance of the regression where
    components overlap: up to C times, and the disagreement of their means is missing.
    The published method is over-confident there. ``weight_power = 0.5`` gives
    Σ_l h_l Σ̂_l instead.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import cho_factor, cho_solve, solve_triangular

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.baselines.gmr import (
    GaussianMixtureRegression,
    GMRConfig,
    fit_gmr,
)
from gplfd_policies.movements.baselines.mixture_kernel import (
    LengthScaleConfig,
    MixtureKernel,
    fit_kernel,
)
from gplfd_policies.movements.baselines.moments import MomentMovement, Moments
from gplfd_policies.movements.trajectory import ViaPoint

_STRONGEST = 1e-4
"""Least standard deviation of a via-point, standardised, so that demands of zero,
repeated and contradicting ones have an answer: the average."""


@dataclass(frozen=True, kw_only=True, slots=True)
class GMMGPConfig:
    """How prior and length-scales are learned.

    Raises:
        ValueError: if `weight_power` is not positive and finite.
    """

    mixture: GMRConfig = field(default_factory=lambda: GMRConfig(components=6))
    """The mixture behind the prior; 6 components as published for letters."""
    length_scales: LengthScaleConfig = field(default_factory=LengthScaleConfig)
    """How the length-scales are learned."""
    weight_power: float = quantity(1.0, above=0.0)
    """Power of the responsibilities in the kernel; 1 as published."""

    def __post_init__(self) -> None:
        check_quantities(self)


@dataclass(frozen=True, kw_only=True, slots=True)
class _Posterior:
    """The prior conditioned on the constrained outputs of V via-points."""

    phases: Float[np.ndarray, " V"]
    entries: Int[np.ndarray, " P"]
    """Indices of the P constrained outputs among the 6 V, output by output."""
    lower: Float[np.ndarray, "P P"]
    """Cholesky factor of their covariance, noise included."""
    solved: Float[np.ndarray, " P"]
    """Its inverse times what the prior mean misses them by."""

    def against(
        self, kernel: MixtureKernel, times: Float[np.ndarray, " M"]
    ) -> Float[np.ndarray, "P 6*M"]:
        """Prior covariance of the constrained outputs with all outputs at ``times``."""
        across = kernel(self.phases, times).reshape(-1, 6 * len(times))
        return np.asarray(across[self.entries])


@dataclass(frozen=True, kw_only=True, repr=False)
class GMMGaussianProcess(MomentMovement):
    """A learned movement that via-points adapt; made by `fit_gmm_gp`, immutable.

    For V via-points and M phases a prediction costs O(V³ D³ + V² D² M D), D = 6; no
    via-point is left out to save time.
    """

    kernel: MixtureKernel
    """Prior covariance, and the regression that is the prior mean."""
    via_points: tuple[ViaPoint, ...] = ()
    """What it is conditioned on."""

    @property
    def regression(self) -> GaussianMixtureRegression:
        """The regression that is the prior mean."""
        return self.kernel.regression

    def adapt(self, via_points: Sequence[ViaPoint]) -> "GMMGaussianProcess":
        """The process conditioned on further via-points.

        The noise of a via-point is its own standard deviation, where the published code
        takes one noise for all, learned from the demonstrations.

        Args:
            via_points: poses to be reached, in any order; NaN or an infinite standard
                deviation leaves an output free.
        """
        return replace(self, via_points=(*self.via_points, *via_points))

    @cached_property
    def _posterior(self) -> _Posterior | None:
        """The conditioned process; None without any constrained output."""
        if not self.via_points:
            return None
        standardisation = self.regression.standardisation
        phases = np.array([point.phase for point in self.via_points])
        noise = np.stack([point.own_variance for point in self.via_points], axis=1)
        noise = (noise / standardisation.scale[:, None] ** 2).ravel()
        entries = np.flatnonzero(np.isfinite(noise))
        if entries.size == 0:
            return None
        poses = np.stack([point.pose for point in self.via_points])
        mean, _ = self.regression.standardised_moments(phases)
        missed = (standardisation.apply(poses) - mean).T.ravel()[entries]
        full = self.kernel(phases, phases).reshape(6 * len(phases), -1)
        covariance = (
            full if entries.size == len(full) else full[np.ix_(entries, entries)]
        )
        covariance.flat[:: len(covariance) + 1] += np.maximum(
            noise[entries], _STRONGEST**2
        )
        along = np.stack([point.along for point in self.via_points], axis=1)
        along = (along / standardisation.scale[:, None]).ravel()[entries]
        which = entries % len(phases)
        covariance += np.where(which[:, None] == which, np.outer(along, along), 0.0)
        # Transposed it is the same matrix, in the order that LAPACK does not copy.
        lower, _ = cho_factor(covariance.T, lower=True, overwrite_a=True)
        return _Posterior(
            phases=phases,
            entries=entries,
            lower=lower,
            solved=cho_solve((lower, True), missed),
        )

    def _moments(self, times: Float[np.ndarray, " M"]) -> Moments:
        mean, _ = self.regression.standardised_moments(times)
        variance = self.kernel.variance(times)
        posterior = self._posterior
        if posterior is not None:
            across = posterior.against(self.kernel, times)
            shape = (6, len(times))
            mean = mean + (posterior.solved @ across).reshape(shape).T
            half = solve_triangular(
                posterior.lower, across, lower=True, check_finite=False
            )
            explained = np.einsum("pm,pm->m", half, half).reshape(shape).T
            variance = np.maximum(variance - explained, 0.0)
        return self.regression.standardisation.moments(mean, variance)

    def _covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "6 M M"]:
        prior = self.kernel(times, times)
        covariance = np.stack([prior[output, :, output] for output in range(6)])
        posterior = self._posterior
        if posterior is not None:
            across = posterior.against(self.kernel, times)
            half = solve_triangular(posterior.lower, across, lower=True)
            half = half.reshape(-1, 6, len(times))
            covariance -= np.einsum("pdm,pdn->dmn", half, half, optimize=True)
        return self.regression.standardisation.covariance(covariance)


@one_thread
def fit_gmm_gp(
    aligned: AlignedDemonstrations, config: GMMGPConfig | None = None
) -> GMMGaussianProcess:
    """Learn the process: fit the mixture, then the length-scales by likelihood.

    Args:
        aligned: demonstrations on common phases.
        config: how; the defaults of `GMMGPConfig` if None.

    Raises:
        ValueError: if there are more components than phases.
    """
    config = GMMGPConfig() if config is None else config
    regression = fit_gmr(aligned, config.mixture)
    kernel = fit_kernel(regression, config.length_scales, config.weight_power)
    return GMMGaussianProcess(aligned=aligned, kernel=kernel)
