"""Evidence of repeated demonstrations, and kernel and noise that maximise it.

Aligned demonstrations are D observations at each of M common times. With noise that is
independent between observations, they enter the Gaussian-process likelihood (Eq. (7)
with the noise of Eq. (10)) only through M averages and M within-time sums of squares:

    log p(Y) = log N(ȳ | m, K + diag(r/D))
             + Σ_i [ −(D−1)/2 log(2π r_i) − ½ log D − SS_i/(2 r_i) ]

so an O((D M)³) problem is an O(M³) one, exactly; the posterior of f is that of a
Gaussian process on ȳ with noise r/D (``test_collapse_equals_naive_gp``).

In the spectral form, with A = a_i(t_m) (M × q) and S the kernel in the basis
(`gplfd_policies.gp.kernels`), one pass over the M samples gives the QR factorisation
N^(−½) A = Q R, u = Qᵀ N^(−½) y and ρ² = ‖N^(−½) y − Q u‖². Everything else then costs
O(q³) for any M. The evidence log N(y | 0, K(l, σ_f) + c·N), with N a fixed diagonal,
follows from

    log |K + c N| = log |c N| + log |B|,   B = I + R S Rᵀ / c,
    yᵀ (K + c N)⁻¹ y = (ρ² + uᵀ B⁻¹ u) / c

(``test_spectral_evidence_equals_dense``). With f(t) = Σ_i a_i(t) w_i, w ~ N(0, S) and
S = F₀ F₀ᵀ, the posterior of Eqs. (10)–(11) is

    Λ = I + F₀ᵀ Rᵀ R F₀ = L Lᵀ,   F = F₀ L⁻ᵀ,   cov w = F Fᵀ,   E w = F Fᵀ Rᵀ u:

a sum of squares, so variances are positive without any jitter
(``test_spectral_posterior_equals_dense``).
"""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.arrays.shapes import Curve, Curves, Float, Times
from gplfd_policies.gp.exact import LOG_2PI, ExactGP
from gplfd_policies.gp.kernels import RBF, SIZES, LegendreBasis

_RANK_TOLERANCE = 1e-16
"""Eigenvalues below this share of the largest are rounding."""
_LONGEST = 3.0  # longest length-scale, as a fraction of the time span
_SCREENED = (0.1, 0.2, 0.4)
"""Length-scales tried before the search, as fractions of the time span: the noise is
known well, so the best one leads to the same optimum as thirty random starts."""
_LOG_SIGNAL = (np.log(1e-3), np.log(1e2))
_LOG_SCALE = (np.log(1e-10), np.log(1e2))

