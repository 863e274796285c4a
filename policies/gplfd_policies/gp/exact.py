"""Exact Gaussian-process regression of one output, by Cholesky factors, O(N³).

Eqs. (1)–(5), (7), and (10)–(11) when the noise differs from point to point; also for D
repeated demonstrations, whose O((D M)³) problem is an O(M³) one
(``test_collapse_equals_naive_gp``), and kernel and noise that maximise the evidence.
"""

from collections.abc import Callable
from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.arrays.shapes import Curve, Curves, Float, Gram, Times
from gplfd_policies.gp.kernels import RBF, SIZES, LegendreBasis

LOG_2PI = float(np.log(2.0 * np.pi))
_RELATIVE_JITTERS = tuple(10.0**power for power in range(-15, -5))


@dataclass(frozen=True, kw_only=True, slots=True)
class CholeskyFactor:
    """A + jitter·I = L Lᵀ with L lower triangular."""

    lower: Gram
    """The factor L."""
    jitter: float
    """Amount added to the diagonal; 0 unless the plain factor failed."""

    def solve(self, right: Float[np.ndarray, "N ..."]) -> Float[np.ndarray, "N ..."]:
        """Solve (L Lᵀ) x = ``right``."""
        return scipy.linalg.cho_solve((self.lower, True), right, check_finite=False)

    def half_solve(
        self, right: Float[np.ndarray, "N ..."]
    ) -> Float[np.ndarray, "N ..."]:
        """Solve L x = ``right``."""
        return scipy.linalg.solve_triangular(
            self.lower, right, lower=True, check_finite=False
        )

    def log_determinant(self) -> float:
        """The log-determinant of L Lᵀ."""
        return 2.0 * float(np.sum(np.log(np.diag(self.lower))))


def factorise(matrix: Gram) -> CholeskyFactor:
    """Cholesky factor of a covariance, with the least jitter that works.

    Jitter changes the model: 1e-4 of the signal variance moves the posterior standard
    deviation of a smooth output by a quarter. So none is added if none is needed.
    """
    if not np.isfinite(matrix).all():
        raise ValueError("A covariance must be finite; found NaN or infinity in it.")
    scale = float(np.mean(np.diag(matrix))) if matrix.size else 1.0
    for relative in (0.0, *_RELATIVE_JITTERS):
        jitter = relative * scale
        try:
            lower = scipy.linalg.cholesky(
                matrix + jitter * np.eye(len(matrix)), lower=True, check_finite=False
            )
        except np.linalg.LinAlgError:
            continue
        return CholeskyFactor(lower=lower, jitter=jitter)
    smallest = float(np.linalg.eigvalsh(matrix)[0])
    raise ValueError(
        f"The covariance is not positive definite: its smallest eigenvalue is "
        f"{smallest:.3g} at a mean diagonal of {scale:.3g}, and a jitter of 1e-6 of "
        f"that did not help. Increase the noise or remove repeated points."
    )


@dataclass(frozen=True, kw_only=True)
class ExactGP:
    """A process of prior mean zero, conditioned on noisy observations, Eqs. (3)–(5)."""

    kernel: RBF
    times: Curve
    values: Curve
    """Observations y at the times t."""
    noise_variance: Curve
    """Noise variance of every observation: constant σ_n² (Eq. 3) or r(t) (Eq. 10)."""

    def __post_init__(self) -> None:
        noise = self.noise_variance
        if not (np.isfinite(noise).all() and (noise >= 0.0).all()):
            raise ValueError(f"Noise variances must be finite and >= 0, got {noise}.")

    @cached_property
    def factor(self) -> CholeskyFactor:
        """Cholesky factor of K_y = K(t, t) + diag(noise); it reports its jitter."""
        gram = self.kernel(self.times, self.times)
        return factorise(gram + np.diag(self.noise_variance))

    @cached_property
    def weights(self) -> Curve:
        """K_y⁻¹ y."""
        return self.factor.solve(self.values)

    def log_marginal_likelihood(self) -> float:
        """The log marginal likelihood log p(y | t, Θ), Eq. (7)."""
        quadratic = float(self.values @ self.weights)
        size = len(self.times)
        return -0.5 * (quadratic + self.factor.log_determinant() + size * LOG_2PI)

    def likelihood_gradient(self) -> tuple[Float[np.ndarray, "2"], Curve]:
        """Derivatives of Eq. (7) by (log l, log σ_f) and by each log noise."""
        inverse = self.factor.solve(np.eye(len(self.times)))
        # d log p = ½ tr((ααᵀ − K_y⁻¹) dK_y)
        sensitivity = 0.5 * (np.outer(self.weights, self.weights) - inverse)
        kernel_part = np.einsum(
            "ij,pij->p", sensitivity, self.kernel.log_gradients(self.times, self.times)
        )
        return kernel_part, np.diag(sensitivity) * self.noise_variance

    def mean(self, times: Times) -> Curve:
        """Posterior mean of f, Eqs. (4) and (10)."""
        return np.asarray(self.kernel(times, self.times) @ self.weights)

    def covariance(self, times: Times) -> Gram:
        """Posterior covariance of f without observation noise, Eq. (5)."""
        half = self.factor.half_solve(self.kernel(self.times, times))
        return np.asarray(self.kernel(times, times) - half.T @ half)

    def variance(self, times: Times) -> Curve:
        """Diagonal of :meth:`covariance`, never negative."""
        half = self.factor.half_solve(self.kernel(self.times, times))
        left = self.kernel.signal_std**2 - np.sum(half**2, axis=0)
        return np.asarray(np.maximum(left, 0.0))

    def rates(self, times: Times) -> tuple[Curve, Curve]:
        """Time derivatives of the mean and of the variance."""
        slope = self.kernel.time_derivative(times, self.times)
        cross = self.kernel(self.times, times)
        mean_rate = slope @ self.weights
        variance_rate = -2.0 * np.sum(slope.T * self.factor.solve(cross), axis=0)
        return mean_rate, variance_rate


