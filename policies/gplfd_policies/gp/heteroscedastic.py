"""Heteroscedastic Gaussian processes, and how the spread r(t) is estimated.

For one output and for independent outputs: Eqs. (10)–(13) and (15), which is Eq. (6)
with a diagonal B. The logarithm of an empirical variance with k degrees of freedom is
biased by ψ(k/2) − log(k/2) (``test_log_of_an_empirical_variance_is_biased``).
"""

from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.records import FINEST, short_repr
from gplfd_policies.arrays.shapes import Curve, Curves, Float, Times
from gplfd_policies.gp.exact import (
    ExactGP,
    Posterior,
    Replicates,
    fit_kernel,
    fit_kernel_and_noise,
    square_root,
)
from gplfd_policies.gp.kernels import RBF, LegendreBasis

_LEAST_VARIANCE = 1e-10
"""Smallest observation of exp z(t), relative to the variance of the output."""
_SHORTEST_SCALE, _LEAST_SCALE = 0.15, 0.1
"""Default and least shortest length-scale of z(t), as shares of the time span."""
_BASIS_SIZE = 48
LEAST_SPREAD = 3e-3
"""Default least standard deviation of repetitions, relative to the output's."""
_OFFSET_VARIANCE = 1e2
"""Prior variance of the level of z(t): vague, so that the data set it."""


@dataclass(frozen=True, kw_only=True, slots=True)
class NoiseProfile:
    """A noise variance r(t) = exp z(t) + floor > 0, smooth in time.

    z(t) is a level plus a curve in a basis, constant outside the basis's interval.
    """

    level: float
    basis: LegendreBasis
    coefficients: Float[np.ndarray, " Q"]
    floor: float = 0.0

    __repr__ = short_repr

    @staticmethod
    def basis_over(times: Times) -> LegendreBasis:
        """The basis of a profile over demonstrations at ``times``."""
        start, stop = float(times[0]), float(times[-1])
        return LegendreBasis(start=start, stop=stop, size=_BASIS_SIZE)

    @classmethod
    def constant(cls, times: Times, variance: float) -> "NoiseProfile":
        """The same variance everywhere."""
        basis = cls.basis_over(times)
        level, varying = float(np.log(variance)), np.zeros(basis.size)
        return cls(level=level, basis=basis, coefficients=varying)

    def log_variance(self, times: Times) -> Curve:
        """Its logarithm at ``times``."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        varying = self.level + self.basis.matrix(inside) @ self.coefficients
        with np.errstate(divide="ignore"):
            floor = np.log(self.floor)  # -inf for none
        return np.asarray(np.logaddexp(varying, floor))

    def variance(self, times: Times) -> Curve:
        """The noise variance r(t) at ``times``."""
        return np.asarray(np.exp(self.log_variance(times)))

    def log_variance_rate(self, times: Times) -> Curve:
        """Its logarithm's derivative; zero outside the demonstrated interval."""
        inside = np.clip(times, self.basis.start, self.basis.stop)
        matrix = self.basis.matrix(inside)
        slope = matrix @ self.basis.differentiate(self.coefficients)
        varying = self.level + matrix @ self.coefficients
        share = np.exp(varying - self.log_variance(times))
        return np.where(inside == times, share * slope, 0.0)


@runtime_checkable
class NoiseModel(Protocol):
    """A rule that turns aligned demonstrations of one output into r(t)."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t) from D curves of order one on M common times."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HomoscedasticNoise:
    """One noise variance σ_n² for the whole task, Eq. (3), by maximum likelihood.

    It underestimates the spread where demonstrations differ and overestimates it where
    they agree (Fig. 2). With one demonstration it is the scatter of its samples.
    """

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate σ_n², as `NoiseModel.fit`."""
        _, variance = fit_kernel_and_noise(Replicates.from_samples(times, samples))
        return NoiseProfile.constant(times, variance)


