"""Model of the smooth deviations of demonstrations from their mean.

The paper puts the spread of the demonstrations into Eq. (11) as diag(R), white noise,
so that the door's radius observed at one phase has no effect at other phases. Here a
deviation of one output is a process of the same variance r(t) with covariance

    √(u(t) u(t')) [g k(t, t'; L) + (1 − g)]          variation with the task
  + √(v(t) v(t')) [(1 − w) k(t, t'; S) + w 1(t = t')]    the hand's wobble, white noise

where v = (r⁻ᵖ + c⁻ᵖ)^(−1/p), p = _SHARPNESS, is a wobble of constant variance c that
never exceeds the spread, u = r − v is the rest, and k is a unit RBF.

The five parameters maximise the likelihood of the deviations e_k = y_k − ȳ. These sum
to zero, which leaves D − 1 independent ones
(``test_deviation_likelihood_counts_degrees_of_freedom``):

    log p = −½ [(D − 1) log |C| + tr(C⁻¹ Σ_k e_k e_kᵀ)] + const.

This likelihood mainly depends on the variation between neighbouring samples; a forecast
needs that over half a task. Therefore one factor on the wobble variances c of all
outputs is selected by `forecast_score`: each demonstration in turn is compared to the
mean of the others, its start is conditioned on, and the rest is scored by its Student-t
density (``test_wobble_is_what_forecasts_left_out_demonstrations_best``).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from functools import partial

import numpy as np
import scipy

from gplfd_policies.arrays.records import thinned
from gplfd_policies.arrays.shapes import Curve, Curves, Float, Gram, Outputs, Times
from gplfd_policies.gp.exact import factorise
from gplfd_policies.gp.kernels import RBF

KernelParameters = Float[np.ndarray, "5"]
"""θ = (log c, logit w, logit g, log L, log S)."""

_GRID = 60
"""Samples of a demonstration used: deviations are smooth, and the cost is cubic."""
_NEGLIGIBLE = 1e-4
"""Where r is below this fraction of its average, deviations are negligible."""
_LONG = (0.3, 5.0)
"""Range of L, as a fraction of the time span; forecasts hardly depend on it."""
_SHORT = (0.1, 0.5)
"""Range of S: an agent would attribute the noise of its own hand to the door if shorter
correlations, like white noise, were allowed (docs/method.md)."""
_SHARPNESS = 2.0
"""p, sharpness of the transition of the wobble from the spread's size to its own."""
_WOBBLE = (1e-6, 1e1)  # range of c, relative to the average of r
MODEL_WORTH = Fraction(35, 3)
"""Weight of the model's covariance, in independent deviations (docs/method.md)."""
_RELATIVE_JITTER = 1e-6  # white variance relative to r that keeps C positive definite
_FACTORS = 2.0 ** np.arange(-2.0, 8.0)
"""Factors on c to choose from; beyond them all or nothing of r is wobble."""
_FORECAST_GRID = 30  # samples of a demonstration used to score forecasts
_STARTS = (0.2, 0.35, 0.5)
"""Observed shares of the demonstration when the rest is forecast."""


def conjugate_share(count: int) -> float:
    """Return the demonstrations' share (D − 1)/(w + D − 1) of a deviation's covariance.

    It is that of the posterior mean with an inverse-Wishart prior of w deviations
    (``test_mixed_covariance_is_the_mean_of_the_inverse_wishart_posterior``).
    """
    return float((count - 1) / (MODEL_WORTH + count - 1))


