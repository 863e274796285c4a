"""Gaussian processes for the mean and a Wishart process for the variability.

The method of Umlauft, Fanger and Hirche (*Bayesian Uncertainty Modeling for Programming
by Demonstration*, ICRA 2017): the uncertainty of the mean is the variance of a Gaussian
process, the variation of the demonstrations a covariance matrix of all outputs that
changes with time, inferred as a generalised Wishart process.

This is a **reconstruction** from the abstract and descriptions by others. Assumptions:

* The mean of every output is a Gaussian process over the phase, Eqs. (10)–(11), with
  one noise variance by maximum likelihood. The original reportedly drives a dynamic
  movement primitive by such a process of accelerations, whose error was 25 cm instead
  of 3 mm for six demonstrations with 2 cm of white noise.
* The Wishart process is learned from the deviations of the demonstrations from their
  average at some of the phases, which are treated as independent in time. Its scale L
  is set so that the prior mean is their covariance over all phases. Length-scale and
  degrees of freedom are not learned.
* The posterior is sampled by elliptical slice sampling, and its mean is used.
* Rotations are rotation vectors; a repetition's deviations are white in time.

The generalised Wishart process is that of Wilson and Ghahramani, UAI 2011. With ν·d
independent Gaussian processes u_kd(t) of covariance κ(t, t'), κ(t, t) = 1,

    Σ(t) = L [(1 − ε) U(t) U(t)ᵀ + ε ν I] Lᵀ,   U(t) = (u_1(t), …, u_ν(t)),

is Wishart distributed at every t, except for the floor ε that keeps it positive
definite, and E Σ(t) = ν L Lᵀ (``test_prior_draws_average_to_nu_l_lt``). The weights w
(ν, d, R) are standard normal a priori, and u_kd(t) = φ(t) · w_kd with features φ (M, R)
of κ(t, t') = φ(t) · φ(t'). With S_t = Σ_i e_i(t) e_i(t)ᵀ, the scatter of D curves about
their average, the likelihood is that of D − 1 independent deviations at each time:

    log p = −½ Σ_t [(D − 1) log |Σ(t)| + tr(Σ(t)⁻¹ S_t)] + constant.

It is computed in coordinates where L is the identity.
"""

import itertools
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, check_quantities, quantity
from gplfd_policies.arrays.records import FINEST, thinned
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.exact import square_root
from gplfd_policies.gp.heteroscedastic import HomoscedasticNoise, MultiOutputGP
from gplfd_policies.gp.kernels import RBF, LegendreBasis
from gplfd_policies.movements.movement import MomentMovement, Moments

_SHRINKAGE: Final = 1e-6
"""Shrinkage of the pooled correlations to zero, because outputs may be proportional."""