@dataclass(frozen=True, kw_only=True, slots=True)
class MapNoise(Quantities):
    """The default: pooled variances, corrected, then the most likely z(t).

    1. v_i = SS_i / k with k = D − 1, and z_i = log v_i − ψ(k/2) + log(k/2): unbiased
       observations of log r with the *known* noise variance ψ'(k/2), so the process
       on z needs no noise hyper-parameter.
    2. Its (l, σ) by maximum likelihood.
    3. With these fixed, Newton's method for the mode of the exact likelihood of the
       sums of squares, SS_i ~ r_i χ²_k:
       Σ_i [k/2 z_i + ½ SS_i exp(−z_i)] + ½ (z − m)ᵀ K_z⁻¹ (z − m), which is convex.
    4. r(t) = exp z(t) + `least_spread`²: where demonstrations agree by chance, the next
       one may differ (``test_agreement_by_chance_does_not_ruin_the_likelihood``).
    """

    shortest_scale: float = quantity(_SHORTEST_SCALE, low=_LEAST_SCALE, high=1.0)
    """Shortest length-scale of z(t), as a share of the time span."""
    least_spread: float = quantity(LEAST_SPREAD, low=0.0, high=1.0)
    """Least standard deviation of repetitions, relative to that of the output."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t) from D ≥ 2 curves, as `NoiseModel.fit`."""
        replicates = Replicates.from_samples(times, samples)
        free = replicates.count - 1
        if free < 1:
            raise ValueError(
                "The spread between demonstrations needs at least 2 of them, got 1. "
                'Give more, or choose noise="homoscedastic", which models the '
                "scatter of the samples around one smooth curve."
            )
        # All demonstrations start at the same pose: there the spread is exactly zero.
        pooled = np.maximum(replicates.within / free, _LEAST_VARIANCE)
        half = 0.5 * free
        observed = np.log(pooled) - float(scipy.special.digamma(half)) + np.log(half)
        level = float(np.mean(observed))
        variance = np.full(len(times), float(scipy.special.polygamma(1, half)))
        shortest = self.shortest_scale
        kernel, _ = fit_kernel(times, observed - level, variance, shortest)
        basis = NoiseProfile.basis_over(times)
        # The mode of z − level = features @ position, with position ~ N(0, I).
        vague = _OFFSET_VARIANCE * np.outer(basis.root_weights, basis.root_weights)
        root = square_root(basis.kernel_matrix(kernel) + vague)
        features = basis.matrix(times) @ root

        def cost(position: np.ndarray) -> tuple[float, np.ndarray]:
            deviation = features @ position
            # A step that overshoots may overflow; the line search rejects infinity.
            with np.errstate(over="ignore"):
                scaled = half * pooled * np.exp(-level - deviation)
            value = np.sum(half * deviation + scaled) + 0.5 * position @ position
            return float(value), scaled

        position = np.zeros(features.shape[1])
        value, scaled = cost(position)
        for _ in range(100):
            gradient = features.T @ (half - scaled) + position
            hessian = features.T @ (scaled[:, None] * features)
            hessian[np.diag_indices_from(hessian)] += 1.0
            step = np.linalg.solve(hessian, gradient)
            decrease = float(gradient @ step)
            if decrease < 1e-12 * len(times):
                break
            length = 1.0
            candidate, candidate_scaled = cost(position - step)
            while not candidate <= value - 1e-4 * length * decrease and length > 1e-6:
                length *= 0.5
                candidate, candidate_scaled = cost(position - length * step)
            position = position - length * step
            value, scaled = candidate, candidate_scaled
        varying = root @ position
        floor = self.least_spread**2
        return NoiseProfile(level=level, basis=basis, coefficients=varying, floor=floor)