Evidence = Callable[[RBF, float], tuple[float, np.ndarray]]
"""A log marginal likelihood log N(y | 0, K + c·N) of kernel and noise scale c: its
value, and its derivatives by (log l, log σ_f, log c), (3,)."""
Posterior = tuple[Float[np.ndarray, " Q"], Float[np.ndarray, "Q R"]]
"""Posterior mean E w of the coefficients of one output, and F, a root of their
covariance F Fᵀ."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Replicates:
    """Sufficient statistics of D (`count`) observations at M times: ȳ and SS."""

    times: Times
    mean: Curve
    within: Curve
    count: int

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
    ) -> Posterior:
        """`condition` in a basis that can represent the kernel."""
        noise = noise_variance / self.count
        evidence = SpectralEvidence.reduce(basis, self.times, self.mean, noise)
        return evidence.condition(kernel)

    def condition(self, kernel: RBF, noise_variance: Curve) -> ExactGP:
        """Posterior of f given all D·M observations, Eqs. (10)–(11)."""
        times, noise = self.times, noise_variance / self.count
        return ExactGP(
            kernel=kernel, times=times, values=self.mean, noise_variance=noise
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class SpectralEvidence:
    """The evidence from q × q matrices; log |N| is the log-determinant of the noise."""

    basis: LegendreBasis
    triangle: Float[np.ndarray, "P Q"]
    """R of N^(−½) A = Q R."""
    projected: Float[np.ndarray, " P"]
    """u = Qᵀ N^(−½) y."""
    residual: float
    """ρ²."""
    size: int
    """Number of samples M."""
    log_noise: float

    @classmethod
    def reduce(
        cls, basis: LegendreBasis, times: Times, values: Curve, noise: Curve
    ) -> "SpectralEvidence":
        """One pass over the samples; noise variances must be > 0."""
        root = 1.0 / np.sqrt(noise)
        whitened = values * root
        design = basis.shared_matrix(times) * root[:, None]
        orthogonal, triangle = scipy.linalg.qr(
            design, mode="economic", check_finite=False
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

    def condition(self, kernel: RBF) -> Posterior:
        """Condition N(0, K) on the reduced data, Eqs. (10)–(11)."""
        root = square_root(self.basis.kernel_matrix(kernel))
        seen = self.triangle @ root
        precision = seen.T @ seen
        precision[np.diag_indices_from(precision)] += 1.0
        lower = scipy.linalg.cholesky(precision, lower=True, check_finite=False)
        factor = scipy.linalg.solve_triangular(
            lower, root.T, lower=True, check_finite=False
        ).T
        return factor @ (factor.T @ (self.triangle.T @ self.projected)), factor


def square_root(covariance: Float[np.ndarray, "Q Q"]) -> Float[np.ndarray, "Q R"]:
    """F₀ with F₀ F₀ᵀ = covariance, dropping directions below rounding."""
    values, vectors = np.linalg.eigh(covariance)
    kept = values > _RANK_TOLERANCE * values[-1]
    return np.asarray(vectors[:, kept] * np.sqrt(values[kept]))


@dataclass(frozen=True, kw_only=True, slots=True)
class DenseEvidence:
    """The evidence in O(M³), for few samples or short length-scales."""

    times: Times
    values: Curve
    noise: Curve

    def __call__(self, kernel: RBF, scale: float) -> tuple[float, np.ndarray]:
        """Value and derivatives, as `Evidence`."""
        noise = scale * self.noise
        posterior = ExactGP(
            kernel=kernel, times=self.times, values=self.values, noise_variance=noise
        )
        kernel_part, noise_part = posterior.likelihood_gradient()
        gradient = np.append(kernel_part, np.sum(noise_part))
        return posterior.log_marginal_likelihood(), gradient


def fit_kernel(
    times: Times, values: Curve, noise_variance: Curve, *, shortest: float = 0.05
) -> RBF:
    """Fit (l, σ_f) to values of order one and known noise; l ≥ shortest · time span."""
    return _search(times, values, noise_variance, shortest, None)[0]


def fit_kernel_and_noise(
    replicates: Replicates, *, shortest: float = 0.05
) -> tuple[RBF, float]:
    """Fit (l, σ_f) and σ_n², Eqs. (3), (7), to all D·M observations; return both."""
    noise = np.full(len(replicates.times), 1.0 / replicates.count)
    return _search(replicates.times, replicates.mean, noise, shortest, replicates)


def _search(
    times: Times,
    values: Curve,
    noise: Curve,
    shortest: float,
    replicates: Replicates | None,
) -> tuple[RBF, float]:
    """Search with the smallest basis first; enlarge it if the length-scale is short."""
    span = float(times[-1] - times[0])
    size, comfortable = next(iter(SIZES.items()))
    if len(times) > size:
        limit = max(comfortable, shortest)
        basis = LegendreBasis(start=times[0], stop=times[-1], size=size)
        evidence: Evidence = SpectralEvidence.reduce(basis, times, values, noise)
        fitted = _maximise(evidence, span, limit, replicates)
        if fitted[0].length_scale > 1.05 * limit * span or limit == shortest:
            return fitted
        wider = LegendreBasis.for_length_scale(times[0], times[-1], shortest * span)
        if wider is not None and wider.size < len(times):
            evidence = SpectralEvidence.reduce(wider, times, values, noise)
            return _maximise(evidence, span, shortest, replicates)
    evidence = DenseEvidence(times=times, values=values, noise=noise)
    return _maximise(evidence, span, shortest, replicates)


def _maximise(
    evidence: Evidence, span: float, shortest: float, replicates: Replicates | None
) -> tuple[RBF, float]:
    """Return kernel and noise scale c of greatest evidence; c = 1 without replicates.

    The replicates have the rest of the likelihood, which depends on the noise.
    """
    free = 2 if replicates is None else 3

    def model(theta: np.ndarray) -> tuple[RBF, float]:
        length, signal, *noise = np.exp(theta).tolist()
        return RBF(length_scale=length, signal_std=signal), noise[0] if noise else 1.0

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        kernel, scale = model(theta)
        value, gradient = evidence(kernel, scale)
        if replicates is not None:
            size, within = len(replicates.times), float(np.sum(replicates.within))
            value += replicates.log_remainder(np.full(size, scale))
            gradient[2] += -0.5 * size * (replicates.count - 1) + 0.5 * within / scale
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
    return model(result.x)
