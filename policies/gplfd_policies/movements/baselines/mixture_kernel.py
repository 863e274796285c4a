"""The kernel of GMM-GP, `fit_gmm_gp`, and the likelihood of its length-scales.

Equation numbers refer to Jaquier, Ginsbourger, Calinon, *Learning from demonstration
with model-based Gaussian process*, CoRL 2019.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve
from scipy.optimize import minimize

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.demonstrations.aligned import thinned
from gplfd_policies.movements.baselines.gmr import GaussianMixtureRegression


@dataclass(frozen=True, kw_only=True, slots=True)
class LengthScaleConfig:
    """How length-scales are learned; published values for letters, translated.

    The letters were written over 2 s and vary by 25 cm², so seconds are halved and
    variances divided by 25.

    Raises:
        ValueError: if a range is not positive and increasing, or there are fewer than
            two phases.
    """

    length_scale_range: tuple[float, float] = (0.005, 5.0)
    """Allowed length-scales [phase]; published [0.01, 10] s."""
    first_length_scale: float = 2.5
    """Where the search starts [phase]; published 5 s."""
    noise_range: tuple[float, float] = (4e-5, 2e-3)
    """Allowed variance of the demonstrations' noise, standardised; published
    [0.001, 0.05] cm². Demonstrations that differ by more than its upper end, as all
    here do, keep the noise there, and the length-scales follow from it: without the
    bound the mean's misfit is noise too and most length-scales run to their limit."""
    phases: int = quantity(50, low=2)
    """Number of phases of the demonstrations that enter the likelihood, evenly spread.
    The cost grows with its cube: 0.2 s for 50, 1 s for 100, where length-scales change
    by a quarter."""

    def __post_init__(self) -> None:
        check_quantities(self)
        for name in ("length_scale_range", "noise_range"):
            low, high = getattr(self, name)
            if not 0.0 < low < high < np.inf:
                raise ValueError(
                    f"{name} must be two positive, increasing numbers, got "
                    f"{(low, high)}."
                )
        low, high = self.length_scale_range
        if not low <= self.first_length_scale <= high:
            raise ValueError(
                f"first_length_scale must be within {(low, high)}, got "
                f"{self.first_length_scale}."
            )


def _matern(scaled: Float[np.ndarray, "..."]) -> Float[np.ndarray, "..."]:
    """Matérn-5/2 correlation at distance ``scaled`` = √5 |t − t'| / ℓ."""
    return np.asarray((1.0 + scaled + scaled**2 / 3.0) * np.exp(-scaled))


def _matern_log_gradient(
    scaled: Float[np.ndarray, "..."],
) -> Float[np.ndarray, "..."]:
    """Derivative of `_matern` with respect to log ℓ."""
    return np.asarray(scaled**2 * (1.0 + scaled) / 3.0 * np.exp(-scaled))