@dataclass(frozen=True, kw_only=True, slots=True)
class KerstingNoise(Quantities):
    """The paper's estimate: Kersting's "most likely" iteration.

    A homoscedastic process is fitted first; each observation then gives
    z = log ½((y − μ)² + s²), with the current prediction μ and s²; a second process
    smooths z; and the loop repeats with r = exp z. The fixed point is biased: the
    standard deviation converges to about 0.81 of the truth. r at most halves per pass.
    """

    n_iterations: int = quantity(10, low=1)
    """Number of passes."""
    shortest_scale: float = quantity(_SHORTEST_SCALE, low=_LEAST_SCALE, high=1.0)
    """As in `MapNoise`."""

    def fit(self, times: Times, samples: Curves) -> NoiseProfile:
        """Estimate r(t), as `NoiseModel.fit`."""
        replicates = Replicates.from_samples(times, samples)
        kernel, constant = fit_kernel_and_noise(replicates)
        profile = NoiseProfile.constant(times, constant)
        for _ in range(self.n_iterations):
            # Posterior mean and variance of f at the common times.
            noise = profile.variance(times)
            basis = LegendreBasis.for_length_scale(
                times[0], times[-1], kernel.length_scale
            )
            assert basis is not None, "fitted length-scales are never so short"
            weights, factor = replicates.condition_in(basis, kernel, noise)
            matrix = basis.matrix(times)
            mean = matrix @ weights
            variance = np.sum((matrix @ factor) ** 2, axis=1)
            # A process through log-variances that are observed with unknown noise.
            spread = 0.5 * ((samples - mean) ** 2 + variance + noise)
            observed = np.log(np.maximum(spread, _LEAST_VARIANCE))
            level = float(np.mean(observed))
            logs = Replicates.from_samples(times, observed - level)
            smooth, scatter = fit_kernel_and_noise(logs, shortest=self.shortest_scale)
            basis = NoiseProfile.basis_over(times)
            noise = np.full(len(times), scatter)
            of_logs, _ = logs.condition_in(basis, smooth, noise)
            profile = NoiseProfile(level=level, basis=basis, coefficients=of_logs)
            noise = profile.variance(times)
            kernel, _ = fit_kernel(times, replicates.mean, noise / replicates.count)
        return profile


Moment = Float[np.ndarray, "M d"]  # One number per time and output.


def offset_and_scale(samples: Curves, centred: bool) -> tuple[float, float]:
    """Return the average of an output, or zero if not centred, and its scale."""
    if centred:
        offset, size = float(np.mean(samples)), float(np.std(samples))
    else:
        offset, size = 0.0, float(np.sqrt(np.mean(samples**2)))
    return offset, max(size, FINEST)


@dataclass(frozen=True, kw_only=True)
class HeteroscedasticGP:
    """Mean f(t) and noise variance r(t) of one output, learned from D demonstrations.

    Replicates, kernel and noise are those of the output minus its offset, over its
    scale. The offset is the average of the output, or zero for the residual of a given
    prior mean. So the prior mean is the demonstrations' average; in the paper it is
    zero, which only matters outside the demonstrated interval.
    """

    offset: float
    scale: float
    replicates: Replicates
    kernel: RBF
    noise: NoiseProfile

    __repr__ = short_repr

    @cached_property
    def latent(self) -> ExactGP:
        """Posterior of the scaled f, in the dense form that can extrapolate."""
        times = self.replicates.times
        return self.replicates.condition(self.kernel, self.noise.variance(times))


@dataclass(frozen=True, kw_only=True, slots=True)
class OutputMoments:
    """Moments of the mean function f and of the noise at M times, per output.

    `mean` is Eq. (10), `latent` the variance of f, Eq. (11) without R, `noise` r(t);
    rates are time derivatives.
    """

    mean: Moment
    mean_rate: Moment
    latent: Moment
    latent_rate: Moment
    noise: Moment
    noise_rate: Moment


class _Spectral(NamedTuple):
    """Posteriors of all outputs in one basis, and their curves in a finer one."""

    coarse: LegendreBasis
    posteriors: list[Posterior]
    fine: LegendreBasis
    curves: Float[np.ndarray, "Q C"]
    """Mean, logarithm of the noise, variance, and the slopes of the three."""


