"""The radial basis function kernel of Eq. (13), and its derivatives.

Eq. (14), the multi-output kernel, is printed without the minus sign and the ½: it grows
with distance and is not a covariance
(``test_printed_multi_output_kernel_is_not_a_covariance``). Outputs use Eq. (13).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Float


@dataclass(frozen=True, kw_only=True, slots=True)
class RBF:
    """k(t, t') = σ_f² exp(−(t − t')² / (2 l²)), Eq. (13)."""

    length_scale: float
    """Length-scale l, in the unit of time (phase once aligned)."""
    signal_std: float
    """Signal standard deviation σ_f, in the unit of the output."""

    def __post_init__(self) -> None:
        for name in ("length_scale", "signal_std"):
            value = getattr(self, name)
            if not (np.isfinite(value) and value > 0.0):
                raise ValueError(f"{name} must be positive and finite, got {value}.")

    @property
    def variance(self) -> float:
        """k(t, t) = σ_f²."""
        return self.signal_std**2

    def __call__(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "A B"]:
        """Covariance k(a_i, b_j)."""
        distance = np.subtract.outer(a, b)
        distance *= distance
        distance *= -0.5 / self.length_scale**2
        np.exp(distance, out=distance)
        distance *= self.variance
        return np.asarray(distance)

    def features(
        self, times: Float[np.ndarray, " A"], centre: float, terms: int
    ) -> Float[np.ndarray, "A terms"]:
        """φ with k(a, b) = φ(a) φ(b)ᵀ, from the power series of exp(u_a u_b).

        φ_n(t) = σ_f exp(−u²/2) uⁿ/√n! with u = (t − centre)/l; the rest after ``terms``
        of them vanishes where u² is well below ``terms``.
        """
        scaled = (times - centre)[:, None] / self.length_scale
        powers = np.arange(terms)
        logarithm = scipy.special.xlogy(powers, np.abs(scaled))
        logarithm -= 0.5 * (scipy.special.gammaln(powers + 1.0) + scaled**2)
        sign = np.where(powers % 2, np.sign(scaled), 1.0)
        return np.asarray(self.signal_std * sign * np.exp(logarithm))

    def time_derivative(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "A B"]:
        """∂k(a_i, b_j)/∂a_i = −(a_i − b_j)/l² · k(a_i, b_j)."""
        return np.asarray(-np.subtract.outer(a, b) / self.length_scale**2 * self(a, b))

    def log_gradients(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "2 A B"]:
        """∂k/∂log l = (a − b)²/l² · k and ∂k/∂log σ_f = 2 k."""
        values = self(a, b)
        scaled = np.subtract.outer(a, b) / self.length_scale
        return np.stack([scaled**2 * values, 2.0 * values])
