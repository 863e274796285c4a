"""Marginal likelihood and posterior of one output in the spectral form.

With A = a_i(t_m) (M × q) and S the kernel in the basis (`gplfd_policies.gp.legendre`),
one pass over the M samples gives the QR factorisation N^(−½) A = Q R, u = Qᵀ N^(−½) y
and ρ² = ‖N^(−½) y − Q u‖². Everything else then costs O(q³) for any M. The evidence
log N(y | 0, K(l, σ_f) + c·N), Eq. (7), with N a fixed diagonal, follows from

    log |K + c N| = log |c N| + log |B|,   B = I + R S Rᵀ / c,
    yᵀ (K + c N)⁻¹ y = (ρ² + uᵀ B⁻¹ u) / c

(``test_spectral_evidence_equals_dense``). With f(t) = Σ_i a_i(t) w_i, w ~ N(0, S) and
S = F₀ F₀ᵀ, the posterior of Eqs. (10)–(11) is

    Λ = I + F₀ᵀ Rᵀ R F₀ = L Lᵀ,   F = F₀ L⁻ᵀ,   cov w = F Fᵀ,   E w = F Fᵀ Rᵀ u:

a sum of squares, so variances are positive without any jitter
(``test_spectral_posterior_equals_dense``).
"""

from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Curve, Float, Times
from gplfd_policies.gp.exact import LOG_2PI
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis

_RANK_TOLERANCE = 1e-16
"""Eigenvalues below this share of the largest are rounding."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SpectralEvidence:
    """The evidence from q × q matrices, independent of the number of samples."""

    basis: LegendreBasis
    triangle: Float[np.ndarray, "P Q"]
    """R of N^(−½) A = Q R."""
    projected: Float[np.ndarray, " P"]
    """u = Qᵀ N^(−½) y."""
    residual: float
    """ρ², the part that no polynomial of this basis explains."""
    size: int
    """Number of samples M."""
    log_noise: float
    """Log-determinant log |N| of the noise."""

    @classmethod
    def reduce(
        cls, basis: LegendreBasis, times: Times, values: Curve, noise: Curve
    ) -> "SpectralEvidence":
        """One pass over the samples; noise variances must be > 0."""
        root = 1.0 / np.sqrt(noise)
        whitened = values * root
        orthogonal, triangle = scipy.linalg.qr(
            basis.shared_matrix(times) * root[:, None],
            mode="economic",
            check_finite=False,
        )
        projected = orthogonal.T @ whitened
        return cls(
            basis=basis,
            triangle=triangle,
            projected=projected,
            residual=float(np.sum((whitened - orthogonal @ projected) ** 2)),
            size=len(times),
            log_noise=float(np.sum(np.log(noise))),
        )

    def __call__(self, kernel: RBF, scale: float) -> tuple[float, np.ndarray]:
        """Value, and derivatives with respect to (log l, log σ_f, log c), (3,)."""
        lapack, nodes = scipy.linalg.lapack, self.basis.nodes
        prior = self.basis.kernel_matrix(kernel)
        middle = self.triangle @ prior @ self.triangle.T / scale
        middle[np.diag_indices_from(middle)] += 1.0
        factor, failed = lapack.dpotrf(middle, lower=1)
        if failed:
            # B = I + positive semi-definite: only rounding can make it indefinite,
            # where the signal is 1e14 times the noise.
            middle[np.diag_indices_from(middle)] += 1e-14 * np.trace(middle)
            factor, _ = lapack.dpotrf(middle, lower=1)
        solved, _ = lapack.dpotrs(factor, self.projected, lower=1)
        inverse, _ = lapack.dpotri(factor, lower=1)
        inverse += np.tril(inverse, -1).T
        quadratic = (self.residual + float(self.projected @ solved)) / scale
        log_determinant = 2.0 * float(np.sum(np.log(np.diag(factor))))
        log_noise = self.log_noise + self.size * np.log(scale)
        value = -0.5 * (quadratic + log_determinant + log_noise + self.size * LOG_2PI)
        # d value = ½ tr((β βᵀ/c − B⁻¹) dB), β = B⁻¹ u
        sensitivity = 0.5 * (np.outer(solved, solved) / scale - inverse)
        pulled = self.triangle.T @ sensitivity @ self.triangle / scale * prior
        squared = (np.subtract.outer(nodes, nodes) / kernel.length_scale) ** 2
        trace = float(np.sum(pulled))
        # c enters as 1/c in B, as |c N| and as 1/c in the quadratic form.
        scale_part = -trace - 0.5 * self.size + 0.5 * quadratic
        gradient = np.array([np.sum(pulled * squared), 2.0 * trace, scale_part])
        return value, gradient


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
    """F, a root of their covariance F Fᵀ."""

    @classmethod
    def condition(cls, evidence: SpectralEvidence, kernel: RBF) -> "SpectralPosterior":
        """Condition N(0, K) on the reduced data."""
        root = square_root(evidence.basis.kernel_matrix(kernel))
        seen = evidence.triangle @ root
        precision = seen.T @ seen
        precision[np.diag_indices_from(precision)] += 1.0
        lower = scipy.linalg.cholesky(precision, lower=True, check_finite=False)
        factor = scipy.linalg.solve_triangular(
            lower, root.T, lower=True, check_finite=False
        ).T
        weights = factor @ (factor.T @ (evidence.triangle.T @ evidence.projected))
        return cls(weights=weights, factor=factor)