@dataclass(frozen=True, kw_only=True, slots=True)
class DeviationProcess:
    """The covariance of one output's deviations, in the symbols of the module."""

    wobble: float
    """c, the variance of the wobble, in the output's unit squared."""
    varying: float
    """g, the share of the variation with the task that changes over L."""
    white: float
    """w, the share of the wobble that is white."""
    long_scale: float
    short_scale: float
    """S; scales are in the unit of time."""

    def __post_init__(self) -> None:
        within = 0.0 <= self.varying <= 1.0 and 0.0 <= self.white <= 1.0
        if not (self.wobble > 0.0 and within):
            raise ValueError(f"wobble must be > 0 and shares in [0, 1], got {self}")

    def split(self, noise: Curve) -> tuple[Curve, Curve]:
        """r(t) as (u(t), v(t)): task variation and wobble."""
        excess = np.log1p((noise / self.wobble) ** _SHARPNESS) / _SHARPNESS
        # u = r − v without cancellation where the spread is all wobble
        return -noise * np.expm1(-excess), noise * np.exp(-excess)

    def smooth_covariance(self, times: Times, noise: Curve) -> Gram:
        """C without its white part, for r(t) = ``noise``."""
        task, wobble = (np.sqrt(part) for part in self.split(noise))
        long = RBF(length_scale=self.long_scale, signal_std=1.0)(times, times)
        short = RBF(length_scale=self.short_scale, signal_std=1.0)(times, times)
        factor = self.varying * long + (1.0 - self.varying)
        covariance: np.ndarray = np.outer(task, task) * factor
        covariance += (1.0 - self.white) * np.outer(wobble, wobble) * short
        return covariance

    def white_variance(self, noise: Curve) -> Curve:
        """The white part of C."""
        return self.white * self.split(noise)[1]


class DeviationLikelihood:
    """The log-likelihood of θ from Σ_k e_k e_kᵀ of D − 1 degrees of freedom."""

    def __init__(self, times: Times, deviations: Curves, noise: Curve) -> None:
        """Take D deviations e_k = y_k − ȳ, thinned."""
        kept = thinned(len(times), _GRID)
        kept = kept[noise[kept] >= _NEGLIGIBLE * np.mean(noise)]
        chosen = deviations[:, kept]
        self.times, self.noise = times[kept], noise[kept]
        self.scatter, self.free = chosen.T @ chosen, len(deviations) - 1
        self._squared = np.subtract.outer(self.times, self.times) ** 2

    def process(self, theta: KernelParameters) -> DeviationProcess:
        """Return the covariance for θ."""
        return DeviationProcess(
            wobble=float(np.exp(theta[0])),
            white=float(scipy.special.expit(theta[1])),
            varying=float(scipy.special.expit(theta[2])),
            long_scale=float(np.exp(theta[3])),
            short_scale=float(np.exp(theta[4])),
        )

    def __call__(self, theta: KernelParameters) -> tuple[float, KernelParameters]:
        """Return the log-likelihood at θ, and its gradient, (5,)."""
        process = self.process(theta)
        covariance = process.smooth_covariance(self.times, self.noise)
        task, wobble = process.split(self.noise)
        white_noise = process.white * wobble + _RELATIVE_JITTER * self.noise
        covariance.flat[:: len(self.times) + 1] += white_noise
        factor = factorise(covariance)
        inverse = factor.solve(np.eye(len(self.times)))
        misfit = float(np.sum(inverse * self.scatter))
        value = -0.5 * (self.free * factor.log_determinant() + misfit)
        # d log p = ½ tr((C⁻¹ scatter C⁻¹ − (D − 1) C⁻¹) dC)
        sensitivity = 0.5 * (inverse @ self.scatter @ inverse - self.free * inverse)
        # tr(sensitivity · dC/dθ) for every parameter.
        squared = self._squared
        long = np.exp(-0.5 * squared / process.long_scale**2)
        short = np.exp(-0.5 * squared / process.short_scale**2)
        root_task, root_wobble = np.sqrt(task), np.sqrt(wobble)
        by_task = sensitivity * np.outer(root_task, root_task)
        by_wobble = sensitivity * np.outer(root_wobble, root_wobble)
        share, white = process.varying, process.white
        task_part = by_task * (share * long + 1.0 - share)
        smooth_part = (1.0 - white) * by_wobble * short
        white_part = white * np.diag(by_wobble)
        # dv/dlog c = v (v/c)ᵖ and u = r − v; a square root halves each, twice.
        slope = wobble * (wobble / process.wobble) ** _SHARPNESS
        by_size = np.sum((smooth_part.sum(axis=1) + white_part) * slope / wobble)
        by_size -= np.sum(task_part.sum(axis=1) * slope / task)
        by_white = np.sum(white_part) * (1.0 - white) - white * np.sum(smooth_part)
        by_share = share * (1.0 - share) * np.sum(by_task * (long - 1.0))
        by_long = share * np.sum(by_task * long * squared) / process.long_scale**2
        by_short = np.sum(smooth_part * squared) / process.short_scale**2
        return value, np.array([by_size, by_white, by_share, by_long, by_short])


