"""The generalised Wishart process: a covariance matrix that changes with time.

Wilson and Ghahramani, *Generalised Wishart processes*, UAI 2011. With ν·d independent
Gaussian processes u_kd(t) of covariance κ(t, t'), κ(t, t) = 1,

    Σ(t) = L [(1 − ε) U(t) U(t)ᵀ + ε ν I] Lᵀ,   U(t) = (u_1(t), …, u_ν(t)),

is Wishart distributed at every t, except for the floor ε that keeps it positive
definite, and E Σ(t) = ν L Lᵀ (``test_prior_draws_average_to_nu_l_lt``).

================  ===========  =====================================================
symbol            shape        meaning
================  ===========  =====================================================
d, ν              numbers      outputs; degrees of freedom, ν ≥ d
L                 (d, d)       `WishartPrior.lower`, scale of the covariance
φ(t)              (M, R)       `WishartPrior.features`, κ(t, t') = φ(t) · φ(t')
w                 (ν, d, R)    weights, standard normal a priori; u_kd(t) = φ(t) · w_kd
S_t               (d, d)       Σ_i e_i(t) e_i(t)ᵀ, scatter of D curves about their
                               average at time t, with D − 1 degrees of freedom
================  ===========  =====================================================

Curves are assumed to deviate independently at each time, e_i(t) ~ N(0, Σ(t)). After
subtraction of the average, the likelihood is that of D − 1 deviations:

    log p = −½ Σ_t [(D − 1) log |Σ(t)| + tr(Σ(t)⁻¹ S_t)] + constant.

Everything is computed in coordinates where L is the identity.
"""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Float, Times
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.gp.spectral import square_root

LogLikelihood = Callable[[np.ndarray], float]
"""x (N,) → log p(y | x), minus infinity where it is impossible."""


