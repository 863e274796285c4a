"""Marginal likelihoods of one output as functions of its hyper-parameters.

Both classes evaluate log N(y | 0, K(l, σ_f) + c·N) with N a fixed diagonal, and its
derivatives with respect to (log l, log σ_f, log c); Eq. (7). `SpectralEvidence` passes
over the M samples once and then costs O(q³) per evaluation, whatever M; `DenseEvidence`
costs O(M³).

Spectral form, with A = a_i(t_m) (M × q) and S the kernel in the basis
(`gplfd_policies.gp.legendre`): the QR factorisation N^(−½) A = Q R, u = Qᵀ N^(−½) y and
ρ² = ‖N^(−½) y − Q u‖² give

    log |K + c N| = log |c N| + log |B|,   B = I + R S Rᵀ / c,
    yᵀ (K + c N)⁻¹ y = (ρ² + uᵀ B⁻¹ u) / c.

``test_spectral_evidence_equals_dense`` settles it.
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import qr
from scipy.linalg.lapack import dpotrf, dpotri, dpotrs

from gplfd_policies.gp.exact import LOG_2PI, ExactGP
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis

Evidence = Callable[[RBF, float], tuple[float, np.ndarray]]
"""A log marginal likelihood of kernel and noise scale c: its value, and its derivatives
by (log l, log σ_f, log c), (3,)."""


@dataclass(frozen=True, kw_only=True, slots=True)
class DenseEvidence:
    """The evidence from M × M matrices; for few samples or short length-scales."""

    times: Float[np.ndarray, " M"]
    values: Float[np.ndarray, " M"]
    noise: Float[np.ndarray, " M"]
    """The fixed noise variances N."""

    def __call__(self, kernel: RBF, scale: float) -> tuple[float, np.ndarray]:
        """Value, and derivatives with respect to (log l, log σ_f, log c), (3,)."""
        posterior = ExactGP(
            kernel=kernel,
            times=self.times,
            values=self.values,
            noise_variance=scale * self.noise,
        )
        kernel_part, noise_part = posterior.likelihood_gradient()
        gradient = np.append(kernel_part, np.sum(noise_part))
        return posterior.log_marginal_likelihood(), gradient


@dataclass(frozen=True, kw_only=True, slots=True)
class SpectralEvidence:
    """The evidence from q × q matrices, independent of the number of samples."""

    basis: LegendreBasis
    triangle: Float[np.ndarray, "P Q"]
    """R of N^(−½) A = Q R."""
    projected: Float[np.ndarray, " P"]
    """u = Qᵀ N^(−½) y."""
    residual: float
    """ρ², what no polynomial of this basis explains."""
    size: int
    """Number of samples M."""
    log_noise: float
    """Log-determinant log |N| of the noise."""

    @classmethod
    def reduce(
        cls,
        basis: LegendreBasis,
        times: Float[np.ndarray, " M"],
        values: Float[np.ndarray, " M"],
        noise: Float[np.ndarray, " M"],
    ) -> "SpectralEvidence":
        """One pass over the samples; noise variances must be > 0."""
        root = 1.0 / np.sqrt(noise)
        whitened = values * root
        orthogonal, triangle = qr(
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
        nodes = self.basis.nodes
        prior = self.basis.kernel_matrix(kernel)
        middle = self.triangle @ prior @ self.triangle.T / scale
        middle[np.diag_indices_from(middle)] += 1.0
        factor, failed = dpotrf(middle, lower=1)
        if failed:
            # B = I + positive semi-definite: only rounding can make it indefinite,
            # where the signal is 1e14 times the noise.
            middle[np.diag_indices_from(middle)] += 1e-14 * np.trace(middle)
            factor, _ = dpotrf(middle, lower=1)
        solved, _ = dpotrs(factor, self.projected, lower=1)
        inverse, _ = dpotri(factor, lower=1)
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
