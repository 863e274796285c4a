"""The spread of the demonstrations r(t), Eqs. (10)–(11), and how it is estimated.

The paper models z(t) = log r(t) with a second Gaussian process and takes its most
likely value, Eq. (15). The logarithm of an empirical variance with k degrees of freedom
is biased: E log(χ²_k / k) = ψ(k/2) − log(k/2), −1.27 for k = 1 and −0.21 for k = 5
(``test_log_of_an_empirical_variance_is_biased``). `MapNoise` corrects it.
"""

from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.records import short_repr
from gplfd_policies.arrays.shapes import Curve, Curves, Float, Times
from gplfd_policies.gp.evidence import (
    Replicates,
    fit_kernel,
    fit_kernel_and_noise,
    square_root,
)
from gplfd_policies.gp.kernels import RBF, LegendreBasis

_LEAST_VARIANCE = 1e-10
"""Smallest observation of exp z(t), relative to the variance of the output."""
_SHORTEST_SCALE, _LEAST_SCALE = 0.15, 0.1
"""Shortest length-scale of z(t) as a share of the time span: by default, and the least
that the basis can express."""
_BASIS_SIZE = 48
LEAST_SPREAD = 3e-3
"""By default, the least standard deviation of repetitions, relative to that of the
output over the task (docs/method.md has values of real recordings)."""
_OFFSET_VARIANCE = 1e2
"""Prior variance of the level of z(t): vague, so that the data set it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseProfile:
    """A noise variance r(t) = exp z(t) + floor > 0, smooth in time.

    z(t) is a level plus a curve in a basis, constant outside the basis's interval.
    """

    level: float
    basis: LegendreBasis
    coefficients: Float[np.ndarray, " Q"]
    floor: float = 0.0

    __repr__ = short_repr

    @staticmethod
    def basis_over(times: Times) -> LegendreBasis:
        """The basis of a profile over demonstrations at ``times``."""
        start, stop = float(times[0]), float(times[-1])
        return LegendreBasis(start=start, stop=stop, size=_BASIS_SIZE)

    @classmethod
    def constant(cls, times: Times, variance: float) -> "NoiseProfile":
        """The same variance everywhere."""
        basis = cls.basis_over(times)
        level, varying = float(np.log(variance)), np.zeros(basis.size)
        return cls(level=level, basis=basis, coefficients=varying)

    def log_variance(self, times: Times) -> Curve:
        """Its logarithm at ``times``."""
        with np.errstate(divide="ignore"):
            floor = np.log(self.floor)  # -inf for none
        return np.asarray(np.logaddexp(self._varying(times), floor))

    def _varying(self, times: Times) -> Curve:
        """z(t) at ``times``."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        return np.asarray(self.level + self.basis.matrix(inside) @ self.coefficients)

    def variance(self, times: Times) -> Curve:
        """The noise variance r(t) at ``times``."""
        return np.asarray(np.exp(self.log_variance(times)))

    def log_variance_rate(self, times: Times) -> Curve:
        """Its logarithm's derivative; zero outside the demonstrated interval."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        slope = self.basis.matrix(inside) @ self.basis.differentiate(self.coefficients)
        share = np.exp(self._varying(times) - self.log_variance(times))
        return np.where(inside == times, share * slope, 0.0)


@runtime_checkable
class NoiseModel(Protocol):
    """A rule that turns aligned demonstrations of one output into r(t)."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t) from D curves of order one on M common times."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HomoscedasticNoise:
    """One noise variance σ_n² for the whole task, Eq. (3), by maximum likelihood.

    It underestimates the spread where demonstrations differ and overestimates it where
    they agree (Fig. 2). With one demonstration it is the scatter of its samples.
    """

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate σ_n², as `NoiseModel.fit`."""
        _, variance = fit_kernel_and_noise(Replicates.from_samples(times, samples))
        return NoiseProfile.constant(times, variance)


@dataclass(frozen=True, kw_only=True, slots=True)
class MapNoise(Quantities):
    """The default: pooled variances, corrected, then the most likely z(t).

    1. v_i = SS_i / k with k = D − 1, and z_i = log v_i − ψ(k/2) + log(k/2): unbiased
       observations of log r with the *known* noise variance ψ'(k/2), so the process
       on z needs no noise hyper-parameter.
    2. Its (l, σ) by maximum likelihood.
    3. With these fixed, Newton's method for the mode of the exact likelihood of the
       sums of squares, SS_i ~ r_i χ²_k:
       Σ_i [k/2 z_i + ½ SS_i exp(−z_i)] + ½ (z − m)ᵀ K_z⁻¹ (z − m), which is convex.
    4. r(t) = exp z(t) + `least_spread`²: where demonstrations agree by chance, the next
       one may differ (``test_agreement_by_chance_does_not_ruin_the_likelihood``).
    """

    shortest_scale: float = quantity(_SHORTEST_SCALE, low=_LEAST_SCALE, high=1.0)
    """Shortest length-scale of z(t), as a share of the time span."""
    least_spread: float = quantity(LEAST_SPREAD, low=0.0, high=1.0)
    """Least standard deviation of repetitions, relative to that of the output."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t) from D ≥ 2 curves, as `NoiseModel.fit`."""
        replicates = Replicates.from_samples(times, samples)
        free = replicates.count - 1
        if free < 1:
            raise ValueError(
                "The spread between demonstrations needs at least 2 of them, got 1. "
                'Give more, or choose noise="homoscedastic", which models the '
                "scatter of the samples around one smooth curve."
            )
        # All demonstrations start at the same pose: there the spread is exactly zero.
        pooled = np.maximum(replicates.within / free, _LEAST_VARIANCE)
        half = 0.5 * free
        observed = np.log(pooled) - float(scipy.special.digamma(half)) + np.log(half)
        level = float(np.mean(observed))
        variance = np.full(len(times), float(scipy.special.polygamma(1, half)))
        shortest = self.shortest_scale
        kernel = fit_kernel(times, observed - level, variance, shortest=shortest)
        basis = NoiseProfile.basis_over(times)
        varying = _gamma_mode(basis, kernel, times, free, pooled, level)
        floor = self.least_spread**2
        return NoiseProfile(level=level, basis=basis, coefficients=varying, floor=floor)


