"""Maximum-likelihood length-scales, signal and noise levels.

Repeated demonstrations determine the noise well. Trying three length-scales and
refining the best one therefore reaches the same optimum of Eq. (7) as thirty random
starts.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Curve, Times
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import SIZES, LegendreBasis
from gplfd_policies.gp.replicates import Replicates
from gplfd_policies.gp.spectral import SpectralEvidence

_LONGEST = 3.0
"""Longest length-scale, as a fraction of the time span."""
_SCREENED = (0.1, 0.2, 0.4)
"""Length-scales tried before the search, as fractions of the time span."""
_LOG_SIGNAL = (np.log(1e-3), np.log(1e2))
_LOG_SCALE = (np.log(1e-10), np.log(1e2))

Evidence = Callable[[RBF, float], tuple[float, np.ndarray]]
"""A log marginal likelihood log N(y | 0, K + c·N) of kernel and noise scale c: its
value, and its derivatives by (log l, log σ_f, log c), (3,)."""
Remainder = Callable[[float], tuple[float, float]]
"""scale c → the rest of the log-likelihood and its derivative in log c."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DenseEvidence:
    """The evidence in O(M³), for few samples or short length-scales."""

    times: Times
    values: Curve
    noise: Curve
    """The fixed noise variances N."""

    def __call__(self, kernel: RBF, scale: float) -> tuple[float, np.ndarray]:
        """Value and derivatives, as `Evidence`."""
        posterior = ExactGP(
            kernel=kernel,
            times=self.times,
            values=self.values,
            noise_variance=scale * self.noise,
        )
        kernel_part, noise_part = posterior.likelihood_gradient()
        gradient = np.append(kernel_part, np.sum(noise_part))
        return posterior.log_marginal_likelihood(), gradient


def fit_kernel(
    times: Times, values: Curve, noise_variance: Curve, *, shortest: float = 0.05
) -> RBF:
    """Fit (l, σ_f) to values of order one and known noise; l ≥ shortest · time span."""
    return _search(times, values, noise_variance, shortest, remainder=None)[0]


def fit_kernel_and_noise(
    replicates: Replicates, *, shortest: float = 0.05
) -> tuple[RBF, float]:
    """Fit (l, σ_f) and σ_n², Eqs. (3), (7), to all D·M observations; return both."""
    size, count = len(replicates.times), replicates.count
    within = float(np.sum(replicates.within))

    def remainder(scale: float) -> tuple[float, float]:
        slope = -0.5 * size * (count - 1) + 0.5 * within / scale
        return replicates.log_remainder(np.full(size, scale)), slope

    noise = np.full(size, 1.0 / count)
    return _search(replicates.times, replicates.mean, noise, shortest, remainder)


def _search(
    times: Times,
    values: Curve,
    noise: Curve,
    shortest: float,
    remainder: Remainder | None,
) -> tuple[RBF, float]:
    """Search with the smallest basis first; enlarge it if the length-scale is short."""
    span = float(times[-1] - times[0])
    size, comfortable = next(iter(SIZES.items()))
    if len(times) > size:
        limit = max(comfortable, shortest)
        basis = LegendreBasis(start=times[0], stop=times[-1], size=size)
        evidence: Evidence = SpectralEvidence.reduce(basis, times, values, noise)
        fitted = _maximise(evidence, span, limit, remainder)
        if fitted[0].length_scale > 1.05 * limit * span or limit == shortest:
            return fitted
        wider = LegendreBasis.for_length_scale(times[0], times[-1], shortest * span)
        if wider is not None and wider.size < len(times):
            evidence = SpectralEvidence.reduce(wider, times, values, noise)
            return _maximise(evidence, span, shortest, remainder)
    evidence = DenseEvidence(times=times, values=values, noise=noise)
    return _maximise(evidence, span, shortest, remainder)


def _maximise(
    evidence: Evidence, span: float, shortest: float, remainder: Remainder | None
) -> tuple[RBF, float]:
    """Return kernel and noise scale c of greatest evidence; c = 1 without remainder."""
    free = 2 if remainder is None else 3

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        scale = 1.0 if remainder is None else float(np.exp(theta[2]))
        kernel = RBF(
            length_scale=float(np.exp(theta[0])), signal_std=float(np.exp(theta[1]))
        )
        value, gradient = evidence(kernel, scale)
        if remainder is not None:
            extra, slope = remainder(scale)
            value += extra
            gradient[2] += slope
        return -value, -gradient[:free]

    lengths = (np.log(shortest * span), np.log(_LONGEST * span))
    bounds = [lengths, _LOG_SIGNAL, _LOG_SCALE][:free]
    starts = [
        np.array([np.clip(np.log(part * span), *lengths), 0.0, np.log(1e-2)])[:free]
        for part in _SCREENED
    ]
    best = min(starts, key=lambda start: objective(start)[0])
    result = scipy.optimize.minimize(
        objective, best, jac=True, method="L-BFGS-B", bounds=bounds
    )
    length, signal = np.exp(result.x[:2])
    kernel = RBF(length_scale=float(length), signal_std=float(signal))
    return kernel, 1.0 if remainder is None else float(np.exp(result.x[2]))
