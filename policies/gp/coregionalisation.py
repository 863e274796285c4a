"""Several outputs with a joint prior: the linear model of coregionalisation, Eq. (6).

Paper: Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979. The paper assumes no prior relation between the outputs: B diagonal,
which is exactly d independent processes
(``test_diagonal_coregionalisation_is_independent_processes``) and is what
`policies.skill` uses. A full B couples them, at O((d M)³).
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float
from scipy.optimize import minimize

from policies.gp.factorisation import CholeskyFactor, factorise
from policies.gp.kernels import RBF

_LOG_2PI = float(np.log(2.0 * np.pi))


@dataclass(frozen=True, kw_only=True, slots=True)
class Coregionalisation:
    """One term B ⊗ k(t, t') of Eq. (6).

    Raises:
        ValueError: if B is not symmetric positive semi-definite.
    """

    matrix: Float[np.ndarray, "d d"]
    """The coregionalisation matrix B: prior covariance between the outputs."""
    kernel: RBF
    """The kernel k the outputs share in this term."""

    def __post_init__(self) -> None:
        matrix = self.matrix
        smallest = float(np.linalg.eigvalsh(matrix)[0])
        tolerance = 1e-10 * max(float(np.max(np.abs(matrix))), 1e-300)
        if not np.allclose(matrix, matrix.T) or smallest < -tolerance:
            raise ValueError(
                f"A coregionalisation matrix must be symmetric and positive "
                f"semi-definite; its smallest eigenvalue is {smallest:.3g}."
            )

    @classmethod
    def single(cls, output: int, count: int, kernel: RBF) -> "Coregionalisation":
        """The term of one output alone; one per output makes them independent."""
        matrix = np.zeros((count, count))
        matrix[output, output] = 1.0
        return cls(matrix=matrix, kernel=kernel)

    def __call__(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "dA dB"]:
        """B ⊗ k(a, b): outputs in blocks, times within."""
        product: np.ndarray = np.kron(self.matrix, self.kernel(a, b))
        return product


@dataclass(frozen=True, kw_only=True)
class CoregionalisedGP:
    """Jointly Gaussian outputs conditioned on noisy observations, Eqs. (4)–(6)."""

    terms: tuple[Coregionalisation, ...]
    """The terms whose sum is the prior covariance."""
    times: Float[np.ndarray, " M"]
    """Observation times."""
    values: Float[np.ndarray, "M d"]
    """Observations; the prior mean is zero."""
    noise_variance: Float[np.ndarray, "M d"]
    """Noise variance of every observation."""

    def _prior(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "dA dB"]:
        total: np.ndarray = np.sum([term(a, b) for term in self.terms], axis=0)
        return total

    @cached_property
    def factor(self) -> CholeskyFactor:
        """Cholesky factor of the covariance of all observations."""
        prior = self._prior(self.times, self.times)
        return factorise(prior + np.diag(self.noise_variance.T.ravel()))

    @cached_property
    def weights(self) -> Float[np.ndarray, " dM"]:
        """K_y⁻¹ y, outputs in blocks."""
        return self.factor.solve(self.values.T.ravel())

    def log_marginal_likelihood(self) -> float:
        """Eq. (7) for all outputs together."""
        flat = self.values.T.ravel()
        return -0.5 * (
            float(flat @ self.weights)
            + self.factor.log_determinant()
            + flat.size * _LOG_2PI
        )

    def mean(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M d"]:
        """Posterior mean, Eq. (4)."""
        flat = self._prior(times, self.times) @ self.weights
        stacked: np.ndarray = flat.reshape(-1, len(times)).T
        return stacked

    def covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "dM dM"]:
        """Posterior covariance of all outputs, in blocks, Eq. (5)."""
        half = self.factor.half_solve(self._prior(self.times, times))
        posterior: np.ndarray = self._prior(times, times) - half.T @ half
        return posterior


def fit_coregionalisation(
    times: Float[np.ndarray, " M"],
    values: Float[np.ndarray, "M d"],
    noise_variance: Float[np.ndarray, "M d"],
) -> Coregionalisation:
    """The most likely B and length-scale of one term, B = L Lᵀ.

    The option for related outputs; costs O((d M)³) per evaluation, so thin the times
    first. Not the paper's choice.

    Args:
        times: observation times, shape (M,).
        values: observations, shape (M, d).
        noise_variance: their noise variances, > 0, shape (M, d).
    """
    count = values.shape[1]
    size = np.maximum(np.std(values, axis=0), 1e-12)
    lower = np.tril_indices(count)
    span = float(times[-1] - times[0])

    def term(theta: np.ndarray) -> tuple[Coregionalisation, np.ndarray]:
        root = np.zeros((count, count))
        root[lower] = theta[1:]
        kernel = RBF(length_scale=float(np.exp(theta[0])), signal_std=1.0)
        return Coregionalisation(matrix=root @ root.T, kernel=kernel), root

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        prior, root = term(theta)
        posterior = CoregionalisedGP(
            terms=(prior,),
            times=times,
            values=values / size,
            noise_variance=noise_variance / size**2,
        )
        by_length, by_matrix = _sensitivities(posterior)
        gradient = np.concatenate([[by_length], (2.0 * by_matrix @ root)[lower]])
        return -posterior.log_marginal_likelihood(), -gradient

    start = np.concatenate([[np.log(0.3 * span)], np.eye(count)[lower]])
    bounds = [(np.log(0.05 * span), np.log(3.0 * span))]
    bounds += [(-30.0, 30.0)] * len(lower[0])
    result = minimize(objective, start, jac=True, method="L-BFGS-B", bounds=bounds)
    scaled, _ = term(result.x)
    return Coregionalisation(
        matrix=size[:, None] * scaled.matrix * size, kernel=scaled.kernel
    )


def _sensitivities(
    posterior: CoregionalisedGP,
) -> tuple[float, Float[np.ndarray, "d d"]]:
    """Derivatives of the evidence of a single term in (log l, B)."""
    term, times = posterior.terms[0], posterior.times
    count = len(term.matrix)
    inverse = posterior.factor.solve(np.eye(count * len(times)))
    sensitivity = 0.5 * (np.outer(posterior.weights, posterior.weights) - inverse)
    # d log p = tr(sensitivity · d(B ⊗ k)), block by block
    blocks = sensitivity.reshape(count, len(times), count, len(times))
    by_log_length, _ = term.kernel.log_gradients(times, times)
    by_matrix = np.einsum("iajb,ab->ij", blocks, term.kernel(times, times))
    by_length = np.einsum("iajb,ab,ij->", blocks, by_log_length, term.matrix)
    return float(by_length), by_matrix
