"""How the spread of the demonstrations, r(t), is estimated by default.

The paper models z(t) = log r(t) with a second Gaussian process and takes its most
likely value, Eq. (15). A noise model is an object with one method, ``fit``; the paper's
own is in `gplfd_policies.gp.kersting`.

Note:
    The logarithm of an empirical variance with k degrees of freedom is biased:
    E log(χ²_k / k) = ψ(k/2) − log(k/2), −1.27 for k = 1 and −0.21 for k = 5
    (``test_log_of_an_empirical_variance_is_biased``). `MapNoise` corrects it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.special import digamma, polygamma

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
from gplfd_policies.gp.spectral import square_root

LEAST_SPREAD = 3e-3
"""By default, the least standard deviation of repetitions, relative to that of the
output over the task (docs/method.md has what it is on real recordings)."""
_OFFSET_VARIANCE = 1e2
"""Prior variance of the level of z(t): vague, so that the data set it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HomoscedasticNoise:
    """One noise variance σ_n² for the whole task, Eq. (3), by maximum likelihood.

    It under-states the spread where demonstrations differ and over-states it where
    they agree (the paper's Fig. 2). With a single demonstration the variance is that
    of its samples around a smooth curve: nothing is known about repetitions.
    """

    def fit(
        self, times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"]
    ) -> NoiseProfile:
        """Estimate σ_n² from D curves of order one on M common times."""
        _, variance = fit_kernel_and_noise(Replicates.from_samples(times, samples))
        return NoiseProfile.constant(times, variance)


@dataclass(frozen=True, kw_only=True, slots=True)
class MapNoise:
    """The default: pooled variances, corrected, then the most likely z(t).

    1. v_i = SS_i / k with k = D − 1, and z_i = log v_i − ψ(k/2) + log(k/2): unbiased
       observations of log r with the *known* noise variance ψ'(k/2), so the process
       on z needs no noise hyper-parameter.
    2. Its (l, σ) by maximum likelihood.
    3. With these fixed, Newton's method for the mode of the exact likelihood of the
       sums of squares, SS_i ~ r_i χ²_k:
       Σ_i [k/2 z_i + ½ SS_i exp(−z_i)] + ½ (z − m)ᵀ K_z⁻¹ (z − m), which is convex.
    4. r(t) = exp z(t) + `least_spread`²: where demonstrations happen to agree, the
       next one need not, and nothing in them could tell
       (``test_agreement_by_chance_does_not_ruin_the_likelihood``).
    """

    shortest_scale: float = quantity(SHORTEST_SCALE, low=LEAST_SCALE, high=1.0)
    """Shortest length-scale of z(t), as a share of the time span."""
    least_spread: float = quantity(LEAST_SPREAD, low=0.0, high=1.0)
    """Least standard deviation of repetitions, relative to that of the output."""

    def __post_init__(self) -> None:
        check_quantities(self)

    def fit(
        self, times: Float[np.ndarray, " M"], samples: Float[np.ndarray, "D M"]
    ) -> NoiseProfile:
        """Estimate r(t) from D curves of order one on M common times.

        Raises:
            ValueError: for a single demonstration, which has no spread.
        """
        replicates = Replicates.from_samples(times, samples)
        free = replicates.count - 1
        if free < 1:
            raise ValueError(
                "The spread between demonstrations needs at least 2 of them, got 1. "
                'Give more, or choose noise="homoscedastic", which models the '
                "scatter of the samples around one smooth curve."
            )
        # All demonstrations start at the same pose: there the spread is exactly zero.
        pooled = np.maximum(replicates.within / free, LEAST_VARIANCE)
        half = 0.5 * free
        observed = np.log(pooled) - float(digamma(half)) + np.log(half)
        level = float(np.mean(observed))
        known = np.full(len(times), float(polygamma(1, half)))
        kernel = fit_kernel(
            times, observed - level, known, shortest=self.shortest_scale
        )
        basis = NoiseProfile.basis_over(times)
        coefficients = _gamma_mode(basis, kernel, times, free, pooled, level)
        return NoiseProfile(
            level=level,
            basis=basis,
            coefficients=coefficients,
            floor=self.least_spread**2,
        )


def _gamma_mode(
    basis: LegendreBasis,
    kernel: RBF,
    times: Float[np.ndarray, " M"],
    free: int,
    pooled: Float[np.ndarray, " M"],
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