@dataclass(frozen=True, kw_only=True, slots=True)
class WishartGPConfig(Quantities):
    """Prior of the variability, and settings of its inference."""

    degrees: int = quantity(7, low=6)
    """Degrees of freedom ν of the Wishart process, at least as many as outputs."""
    length_scale: float = quantity(0.15, low=0.02, high=10.0)
    """Length-scale of the variability, in phase."""
    floor: float = quantity(1e-3, low=1e-8, below=1.0)
    """Share of the pooled covariance below which the variability never falls."""
    times: int = quantity(50, low=2)
    """Number of phases whose deviations are learned from, at most all of them."""
    steps: int = quantity(1500, low=1)
    """Steps of the elliptical slice sampler."""
    discarded: int = quantity(500, low=0)
    """Number of first steps that are discarded, less than ``steps``."""
    mode_iterations: int = quantity(50, low=1)
    """Iterations of the search for the mode where sampling starts."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if self.discarded >= self.steps:
            raise ValueError(
                f"discarded must be less than steps, got {self.discarded} and "
                f"{self.steps}."
            )


class WishartPrior:
    """The prior of Σ(t) over an interval, with a radial basis function κ."""

    def __init__(
        self,
        interval: tuple[float, float],
        length_scale: float,
        mean: Float[np.ndarray, "d d"],
        degrees: int,
        floor: float,
    ) -> None:
        """Take the mean ν L Lᵀ, ν ≥ d and ε in (0, 1), the constant share of E Σ(t)."""
        basis = LegendreBasis.for_length_scale(*interval, length_scale)
        assert basis is not None, "the least length-scale of WishartGPConfig has one"
        kernel = RBF(length_scale=length_scale, signal_std=1.0)
        self.degrees, self.floor, self.basis = degrees, floor, basis
        self.lower = np.linalg.cholesky(mean / degrees)
        # Coefficients of φ in the basis.
        self.root = square_root(basis.kernel_matrix(kernel))

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

    def average(
        self, moment: Float[np.ndarray, "dR dR"], times: Times
    ) -> Float[np.ndarray, "M d d"]:
        """E[Σ(t)] for the average of Σ_k w_k w_kᵀ, with w_k = (w_k1, …, w_kd)."""
        _, outputs, rank = self.shape
        tensor = moment.reshape(outputs, rank, outputs, rank)
        features = self.features(times)
        half = np.einsum("mr,dres->mdes", features, tensor)
        return self.scaled(np.einsum("mdes,ms->mde", half, features))


class WishartLikelihood:
    """log p of deviations given the weights, in coordinates where L is the identity."""

    def __init__(
        self,
        prior: WishartPrior,
        times: Float[np.ndarray, " T"],
        deviations: Float[np.ndarray, "D T d"],
    ) -> None:
        """Take the deviations of D curves from their average."""
        columns = deviations.reshape(-1, len(prior.lower)).T
        white = scipy.linalg.solve_triangular(prior.lower, columns, lower=True).T
        white = white.reshape(deviations.shape)
        # φ at the times, and L⁻¹ S_t L⁻ᵀ, of D − 1 degrees of freedom.
        self.prior, self.features = prior, prior.features(times)
        self.scatter = np.einsum("kti,ktj->tij", white, white)
        self.free = len(deviations) - 1

    def _at(
        self, flat: Float[np.ndarray, " N"]
    ) -> tuple[Float[np.ndarray, "T d nu"], Float[np.ndarray, "T d d"]]:
        """Return U and L⁻¹ Σ L⁻ᵀ for flat weights."""
        degrees, outputs, rank = self.prior.shape
        values = self.features @ flat.reshape(-1, rank).T
        unit = values.reshape(-1, degrees, outputs).swapaxes(1, 2)
        covariance = (1.0 - self.prior.floor) * (unit @ unit.swapaxes(1, 2))
        np.einsum("tii->ti", covariance)[:] += self.prior.floor * degrees
        return unit, covariance

    def __call__(self, flat: Float[np.ndarray, " N"]) -> float:
        """Value at weights of shape (ν·d·R,), without its constant."""
        _, covariance = self._at(flat)
        lower = np.linalg.cholesky(covariance)
        log_root = float(np.sum(np.log(np.diagonal(lower, axis1=1, axis2=2))))
        solved = np.linalg.solve(covariance, self.scatter)
        return -self.free * log_root - 0.5 * float(np.einsum("tii->", solved))

    def gradient(self, flat: Float[np.ndarray, " N"]) -> Float[np.ndarray, " N"]:
        """Derivatives of the value: ½ tr((Σ⁻¹ S Σ⁻¹ − (D − 1) Σ⁻¹) dΣ)."""
        unit, covariance = self._at(flat)
        inverse = np.linalg.inv(covariance)
        sensitivity = inverse @ self.scatter @ inverse - self.free * inverse
        by_process = (1.0 - self.prior.floor) * (sensitivity @ unit)
        gradient: np.ndarray = np.einsum("tdk,tr->kdr", by_process, self.features)
        return gradient.ravel()


def elliptical_slice_chain(
    log_likelihood: Callable[[np.ndarray], float],  # -inf where impossible
    start: Float[np.ndarray, " N"],
    steps: int,
    rng: np.random.Generator,
) -> Iterator[Float[np.ndarray, " N"]]:
    """Sample posteriors of standard normal variables; yield the states after ``start``.

    Murray, Adams and MacKay, *Elliptical slice sampling*, AISTATS 2010. A step moves x
    along an ellipse through x and a draw from the prior, to a point drawn uniformly
    from the part of the ellipse where the likelihood exceeds a random level
    (``test_sampler_meets_a_gaussian_posterior``).
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
    likelihood: WishartLikelihood, config: WishartGPConfig, rng: np.random.Generator
) -> Float[np.ndarray, "dR dR"]:
    """Average Σ_k w_k w_kᵀ over a slice chain from a mode of the posterior."""

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
        options={"maxiter": config.mode_iterations},
    ).x
    moment = np.zeros((outputs * rank, outputs * rank))
    chain = elliptical_slice_chain(likelihood, mode, config.steps, rng)
    for flat in itertools.islice(chain, config.discarded, None):
        weights = flat.reshape(degrees, -1)
        moment += weights.T @ weights
    return moment / (config.steps - config.discarded)


