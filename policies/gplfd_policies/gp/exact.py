"""Exact Gaussian-process regression of one output, by Cholesky factors, O(N³).

Eqs. (1)–(5), (7), and (10)–(11) when the noise differs from point to point.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Curve, Float, Gram, Times
from gplfd_policies.gp.kernels import RBF

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
    deviation of a smooth output by a quarter. So none is added while the plain
    factorisation works.
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
    """A process of prior mean zero, conditioned on noisy observations, Eqs. (3)–(5).

    Raises:
        ValueError: if a noise variance is negative or not finite.
    """

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

    def likelihood_gradient(
        self,
    ) -> tuple[Float[np.ndarray, "2"], Curve]:
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
        left = self.kernel.variance - np.sum(half**2, axis=0)
        return np.asarray(np.maximum(left, 0.0))

    def rates(self, times: Times) -> tuple[Curve, Curve]:
        """Time derivatives of the mean and of the variance."""
        slope = self.kernel.time_derivative(times, self.times)
        cross = self.kernel(self.times, times)
        mean_rate = slope @ self.weights
        variance_rate = -2.0 * np.sum(slope.T * self.factor.solve(cross), axis=0)
        return mean_rate, variance_rate