@dataclass(frozen=True, kw_only=True, slots=True)
class WishartPrior:
    """The prior of Σ(t) over an interval; made by `over`."""

    degrees: int
    """Degrees of freedom ν ≥ d; Σ(t) varies less with more of them."""
    lower: Float[np.ndarray, "d d"]
    """The scale L, lower triangular."""
    floor: float
    """ε in (0, 1), the constant share of E Σ(t)."""
    basis: LegendreBasis
    """Basis of the processes u over the interval."""
    root: Float[np.ndarray, "Q R"]
    """Coefficients of φ in the basis."""

    @classmethod
    def over(
        cls,
        interval: tuple[float, float],
        length_scale: float,
        mean: Float[np.ndarray, "d d"],
        degrees: int,
        floor: float,
    ) -> "WishartPrior":
        """The prior with a radial basis function κ and the mean ν L Lᵀ = ``mean``."""
        basis = LegendreBasis.for_length_scale(*interval, length_scale)
        assert basis is not None, "the least length-scale of WishartGPConfig has one"
        kernel = RBF(length_scale=length_scale, signal_std=1.0)
        return cls(
            degrees=degrees,
            lower=np.linalg.cholesky(mean / degrees),
            floor=floor,
            basis=basis,
            root=square_root(basis.kernel_matrix(kernel)),
        )

    @property
    def shape(self) -> tuple[int, int, int]:
        """Shape of the weights, (ν, d, R)."""
        return self.degrees, len(self.lower), self.root.shape[1]

    def features(self, times: Times) -> Float[np.ndarray, "M R"]:
        """φ(t), constant outside the interval."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        return np.asarray(self.basis.matrix(inside) @ self.root)

    def scaled(self, unit: Float[np.ndarray, "M d d"]) -> Float[np.ndarray, "M d d"]:
        """Σ(t) for U(t) U(t)ᵀ."""
        inner = (1.0 - self.floor) * unit
        inner += self.floor * self.degrees * np.eye(len(self.lower))
        return np.asarray(self.lower @ inner @ self.lower.T)

    def covariance(
        self, weights: Float[np.ndarray, "nu d R"], times: Times
    ) -> Float[np.ndarray, "M d d"]:
        """Σ(t) for the weights."""
        unit = np.einsum("kdr,mr->mdk", weights, self.features(times))
        return self.scaled(unit @ unit.swapaxes(1, 2))


@dataclass(frozen=True, kw_only=True, slots=True)
class WishartLikelihood:
    """log p of deviations given the weights, in coordinates where L is the identity."""

    features: Float[np.ndarray, "T R"]
    """φ at the times of the deviations."""
    scatter: Float[np.ndarray, "T d d"]
    """L⁻¹ S_t L⁻ᵀ."""
    free: int
    """Degrees of freedom of the scatter, D − 1."""
    prior: WishartPrior
    """The prior of the weights."""

    @classmethod
    def of(
        cls,
        prior: WishartPrior,
        times: Float[np.ndarray, " T"],
        deviations: Float[np.ndarray, "D T d"],
    ) -> "WishartLikelihood":
        """The likelihood of D curves' deviations from their average."""
        columns = deviations.reshape(-1, len(prior.lower)).T
        white = scipy.linalg.solve_triangular(prior.lower, columns, lower=True).T
        white = white.reshape(deviations.shape)
        return cls(
            features=prior.features(times),
            scatter=np.einsum("kti,ktj->tij", white, white),
            free=len(deviations) - 1,
            prior=prior,
        )

    def _processes(self, flat: Float[np.ndarray, " N"]) -> Float[np.ndarray, "T d nu"]:
        outputs = self.scatter.shape[1]
        rows = flat.reshape(-1, self.features.shape[1])
        values = self.features @ rows.T
        return np.asarray(
            values.reshape(-1, self.prior.degrees, outputs).swapaxes(1, 2)
        )

    def _covariance(
        self, unit: Float[np.ndarray, "T d nu"]
    ) -> Float[np.ndarray, "T d d"]:
        covariance: np.ndarray = (1.0 - self.prior.floor) * (unit @ unit.swapaxes(1, 2))
        diagonal = np.arange(covariance.shape[1])
        covariance[:, diagonal, diagonal] += self.prior.floor * self.prior.degrees
        return covariance

    def __call__(self, flat: Float[np.ndarray, " N"]) -> float:
        """Value at weights of shape (ν·d·R,), without its constant."""
        covariance = self._covariance(self._processes(flat))
        lower = np.linalg.cholesky(covariance)
        log_root = float(np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2))))
        solved = np.linalg.solve(covariance, self.scatter)
        return -self.free * log_root - 0.5 * float(np.einsum("tii->", solved))

    def gradient(self, flat: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Derivatives of the value: ½ tr((Σ⁻¹ S Σ⁻¹ − (D − 1) Σ⁻¹) dΣ)."""
        unit = self._processes(flat)
        inverse = np.linalg.inv(self._covariance(unit))
        sensitivity = inverse @ self.scatter @ inverse - self.free * inverse
        by_process = (1.0 - self.prior.floor) * (sensitivity @ unit)
        gradient: np.ndarray = np.einsum("tdk,tr->kdr", by_process, self.features)
        return gradient.ravel()


@dataclass(frozen=True, kw_only=True, slots=True)
class WishartPosterior:
    """The posterior mean of Σ(t), made by `sample_posterior`."""

    prior: WishartPrior
    """The prior of Σ(t)."""
    moment: Float[np.ndarray, "dR dR"]
    """Average of Σ_k w_k w_kᵀ over the samples, with w_k = (w_k1, …, w_kd)."""

    def covariance(self, times: Times) -> Float[np.ndarray, "M d d"]:
        """E[Σ(t)], constant outside the interval."""
        _, outputs, rank = self.prior.shape
        tensor = self.moment.reshape(outputs, rank, outputs, rank)
        features = self.prior.features(times)
        half = np.einsum("mr,dres->mdes", features, tensor)
        return self.prior.scaled(np.einsum("mdes,ms->mde", half, features))


def elliptical_slice_chain(
    log_likelihood: LogLikelihood,
    start: Float[np.ndarray, " N"],
    steps: int,
    rng: np.random.Generator,
) -> Iterator[Float[np.ndarray, " N"]]:
    """Sample posteriors of standard normal variables; yield the states after ``start``.

    Murray, Adams and MacKay, *Elliptical slice sampling*, AISTATS 2010, their Figure 2.
    For a prior N(0, I) and any likelihood p(y | x), a step moves x along an ellipse
    through x and a draw from the prior, to a point drawn uniformly from the part of the
    ellipse where the likelihood exceeds a random level below the current one. This
    leaves the posterior invariant (``test_sampler_meets_a_gaussian_posterior``).
    """
    state, value = start, log_likelihood(start)
    for _ in range(steps):
        other = rng.standard_normal(state.shape)
        level = value - rng.standard_exponential()
        angle = rng.uniform(0.0, 2.0 * np.pi)
        low, high = angle - 2.0 * np.pi, angle
        while True:
            candidate = np.cos(angle) * state + np.sin(angle) * other
            value = log_likelihood(candidate)
            # Equal counts too: rounding may leave the level where the state itself is.
            if value >= level:
                break
            # Angle 0 is the state itself, which is always allowed: shrink towards it.
            if angle < 0.0:
                low = angle
            else:
                high = angle
            angle = rng.uniform(low, high)
        state = candidate
        yield state


def sample_posterior(
    likelihood: WishartLikelihood,
    steps: int,
    discarded: int,
    rng: np.random.Generator,
    mode_iterations: int = 50,
) -> WishartPosterior:
    """Average over an elliptical slice chain that starts at a mode of the posterior.

    From a draw of the prior, the chain would not have converged after 5000 steps: the
    likelihood of hundreds of weights is narrow, so steps are short.
    """

    def objective(flat: np.ndarray) -> tuple[float, np.ndarray]:
        value = 0.5 * float(flat @ flat) - likelihood(flat)
        return value, flat - likelihood.gradient(flat)

    prior = likelihood.prior
    degrees, outputs, rank = prior.shape
    mode = scipy.optimize.minimize(
        objective,
        rng.standard_normal(degrees * outputs * rank),
        jac=True,
        method="L-BFGS-B",
        options={"maxiter": mode_iterations},
    ).x
    moment = np.zeros((outputs * rank, outputs * rank))
    for step, flat in enumerate(elliptical_slice_chain(likelihood, mode, steps, rng)):
        if step >= discarded:
            weights = flat.reshape(degrees, -1)
            moment += weights.T @ weights
    return WishartPosterior(prior=prior, moment=moment / (steps - discarded))