@dataclass(frozen=True, kw_only=True, repr=False)
class WishartProcessMovement(MomentMovement):
    """A movement with Wishart variability; made by `fit_wishart_gp`, immutable.

    The variance is that of the mean plus the diagonal of `aleatoric`.
    """

    processes: MultiOutputGP
    prior: WishartPrior
    moment: Float[np.ndarray, "dR dR"]
    """Average of Σ_k w_k w_kᵀ over the posterior."""

    def aleatoric(self, times: Times) -> Float[np.ndarray, "M 6 6"]:
        """Covariance between repetitions; constant outside the task."""
        return self.prior.average(self.moment, times)

    def _moments(self, times: Times) -> Moments:
        moments = self.processes.moments(times)
        return moments.mean, np.sqrt(moments.latent + self._spread(times))

    def _spread(self, times: Times) -> Outputs:
        return np.diagonal(self.aleatoric(times), axis1=1, axis2=2)

    def _covariance(self, times: Times) -> Covariances:
        """Covariance over time: that of the mean plus white deviations."""
        total = self.processes.latent_covariance(times)
        diagonal = np.arange(len(times))
        total[:, diagonal, diagonal] += self._spread(times).T
        return total


def fit_wishart_gp(
    aligned: AlignedDemonstrations,
    config: WishartGPConfig,
    seed: int,
    *,
    centred: bool = True,
) -> WishartProcessMovement:
    """Learn mean and variability from aligned demonstrations."""
    times, poses = aligned.times, aligned.poses
    if len(poses) < 2:
        raise ValueError(
            "The variability of a task needs at least 2 demonstrations, got 1. Give "
            "more, or choose a policy without a spread."
        )
    deviations = poses - poses.mean(axis=0)
    # Their covariance over all phases, positive definite.
    free = (len(poses) - 1) * len(times)
    std = np.sqrt(np.sum(deviations**2, axis=(0, 1)) / free)
    std = np.maximum(std, FINEST)
    scaled = (deviations / std).reshape(-1, 6)
    correlation = scaled.T @ scaled / free
    correlation *= 1.0 - _SHRINKAGE
    # 1 where the output varies; also where it does not.
    np.fill_diagonal(correlation, 1.0)
    pooled = np.asarray(correlation * np.outer(std, std))
    processes = MultiOutputGP.fit(times, poses, HomoscedasticNoise(), centred=centred)
    interval = float(times[0]), float(times[-1])
    prior = WishartPrior(
        interval, config.length_scale, pooled, config.degrees, config.floor
    )
    kept = thinned(len(times), config.times)
    likelihood = WishartLikelihood(prior, times[kept], deviations[:, kept])
    moment = sample_posterior(likelihood, config, np.random.default_rng(seed))
    return WishartProcessMovement(
        aligned=aligned, processes=processes, prior=prior, moment=moment
    )
