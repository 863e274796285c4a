"""The posterior of one output in the spectral form.

With f(t) = Σ_i a_i(t) w_i, w ~ N(0, S) (`gplfd_policies.gp.legendre`), S = F₀ F₀ᵀ, and
the reduced data R, u of `gplfd_policies.gp.evidence`, the posterior of Eqs. (10)–(11)
is

    Λ = I + F₀ᵀ Rᵀ R F₀ = L Lᵀ,   F = F₀ L⁻ᵀ,   cov w = F Fᵀ,   E w = F Fᵀ Rᵀ u:

a sum of squares, so variances are positive without any jitter.
``test_spectral_posterior_equals_dense`` settles it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cholesky, solve_triangular

from gplfd_policies.gp.evidence import SpectralEvidence
from gplfd_policies.gp.kernels import RBF

_RANK_TOLERANCE = 1e-16


def square_root(covariance: Float[np.ndarray, "Q Q"]) -> Float[np.ndarray, "Q R"]:
    """F₀ with F₀ F₀ᵀ = covariance, dropping directions below rounding."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _RANK_TOLERANCE * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True, kw_only=True, slots=True)
class SpectralPosterior:
    """Posterior of the coefficients w of one output."""

    weights: Float[np.ndarray, " Q"]
    """Their posterior mean E w."""
    factor: Float[np.ndarray, "Q R"]
    """F, of which F Fᵀ is their covariance."""

    @classmethod
    def condition(cls, evidence: SpectralEvidence, kernel: RBF) -> "SpectralPosterior":
        """Condition N(0, K) on the reduced data."""
        root = square_root(evidence.basis.kernel_matrix(kernel))
        seen = evidence.triangle @ root
        precision = seen.T @ seen
        precision[np.diag_indices_from(precision)] += 1.0
        lower = cholesky(precision, lower=True, check_finite=False)
        factor = solve_triangular(lower, root.T, lower=True, check_finite=False).T
        weights = factor @ (factor.T @ (evidence.triangle.T @ evidence.projected))
        return cls(weights=weights, factor=factor)
