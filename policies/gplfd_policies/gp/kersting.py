"""The paper's noise estimate: Kersting's iteration, as printed and with its bias.

Section III-B of the paper, after Kersting et al. (2007).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.gp.hyperparameters import fit_kernel, fit_kernel_and_noise
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.gp.noise_profile import (
    LEAST_SCALE,
    LEAST_VARIANCE,
    SHORTEST_SCALE,
    NoiseProfile,
)
from gplfd_policies.gp.replicates import Replicates


@dataclass(frozen=True, kw_only=True, slots=True)
class KerstingNoise:
    """The paper's estimate: Kersting's "most likely" iteration.

    A homoscedastic process is fitted first; each observation then gives
    z = log ½((y − μ)² + s²), with μ and s² the current prediction (the closed form of
    Kersting's sampled expectation); a second process smooths z; and the loop repeats
    with r = exp z.

    Note:
        The fixed point is biased, and more demonstrations do not help: the standard
        deviation converges to about 0.81 of the truth. r can at most halve per pass,
        so a result after few passes depends on when it was stopped.
    """

    n_iterations: int = quantity(10, low=1)
    """Number of passes."""
    shortest_scale: float = quantity(SHORTEST_SCALE, low=LEAST_SCALE, high=1.0)
    """Shortest length-scale of z(t), as a share of the time span."""

    def __post_init__(self) -> None:
        check_quantities(self)

    def fit(
        self, times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"]
    ) -> NoiseProfile:
        """Estimate r(t) from D curves of order one on M common times."""
        replicates = Replicates.from_samples(times, samples)
        kernel, constant = fit_kernel_and_noise(replicates)
        profile = NoiseProfile.constant(times, constant)
        for _ in range(self.n_iterations):
            noise = profile.variance(times)
            mean, variance = _latent(replicates, kernel, noise)
            spread = 0.5 * ((samples - mean) ** 2 + variance + noise)
            observed = np.log(np.maximum(spread, LEAST_VARIANCE))
            profile = _smooth(times, observed, self.shortest_scale)
            noise = profile.variance(times)
            kernel = fit_kernel(times, replicates.mean, noise / replicates.count)
        return profile


def _latent(
    replicates: Replicates, kernel: RBF, noise: Float[np.ndarray, " M"]
) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
    """Posterior mean and variance of f at the common times."""
    times = replicates.times
    basis = LegendreBasis.for_length_scale(times[0], times[-1], kernel.length_scale)
    if basis is None:
        dense = replicates.condition(kernel, noise)
        return dense.mean(times), dense.variance(times)
    posterior = replicates.condition_in(basis, kernel, noise)
    matrix = basis.matrix(times)
    variance = np.sum((matrix @ posterior.factor) ** 2, axis=1)
    return matrix @ posterior.weights, variance


def _smooth(
    times: Float[np.ndarray, " M"], observed: Float[np.ndarray, "D M"], shortest: float
) -> NoiseProfile:
    """A Gaussian process through log-variances observed with unknown noise."""
    level = float(np.mean(observed))
    replicates = Replicates.from_samples(times, observed - level)
    kernel, variance = fit_kernel_and_noise(replicates, shortest=shortest)
    basis = NoiseProfile.basis_over(times)
    noise = np.full(len(times), variance)
    posterior = replicates.condition_in(basis, kernel, noise)
    return NoiseProfile(level=level, basis=basis, coefficients=posterior.weights)