@dataclass(frozen=True, kw_only=True)
class MultiOutputGP:
    """Independent heteroscedastic processes on the same demonstrations."""

    outputs: tuple[HeteroscedasticGP, ...]

    __repr__ = short_repr

    @classmethod
    def fit(
        cls,
        times: Times,
        poses: Float[np.ndarray, "D M d"],
        noise: NoiseModel,
        *,
        centred: bool = True,
    ) -> "MultiOutputGP":
        """Learn outputs from D curves each; prior mean zero if they are not centred."""
        outputs = []
        for samples in np.moveaxis(poses, 2, 0):
            offset, scale = offset_and_scale(samples, centred)
            scaled = (samples - offset) / scale
            profile = noise.fit(times, scaled)
            replicates = Replicates.from_samples(times, scaled)
            variance = profile.variance(times) / replicates.count
            kernel, _ = fit_kernel(times, replicates.mean, variance)
            output = HeteroscedasticGP(
                offset=offset,
                scale=scale,
                replicates=replicates,
                kernel=kernel,
                noise=profile,
            )
            outputs.append(output)
        return cls(outputs=tuple(outputs))

    @property
    def shortest_length_scale(self) -> float:
        """Shortest length-scale of any mean function, in the unit of time."""
        return min(output.kernel.length_scale for output in self.outputs)

    @cached_property
    def _spectral(self) -> _Spectral | None:
        """All outputs in common bases; None for too short a length-scale."""
        times = self.outputs[0].replicates.times
        coarse = LegendreBasis.for_length_scale(
            float(times[0]), float(times[-1]), self.shortest_length_scale
        )
        if coarse is None:
            return None
        posteriors = [
            output.replicates.condition_in(
                coarse, output.kernel, output.noise.variance(times)
            )
            for output in self.outputs
        ]
        # A variance is a square: twice the degree of the posterior it comes from.
        start, stop, size = coarse.start, coarse.stop, 2 * coarse.size
        fine = LegendreBasis(start=start, stop=stop, size=size)
        nodes = fine.nodes
        matrix = coarse.matrix(nodes)
        curves = (
            [matrix @ weights for weights, _ in posteriors]
            + [output.noise.log_variance(nodes) for output in self.outputs]
            + [np.sum((matrix @ factor) ** 2, axis=1) for _, factor in posteriors]
        )
        values = fine.root_weights[:, None] * np.stack(curves, axis=1)
        both = np.concatenate([values, fine.differentiate(values)], axis=1)
        return _Spectral(coarse, posteriors, fine, both)

    def moments(self, times: Times) -> OutputMoments:
        """Means, variances and their rates; inside the demonstrations in O(M)."""
        spectral = self._spectral
        if spectral is not None and spectral.fine.covers(times):
            parts = np.split(spectral.fine.matrix(times) @ spectral.curves, 6, axis=1)
            mean, log_noise, latent, mean_rate, log_noise_rate, latent_rate = parts
            noise, latent = np.exp(log_noise), np.maximum(latent, 0.0)
            noise_rate = noise * log_noise_rate
        else:
            dense = [output.latent for output in self.outputs]
            profiles = [output.noise for output in self.outputs]
            rates = [process.rates(times) for process in dense]
            mean = np.stack([process.mean(times) for process in dense], axis=1)
            latent = np.stack([process.variance(times) for process in dense], axis=1)
            mean_rate = np.stack([rate for rate, _ in rates], axis=1)
            latent_rate = np.stack([rate for _, rate in rates], axis=1)
            noise = np.stack([profile.variance(times) for profile in profiles], axis=1)
            slopes = [profile.log_variance_rate(times) for profile in profiles]
            noise_rate = noise * np.stack(slopes, axis=1)
        scale = np.array([output.scale for output in self.outputs])
        offset = np.array([output.offset for output in self.outputs])
        return OutputMoments(
            mean=offset + scale * mean,
            mean_rate=scale * mean_rate,
            latent=scale**2 * latent,
            latent_rate=scale**2 * latent_rate,
            noise=scale**2 * noise,
            noise_rate=scale**2 * noise_rate,
        )

    def latent_covariance(self, times: Times) -> Float[np.ndarray, "d M M"]:
        """Covariance of f over time, per output, Eq. (11) without R."""
        spectral = self._spectral
        if spectral is None or not spectral.coarse.covers(times):
            unscaled = [output.latent.covariance(times) for output in self.outputs]
        else:
            matrix = spectral.coarse.matrix(times)
            halves = [matrix @ factor for _, factor in spectral.posteriors]
            unscaled = [half @ half.T for half in halves]
        scale = np.array([output.scale for output in self.outputs])
        return np.asarray(scale[:, None, None] ** 2 * np.stack(unscaled))