def _gamma_mode(
    basis: LegendreBasis,
    kernel: RBF,
    times: Times,
    free: int,
    pooled: Curve,
    level: float,
) -> Float[np.ndarray, " Q"]:
    """Coefficients of the mode of z(t) − level under the gamma likelihood."""
    vague = _OFFSET_VARIANCE * np.outer(basis.root_weights, basis.root_weights)
    root = square_root(basis.kernel_matrix(kernel) + vague)
    features = basis.shared_matrix(times) @ root
    half = 0.5 * free

    def cost(position: np.ndarray) -> tuple[float, np.ndarray]:
        deviation = features @ position
        # A Newton step that overshoots may overflow; the line search rejects infinity.
        with np.errstate(over="ignore"):
            scaled = half * pooled * np.exp(-level - deviation)
        value = np.sum(half * deviation + scaled) + 0.5 * position @ position
        return float(value), scaled

    # z − level = features @ position with position ~ N(0, I)
    position = np.zeros(features.shape[1])
    value, scaled = cost(position)
    for _ in range(100):
        gradient = features.T @ (half - scaled) + position
        hessian = features.T @ (scaled[:, None] * features)
        hessian[np.diag_indices_from(hessian)] += 1.0
        step = np.linalg.solve(hessian, gradient)
        decrease = float(gradient @ step)
        if decrease < 1e-12 * len(times):
            break
        length = 1.0
        candidate, candidate_scaled = cost(position - step)
        while not candidate <= value - 1e-4 * length * decrease and length > 1e-6:
            length *= 0.5
            candidate, candidate_scaled = cost(position - length * step)
        position = position - length * step
        value, scaled = candidate, candidate_scaled
    return root @ position


@dataclass(frozen=True, kw_only=True, slots=True)
class KerstingNoise(Quantities):
    """The paper's estimate: Kersting's "most likely" iteration.

    A homoscedastic process is fitted first; each observation then gives
    z = log ½((y − μ)² + s²), with the current prediction μ and s²; a second process
    smooths z; and the loop repeats with r = exp z. The fixed point is biased: the
    standard deviation converges to about 0.81 of the truth. r can at most halve per
    pass, so few passes do not converge.
    """

    n_iterations: int = quantity(10, low=1)
    """Number of passes."""
    shortest_scale: float = quantity(_SHORTEST_SCALE, low=_LEAST_SCALE, high=1.0)
    """As in `MapNoise`."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t), as `NoiseModel.fit`."""
        replicates = Replicates.from_samples(times, samples)
        kernel, constant = fit_kernel_and_noise(replicates)
        profile = NoiseProfile.constant(times, constant)
        for _ in range(self.n_iterations):
            # Posterior mean and variance of f at the common times.
            noise = profile.variance(times)
            basis = LegendreBasis.for_length_scale(
                times[0], times[-1], kernel.length_scale
            )
            assert basis is not None, "fitted length-scales are never so short"
            weights, factor = replicates.condition_in(basis, kernel, noise)
            matrix = basis.matrix(times)
            mean = matrix @ weights
            variance = np.sum((matrix @ factor) ** 2, axis=1)
            # A process through log-variances that are observed with unknown noise.
            spread = 0.5 * ((samples - mean) ** 2 + variance + noise)
            observed = np.log(np.maximum(spread, _LEAST_VARIANCE))
            level = float(np.mean(observed))
            logs = Replicates.from_samples(times, observed - level)
            smooth, scatter = fit_kernel_and_noise(logs, shortest=self.shortest_scale)
            basis = NoiseProfile.basis_over(times)
            noise = np.full(len(times), scatter)
            of_logs, _ = logs.condition_in(basis, smooth, noise)
            profile = NoiseProfile(level=level, basis=basis, coefficients=of_logs)
            noise = profile.variance(times)
            kernel = fit_kernel(times, replicates.mean, noise / replicates.count)
        return profile
