"""Cholesky factors that say how much jitter they needed."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_solve, cholesky, solve_triangular

_RELATIVE_JITTERS = tuple(10.0**power for power in range(-15, -5))


@dataclass(frozen=True, kw_only=True, slots=True)
class CholeskyFactor:
    """A + jitter·I = L Lᵀ with L lower triangular."""

    lower: Float[np.ndarray, "N N"]
    """The factor L."""
    jitter: float
    """What had to be added to the diagonal; 0 unless the plain factor failed."""

    def solve(self, right: Float[np.ndarray, "N ..."]) -> Float[np.ndarray, "N ..."]:
        """Solve (L Lᵀ) x = ``right``."""
        return cho_solve((self.lower, True), right, check_finite=False)

    def half_solve(
        self, right: Float[np.ndarray, "N ..."]
    ) -> Float[np.ndarray, "N ..."]:
        """Solve L x = ``right``."""
        return solve_triangular(self.lower, right, lower=True, check_finite=False)

    def log_determinant(self) -> float:
        """The log-determinant of L Lᵀ."""
        return 2.0 * float(np.sum(np.log(np.diag(self.lower))))


def factorise(matrix: Float[np.ndarray, "N N"]) -> CholeskyFactor:
    """Cholesky factor of a covariance, with the least jitter that works.

    Jitter is a model change: 1e-4 of the signal variance already moves the posterior
    standard deviation of a smooth output by a quarter. So none is added while the
    plain factorisation works, and the amount is reported when it does not.

    Args:
        matrix: symmetric, positive semi-definite up to rounding, shape (N, N).

    Raises:
        ValueError: if the matrix is not finite, or is indefinite by more than 1e-6 of
            its mean diagonal.
    """
    if not np.isfinite(matrix).all():
        raise ValueError("A covariance must be finite; found NaN or infinity in it.")
    scale = float(np.mean(np.diag(matrix))) if matrix.size else 1.0
    for relative in (0.0, *_RELATIVE_JITTERS):
        jitter = relative * scale
        try:
            lower = cholesky(
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
