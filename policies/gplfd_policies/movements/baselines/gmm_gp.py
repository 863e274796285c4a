"""A Gaussian process whose prior is a Gaussian mixture regression.

Jaquier, Ginsbourger, Calinon, *Learning from demonstration with model-based Gaussian
process*, CoRL 2019. The prior mean is the mean m(t) of the regression, the prior
covariance between two phases

    K(t, t') = Σ_l h_l(t) h_l(t') Σ̂_l k_l(t, t'),

with the responsibilities h_l and conditional covariances Σ̂_l (6 × 6) of the mixture
and a Matérn-5/2 correlation k_l per component. The mixture and the length-scales are
learned from demonstrations; the process is conditioned only on via-points.

As published, K(t, t) = Σ_l h_l² Σ̂_l is over-confident where components overlap.
``weight_power = 0.5`` gives Σ_l h_l Σ̂_l.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.records import thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.conditioning import ConditionedFunctions, Places
from gplfd_policies.movements.baselines.gmr import (
    GaussianMixtureRegression,
    GMRConfig,
    fit_gmr,
)
from gplfd_policies.movements.movement import MomentMovement, Moments, ViaPoint

# Published values are for letters, which were written over 2 s and vary by 25 cm²:
# seconds are halved and variances divided by 25.
FIRST_LENGTH_SCALE = 2.5
"""Length-scale at which the search starts [phase]; published 5 s."""
LONGEST_LENGTH_SCALE = 5.0
"""Greatest length-scale of the search [phase]; published 10 s."""
NOISE_RANGE = (4e-5, 2e-3)
"""Allowed variance of the demonstrations' noise, standardised; published [0.001, 0.05]
cm². Without the upper limit most length-scales reach theirs."""
_STRONGEST = 1e-4  # Least standard deviation of a via-point, standardised.


@dataclass(frozen=True, kw_only=True, slots=True)
class GMMGPConfig(Quantities):
    """How prior and length-scales are learned."""

    components: int = quantity(6, low=1)
    """Gaussians of the mixture behind the prior; as published."""
    shortest_length_scale: float = quantity(0.005, above=0.0, high=FIRST_LENGTH_SCALE)
    """Least length-scale [phase]; published 0.01 s."""
    phases: int = quantity(50, low=2)
    """Number of evenly spread phases that enter the likelihood; cost is cubic."""
    weight_power: float = quantity(1.0, above=0.0)
    """Power of the responsibilities in the kernel; 1 as published."""


@dataclass(frozen=True, kw_only=True, slots=True)
class MixtureKernel:
    """K(t, t') = Σ_l h_l(t)^p h_l(t')^p Σ̂_l k_l(t, t'), standardised outputs."""

    regression: GaussianMixtureRegression
    length_scales: Float[np.ndarray, " C"]
    """ℓ_l of the Matérn-5/2 correlation k_l [phase]."""
    weight_power: float = 1.0

    def places(self, times: Times) -> Places:
        """Return what covariances depend on at phases: t and h_l(t)^p."""
        return times, self.weights(times).T

    def __call__(self, a: Places, b: Places) -> Float[np.ndarray, "A 6 B 6"]:
        """Covariance of every output at ``a`` with every output at ``b``."""
        distance = np.sqrt(5.0) * np.abs(np.subtract.outer(a[0], b[0]))
        scaled = distance / self.length_scales[:, None, None]
        correlation = (1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled)
        correlation *= a[1].T[:, :, None] * b[1].T[:, None, :]
        outputs = self.regression.conditional_covariances
        joint = np.tensordot(correlation, outputs, axes=(0, 0))
        return np.ascontiguousarray(joint.transpose(0, 2, 1, 3))

    def variance(self, times: Times) -> Outputs:
        """Diagonal of K(t, t) for every output."""
        outputs = self.regression.conditional_covariances
        diagonals = np.diagonal(outputs, axis1=1, axis2=2)
        return np.asarray(self.weights(times).T ** 2 @ diagonals)

    def weights(self, times: Times) -> Float[np.ndarray, "C M"]:
        """h_l(t)^p."""
        weights: np.ndarray = self.regression.responsibilities(times).T
        return weights**self.weight_power


class NoiseLikelihood:
    """Likelihood of the demonstrations as noisy observations of one function.

    It has the prior mean m(t) and covariance K. The average, with noise σ²/D, and the
    scatter, which depends only on σ², are sufficient.
    """

    def __init__(
        self, regression: GaussianMixtureRegression, phases: int, weight_power: float
    ) -> None:
        """Take the regression's demonstrations at a number of phases."""
        self.regression, self.weight_power = regression, weight_power
        aligned = regression.aligned
        chosen = thinned(len(aligned.times), phases)
        self.times = aligned.times[chosen]
        samples = regression.standardisation.apply(aligned.poses[:, chosen])
        average, self.count = samples.mean(axis=0), len(samples)
        mean, _ = regression.standardised_moments(self.times)
        self.residual = (average - mean).ravel()
        self.scatter = float(np.sum((samples - average) ** 2))

    def negative_log_likelihood(
        self, log_parameters: Float[np.ndarray, " H"]
    ) -> tuple[float, Float[np.ndarray, " H"]]:
        """Value and gradient, up to a constant."""
        length_scales = np.exp(log_parameters[:-1])
        noise = float(np.exp(log_parameters[-1]))
        kernel = MixtureKernel(
            regression=self.regression,
            length_scales=length_scales,
            weight_power=self.weight_power,
        )
        size, share = self.residual.size, noise / self.count
        places = kernel.places(self.times)
        covariance = kernel(places, places).reshape(size, size)
        covariance.flat[:: size + 1] += share
        factor = scipy.linalg.cho_factor(covariance.T, lower=True, overwrite_a=True)
        solved = scipy.linalg.cho_solve(factor, self.residual)
        log_root = float(np.sum(np.log(np.diag(factor[0]))))
        free = (self.count - 1) * size
        value = log_root + 0.5 * float(self.residual @ solved)
        value += 0.5 * (free * np.log(noise) + self.scatter / noise)
        # ∂/∂θ = ½ tr[(C⁻¹ − C⁻¹ r rᵀ C⁻¹) ∂C/∂θ]
        inner = scipy.linalg.cho_solve(factor, np.eye(size)) - np.outer(solved, solved)
        by_noise = 0.5 * (share * np.trace(inner) + free - self.scatter / noise)
        # ∂k/∂log ℓ of the Matérn-5/2 correlation, for every component.
        distance = np.sqrt(5.0) * np.abs(np.subtract.outer(self.times, self.times))
        scaled = distance / length_scales[:, None, None]
        slope = scaled**2 * (1.0 + scaled) / 3.0 * np.exp(-scaled)
        weights = kernel.weights(self.times)
        slope *= weights[:, :, None] * weights[:, None, :]
        over_outputs = np.tensordot(
            self.regression.conditional_covariances,
            inner.reshape(len(self.times), 6, len(self.times), 6),
            axes=([1, 2], [1, 3]),
        )
        by_scale = 0.5 * np.sum(over_outputs * slope, axis=(1, 2))
        return value, np.append(by_scale, by_noise)


@dataclass(frozen=True, kw_only=True, repr=False)
class GMMGaussianProcess(MomentMovement):
    """A learned movement that via-points adapt; made by `fit_gmm_gp`, immutable."""

    regression: GaussianMixtureRegression
    """The prior mean."""
    kernel: MixtureKernel
    """The prior covariance."""
    seen: ConditionedFunctions
    """Deviation from the prior mean, given via-points; standardised."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> "GMMGaussianProcess":
        """The process conditioned on further via-points, each with its own noise."""
        standardisation, seen = self.regression.standardisation, self.seen
        for via_point in via_points:
            phase = np.array([float(via_point.phase)])
            mean, _ = self.regression.standardised_moments(phase)
            noise = via_point.own_variance / standardisation.scale**2
            seen, _ = seen.given(
                self.kernel.places(phase),
                standardisation.apply(via_point.pose) - mean[0],
                np.maximum(noise, _STRONGEST**2),
                np.asarray(via_point.along) / standardisation.scale,
            )
        return replace(self, seen=seen)

    def _moments(self, times: Times) -> Moments:
        mean, _ = self.regression.standardised_moments(times)
        change, half = self.seen.explained(self.kernel.places(times))
        explained = np.einsum("pmi,pmi->mi", half, half)
        variance = np.maximum(self.kernel.variance(times) - explained, 0.0)
        return self.regression.standardisation.moments(mean + change, variance)

    def _covariance(self, times: Times) -> Covariances:
        places = self.kernel.places(times)
        covariance = np.einsum("mini->imn", self.kernel(places, places))
        half = self.seen.explained(places)[1].transpose(2, 1, 0)
        covariance = covariance - half @ half.mT
        return self.regression.standardisation.covariance(covariance)


def fit_gmm_gp(
    aligned: AlignedDemonstrations, config: GMMGPConfig = GMMGPConfig()
) -> GMMGaussianProcess:
    """Learn the process: fit the mixture, then the length-scales by likelihood."""
    regression = fit_gmr(aligned, GMRConfig(components=config.components))
    evidence = NoiseLikelihood(regression, config.phases, config.weight_power)
    count = len(regression.weights)
    start = np.append(np.full(count, FIRST_LENGTH_SCALE), np.sqrt(np.prod(NOISE_RANGE)))
    scales = np.log([config.shortest_length_scale, LONGEST_LENGTH_SCALE])
    result = scipy.optimize.minimize(
        evidence.negative_log_likelihood,
        np.log(start),
        jac=True,
        method="L-BFGS-B",
        bounds=[tuple(scales)] * count + [tuple(np.log(NOISE_RANGE))],
        # The scatter makes the value large and almost constant.
        options={"ftol": 1e-15, "gtol": 1e-5},
    )
    lengths, power = np.exp(result.x[:-1]), config.weight_power
    kernel = MixtureKernel(
        regression=regression, length_scales=lengths, weight_power=power
    )
    seen = ConditionedFunctions(kernel, kernel.places(np.empty(0)))
    return GMMGaussianProcess(
        aligned=aligned, regression=regression, kernel=kernel, seen=seen
    )