def fit_deviations(times: Times, deviations: Curves, noise: Curve) -> DeviationProcess:
    """Fit the covariance of one output's deviations e_k = y_k − ȳ, D ≥ 2."""
    likelihood = DeviationLikelihood(times, deviations, noise)
    average, span = float(np.mean(noise)), float(times[-1] - times[0])

    def objective(theta: np.ndarray) -> tuple[float, np.ndarray]:
        value, gradient = likelihood(theta)
        return -value, -gradient

    bounds = [
        tuple(np.log(np.multiply(_WOBBLE, average))),
        (-12.0, 4.0),
        (-8.0, 8.0),
        tuple(np.log(np.multiply(_LONG, span))),
        tuple(np.log(np.multiply(_SHORT, span))),
    ]
    starts = [
        np.array([np.log(size * average), -3.0, 0.0, np.log(span), np.log(0.2 * span)])
        for size in (1e-3, 1e-1)
    ]
    search = partial(
        scipy.optimize.minimize, objective, jac=True, method="L-BFGS-B", bounds=bounds
    )
    return likelihood.process(min(map(search, starts), key=lambda result: result.fun).x)


def wobbling(
    processes: Sequence[DeviationProcess],
    times: Times,
    deviations: Float[np.ndarray, "D M 6"],
    noise: Outputs,
) -> tuple[DeviationProcess, ...]:
    """Return processes with the wobble that best forecasts left-out demonstrations."""
    if len(deviations) < 3:
        return tuple(processes)
    thin = thinned(len(times), _FORECAST_GRID)
    choices = [
        tuple(replace(process, wobble=factor * process.wobble) for process in processes)
        for factor in _FACTORS.tolist()
    ]
    share = conjugate_share(len(deviations))
    spreads, parts = noise[thin].T, np.moveaxis(deviations[:, thin], 2, 0)

    def score(choice: Sequence[DeviationProcess]) -> float:
        return sum(
            forecast_score(
                process.smooth_covariance(times[thin], spread),
                process.white_variance(spread),
                curves,
                share,
            )
            for process, spread, curves in zip(choice, spreads, parts, strict=True)
        )

    return max(choices, key=score)


def forecast_score(
    smooth: Gram, white: Curve, deviations: Curves, empirical_share: float
) -> float:
    """Mean log density of the rest of a demonstration, over D ≥ 3 of them and starts.

    ``smooth`` and ``white`` are the model's covariance of a deviation; a share of the
    smooth one is replaced by that of the other demonstrations' own curves.
    """
    count, size = deviations.shape
    products = np.einsum("km,kn->kmn", deviations, deviations)
    # Around the mean of the others: the scatter without e_k.
    others = products.sum(axis=0) - products * count / (count - 1.0)
    covariance = (1.0 - empirical_share) * smooth
    covariance = covariance + empirical_share / (count - 2.0) * others
    covariance *= count / (count - 1.0)
    left_out = deviations * count / (count - 1.0)
    diagonal = np.diagonal(covariance, axis1=1, axis2=2)
    noise = white + _RELATIVE_JITTER * np.diagonal(smooth)
    free = count - 1.0
    gammaln = scipy.special.gammaln
    constant = gammaln(0.5 * (free + 1.0)) - gammaln(0.5 * free)
    scores = []
    for start in _STARTS:
        seen = max(round(start * size), 1)
        gram = covariance[:, :seen, :seen] + np.diag(noise[:seen])
        cross = covariance[:, :seen, seen:]
        gain = np.linalg.solve(gram, cross)
        error = left_out[:, seen:] - np.einsum("ks,ksr->kr", left_out[:, :seen], gain)
        explained = np.einsum("ksr,ksr->kr", cross, gain)
        variance = np.maximum(diagonal[:, seen:] - explained, 0.0) + noise[seen:]
        density = constant - 0.5 * np.log(np.pi * free * variance)
        density -= 0.5 * (free + 1.0) * np.log1p(error**2 / (free * variance))
        scores.append(np.mean(density))
    return float(np.mean(scores))