@dataclass(frozen=True, kw_only=True, slots=True)
class MixtureKernel:
    """K(t, t') = Σ_l h_l(t)^p h_l(t')^p Σ̂_l k_l(t, t'), standardised outputs."""

    regression: GaussianMixtureRegression
    """Where h_l and Σ̂_l come from."""
    length_scales: Float[np.ndarray, " C"]
    """ℓ_l of the Matérn-5/2 correlation k_l [phase]."""
    weight_power: float = 1.0
    """p; 1 as published."""

    def __call__(
        self, a: Float[np.ndarray, " A"], b: Float[np.ndarray, " B"]
    ) -> Float[np.ndarray, "6 A 6 B"]:
        """Covariance of every output at ``a`` with every output at ``b``."""
        distance = np.sqrt(5.0) * np.abs(np.subtract.outer(a, b))
        correlation = _matern(distance / self.length_scales[:, None, None])
        correlation *= self.weights(a)[:, :, None] * self.weights(b)[:, None, :]
        outputs = self.regression.conditional_covariances
        joint = np.tensordot(outputs, correlation, axes=(0, 0))
        return np.ascontiguousarray(joint.transpose(0, 2, 1, 3))

    def variance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Diagonal of K(t, t) for every output."""
        outputs = self.regression.conditional_covariances
        diagonals = np.diagonal(outputs, axis1=1, axis2=2)
        return np.asarray(self.weights(times).T ** 2 @ diagonals)

    def weights(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "C M"]:
        """h_l(t)^p."""
        weights: np.ndarray = self.regression.responsibilities(times).T
        return weights**self.weight_power


@dataclass(frozen=True, kw_only=True, slots=True)
class Evidence:
    """How well a kernel explains the demonstrations, as one function seen with noise.

    As published, the likelihood takes D demonstrations for D noisy views of a single
    function with prior mean m(t) and covariance K. They share their phases, so their
    average and their scatter about it are sufficient, exactly: the average is seen with
    noise σ²/D, and the scatter only bears on σ².
    """

    regression: GaussianMixtureRegression
    times: Float[np.ndarray, " T"]
    """Phases of the demonstrations that enter."""
    residual: Float[np.ndarray, " P"]
    """Average demonstration minus m(t), standardised, output by output; P = 6 T."""
    scatter: float
    """Sum of squares about the average."""
    count: int
    """Number of demonstrations D."""
    weight_power: float

    @classmethod
    def of(
        cls,
        regression: GaussianMixtureRegression,
        phases: int,
        weight_power: float,
    ) -> "Evidence":
        """The evidence of the regression's own demonstrations at ``phases`` of them."""
        aligned = regression.aligned
        chosen = thinned(len(aligned.times), phases)
        times = aligned.times[chosen]
        samples = regression.standardisation.apply(aligned.poses[:, chosen])
        average = samples.mean(axis=0)
        mean, _ = regression.standardised_moments(times)
        return cls(
            regression=regression,
            times=times,
            residual=(average - mean).T.ravel(),
            scatter=float(np.sum((samples - average) ** 2)),
            count=len(samples),
            weight_power=weight_power,
        )

    def negative_log_likelihood(
        self, log_parameters: Float[np.ndarray, " H"]
    ) -> tuple[float, Float[np.ndarray, " H"]]:
        """Value and gradient, up to a constant.

        Args:
            log_parameters: log ℓ_l of every component, then log σ².
        """
        length_scales = np.exp(log_parameters[:-1])
        noise = float(np.exp(log_parameters[-1]))
        kernel = MixtureKernel(
            regression=self.regression,
            length_scales=length_scales,
            weight_power=self.weight_power,
        )
        size, share = self.residual.size, noise / self.count
        covariance = kernel(self.times, self.times).reshape(size, size)
        covariance.flat[:: size + 1] += share
        factor = cho_factor(covariance.T, lower=True, overwrite_a=True)
        solved = cho_solve(factor, self.residual)
        log_root = float(np.sum(np.log(np.diag(factor[0]))))
        free = (self.count - 1) * size
        value = log_root + 0.5 * float(self.residual @ solved)
        value += 0.5 * (free * np.log(noise) + self.scatter / noise)
        # ∂/∂θ = ½ tr[(C⁻¹ − C⁻¹ r rᵀ C⁻¹) ∂C/∂θ]
        inner = cho_solve(factor, np.eye(size)) - np.outer(solved, solved)
        by_noise = 0.5 * (share * np.trace(inner) + free - self.scatter / noise)
        by_scale = self._scale_gradient(kernel, inner)
        return value, np.append(by_scale, by_noise)

    def _scale_gradient(
        self, kernel: MixtureKernel, inner: Float[np.ndarray, "P P"]
    ) -> Float[np.ndarray, " C"]:
        """½ tr[inner ∂K/∂log ℓ_l] for every component."""
        count = len(self.times)
        distance = np.sqrt(5.0) * np.abs(np.subtract.outer(self.times, self.times))
        slope = _matern_log_gradient(distance / kernel.length_scales[:, None, None])
        weights = kernel.weights(self.times)
        slope *= weights[:, :, None] * weights[:, None, :]
        over_outputs = np.tensordot(
            self.regression.conditional_covariances,
            inner.reshape(6, count, 6, count),
            axes=([1, 2], [0, 2]),
        )
        return np.asarray(0.5 * np.sum(over_outputs * slope, axis=(1, 2)))


def fit_kernel(
    regression: GaussianMixtureRegression,
    config: LengthScaleConfig,
    weight_power: float = 1.0,
) -> MixtureKernel:
    """The kernel of greatest likelihood; only its length-scales are learned."""
    evidence = Evidence.of(regression, config.phases, weight_power)
    count = len(regression.weights)
    start = np.append(
        np.full(count, config.first_length_scale), np.sqrt(np.prod(config.noise_range))
    )
    scale_bounds = tuple(np.log(config.length_scale_range))
    result = minimize(
        evidence.negative_log_likelihood,
        np.log(start),
        jac=True,
        method="L-BFGS-B",
        bounds=[scale_bounds] * count + [tuple(np.log(config.noise_range))],
        # The scatter makes the value large and almost constant: no stop for its sake.
        options={"ftol": 1e-15, "gtol": 1e-5},
    )
    return MixtureKernel(
        regression=regression,
        length_scales=np.exp(result.x[:-1]),
        weight_power=weight_power,
    )
