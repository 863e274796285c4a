"""Exact collapse of demonstrations that share their times.

Aligned demonstrations are D observations at each of M common times. For noise that is
independent between observations, the D·M values enter the Gaussian-process likelihood
(Eq. (7) with the noise of Eq. (10)) only through the M averages and the M within-time
sums of squares:

    log p(Y) = log N(ȳ | m, K + diag(r/D))
             + Σ_i [ −(D−1)/2 log(2π r_i) − ½ log D − SS_i/(2 r_i) ]

so an O((D M)³) problem is an O(M³) one, exactly; the posterior of f is that of a
Gaussian process on ȳ with noise r/D (``test_collapse_equals_naive_gp``).
"""

from dataclasses import dataclass

import numpy as np

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.arrays.shapes import Curve, Curves, Times
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.gp.spectral import SpectralEvidence, SpectralPosterior


@dataclass(frozen=True, kw_only=True, slots=True)
class Replicates:
    """The sufficient statistics of D observations at each of M times."""

    times: Times
    """Common times, strictly increasing."""
    mean: Curve
    """Average ȳ over the demonstrations."""
    within: Curve
    """Sum of squared deviations SS from the average."""
    count: int
    """Number of demonstrations D."""

    __repr__ = short_repr

    @classmethod
    def from_samples(cls, times: Times, samples: Curves) -> "Replicates":
        """Reduce D curves sampled at common times."""
        mean = samples.mean(axis=0)
        within = np.sum((samples - mean) ** 2, axis=0)
        return cls(times=times, mean=mean, within=within, count=len(samples))

    def log_remainder(self, noise_variance: Curve) -> float:
        """The part of log p(Y) that does not depend on the kernel."""
        free = self.count - 1
        terms = (
            -0.5 * free * np.log(2.0 * np.pi * noise_variance)
            - 0.5 * np.log(self.count)
            - 0.5 * self.within / noise_variance
        )
        return float(np.sum(terms))

    def condition_in(
        self, basis: LegendreBasis, kernel: RBF, noise_variance: Curve
    ) -> SpectralPosterior:
        """`condition` in a basis that can represent the kernel."""
        noise = noise_variance / self.count
        evidence = SpectralEvidence.reduce(basis, self.times, self.mean, noise)
        return SpectralPosterior.condition(evidence, kernel)

    def condition(self, kernel: RBF, noise_variance: Curve) -> ExactGP:
        """Posterior of f given all D·M observations, Eqs. (10)–(11)."""
        return ExactGP(
            kernel=kernel,
            times=self.times,
            values=self.mean,
            noise_variance=noise_variance / self.count,
        )