_RANK_TOLERANCE = 1e-16  # eigenvalues below this share of the largest are rounding
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
"""Posterior mean E w of the coefficients, and F, a root of their covariance F Fᵀ."""


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
        terms = -0.5 * free * np.log(2.0 * np.pi * noise_variance)
        terms = terms - 0.5 * np.log(self.count) - 0.5 * self.within / noise_variance
        return float(np.sum(terms))

    def condition_in(
        self, basis: LegendreBasis, kernel: RBF, noise_variance: Curve
    ) -> Posterior:
        """`condition` in a basis that can represent the kernel.

        In the symbols of `SpectralEvidence`, with S = F₀ F₀ᵀ, the posterior is

            Λ = I + F₀ᵀ Rᵀ R F₀ = L Lᵀ,   F = F₀ L⁻ᵀ,   cov w = F Fᵀ,   E w = F Fᵀ Rᵀ u:

        a sum of squares, so variances are positive without any jitter
        (``test_spectral_posterior_equals_dense``).
        """
        noise = noise_variance / self.count
        data = SpectralEvidence(basis, self.times, self.mean, noise)
        root = square_root(basis.kernel_matrix(kernel))
        seen = data.triangle @ root
        precision = seen.T @ seen
        precision[np.diag_indices_from(precision)] += 1.0
        lower = scipy.linalg.cholesky(precision, lower=True, check_finite=False)
        factor = scipy.linalg.solve_triangular(
            lower, root.T, lower=True, check_finite=False
        ).T
        return factor @ (factor.T @ (data.triangle.T @ data.projected)), factor

    def condition(self, kernel: RBF, noise_variance: Curve) -> ExactGP:
        """Posterior of f given all D·M observations, Eqs. (10)–(11)."""
        t, noise = self.times, noise_variance / self.count
        return ExactGP(kernel=kernel, times=t, values=self.mean, noise_variance=noise)


class SpectralEvidence:
    """The evidence log N(y | 0, K(l, σ_f) + c·N) from q × q matrices, N diagonal.

    With A = a_i(t_m), S the kernel in the basis and N^(−½) A = Q R,

        log |K + c N| = log |c N| + log |B|,   B = I + R S Rᵀ / c,
        yᵀ (K + c N)⁻¹ y = (ρ² + uᵀ B⁻¹ u) / c

    (``test_spectral_evidence_equals_dense``).
    """

    def __init__(
        self, basis: LegendreBasis, times: Times, values: Curve, noise: Curve
    ) -> None:
        """Reduce M samples in one pass; noise variances must be > 0."""
        root = 1.0 / np.sqrt(noise)
        whitened = values * root
        design = basis.matrix(times) * root[:, None]
        orthogonal, self.triangle = scipy.linalg.qr(
            design, mode="economic", check_finite=False
        )
        self.basis, self.size = basis, len(times)
        self.projected = orthogonal.T @ whitened  # u = Qᵀ N^(−½) y
        self.residual = float(np.sum((whitened - orthogonal @ self.projected) ** 2))
        self.log_noise = float(np.sum(np.log(noise)))

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


def fit_kernel_and_noise(
    replicates: Replicates, *, shortest: float = 0.05
) -> tuple[RBF, float]:
    """Fit (l, σ_f) and σ_n², Eqs. (3), (7), to all D·M observations; return both."""
    times, noise = replicates.times, np.ones(len(replicates.times)) / replicates.count
    return fit_kernel(times, replicates.mean, noise, shortest, replicates)


def fit_kernel(
    times: Times,
    values: Curve,
    noise: Curve,
    shortest: float = 0.05,
    replicates: Replicates | None = None,
) -> tuple[RBF, float]:
    """Fit (l, σ_f) to values of order one, l ≥ shortest · time span, and c, see below.

    The noise variance is known but for a factor c, which is 1 without replicates. The
    smallest basis is tried first, and enlarged if the length-scale is short.
    """
    span = float(times[-1] - times[0])
    size, comfortable = next(iter(SIZES.items()))
    if len(times) > size:
        limit = max(comfortable, shortest)
        basis = LegendreBasis(start=times[0], stop=times[-1], size=size)
        evidence: Evidence = SpectralEvidence(basis, times, values, noise)
        fitted = _maximise(evidence, span, limit, replicates)
        if fitted[0].length_scale > 1.05 * limit * span or limit == shortest:
            return fitted
        wider = LegendreBasis.for_length_scale(times[0], times[-1], shortest * span)
        if wider is not None and wider.size < len(times):
            evidence = SpectralEvidence(wider, times, values, noise)
            return _maximise(evidence, span, shortest, replicates)
    evidence = DenseEvidence(times=times, values=values, noise=noise)
    return _maximise(evidence, span, shortest, replicates)


def _maximise(
    evidence: Evidence, span: float, shortest: float, replicates: Replicates | None
) -> tuple[RBF, float]:
    """Return kernel and noise scale c of greatest evidence; 1 without replicates."""
    free = 2 if replicates is None else 3

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        length, signal, *noise = np.exp(theta).tolist()
        scale = noise[0] if noise else 1.0
        value, gradient = evidence(RBF(length_scale=length, signal_std=signal), scale)
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
    length, signal, *noise = np.exp(result.x).tolist()
    return RBF(length_scale=length, signal_std=signal), noise[0] if noise else 1.0
