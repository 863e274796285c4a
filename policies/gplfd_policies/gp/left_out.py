"""How well deviations forecast a demonstration that is left out.

The likelihood of `gplfd_policies.gp.deviations` asks for the most probable covariance
of whole curves, in which every sample after the first is told by its neighbours: it
settles how curves wobble from sample to sample, and says little of how far they have
wandered half a task later. That is what a forecast needs. So every demonstration in
turn is compared to the mean of the others, e_k D/(D − 1), its start is conditioned on,
and the rest is scored by its Student-t density, ν = D − 1, sample by sample.

By it one number is chosen, a factor on the wobbles' variances c of all outputs: the
likelihood keeps their proportions and all else
(``test_wobble_is_what_forecasts_left_out_demonstrations_best``).
"""

from collections.abc import Iterator, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Float
from scipy.special import gammaln

from gplfd_policies.demonstrations.aligned import thinned
from gplfd_policies.gp.deviations import DeviationProcess, conjugate_share

_FACTORS = 2.0 ** np.arange(-2.0, 8.0)
"""Factors on c among which is chosen; beyond them all or nothing of r is wobble."""
_GRID = 30
"""Samples of a demonstration used."""
_STARTS = (0.2, 0.35, 0.5)
"""Shares of the demonstration that are seen."""
_RELATIVE_JITTER = 1e-6


def wobbling(
    processes: Sequence[DeviationProcess],
    times: Float[np.ndarray, " M"],
    deviations: Float[np.ndarray, "D M 6"],
    noise: Float[np.ndarray, "M 6"],
) -> tuple[DeviationProcess, ...]:
    """The processes with the wobble that forecasts left-out demonstrations best.

    Args:
        processes: the most likely one of every output.
        times: common times, shape (M,).
        deviations: e_k = y_k − ȳ, shape (D, M, 6). Two demonstrations have one
            deviation between them, and none to leave out: nothing changes.
        noise: r(t) > 0, shape (M, 6).
    """
    if len(deviations) < 3:
        return tuple(processes)
    thin = thinned(len(times), _GRID)
    choices = [
        tuple(replace(each, wobble=factor * each.wobble) for each in processes)
        for factor in _FACTORS.tolist()
    ]

    share = conjugate_share(len(deviations))

    def score(choice: Sequence[DeviationProcess]) -> float:
        return sum(
            forecast_score(
                each.smooth_covariance(times[thin], spread),
                each.white_variance(spread),
                curves,
                share,
            )
            for each, spread, curves in zip(
                choice,
                noise[thin].T,
                np.moveaxis(deviations[:, thin], 2, 0),
                strict=True,
            )
        )

    return max(choices, key=score)


def forecast_score(
    smooth: Float[np.ndarray, "N N"],
    white: Float[np.ndarray, " N"],
    deviations: Float[np.ndarray, "D N"],
    empirical_share: float,
) -> float:
    """Mean logarithm of the density of what follows, over demonstrations and starts.

    Args:
        smooth: covariance of a deviation at N phases.
        white: its white part.
        deviations: e_k = y_k − ȳ of D ≥ 3 demonstrations.
        empirical_share: share of the smooth covariance that is replaced by that of the
            other demonstrations' own curves.
    """
    count = len(deviations)
    found = [
        _t_density(error, variance, count - 1.0)
        for error, variance in _rests(smooth, white, deviations, empirical_share)
    ]
    return float(np.mean([np.mean(each) for each in found]))


def _rests(
    smooth: Float[np.ndarray, "N N"],
    white: Float[np.ndarray, " N"],
    deviations: Float[np.ndarray, "D N"],
    empirical_share: float,
) -> Iterator[tuple[Float[np.ndarray, "D R"], Float[np.ndarray, "D R"]]]:
    """Yield errors of the rests after every start, and their variances."""
    count, size = deviations.shape
    products = np.einsum("km,kn->kmn", deviations, deviations)
    # Around the mean of the others: what is left of the scatter without e_k.
    others = products.sum(axis=0) - products * count / (count - 1.0)
    covariance = (1.0 - empirical_share) * smooth
    covariance = covariance + empirical_share / (count - 2.0) * others
    covariance *= count / (count - 1.0)
    left_out = deviations * count / (count - 1.0)
    variance = np.diagonal(covariance, axis1=1, axis2=2)
    noise = white + _RELATIVE_JITTER * np.diagonal(smooth)
    for start in _STARTS:
        seen = max(round(start * size), 1)
        gram = covariance[:, :seen, :seen] + np.diag(noise[:seen])
        cross = covariance[:, :seen, seen:]
        gain = np.linalg.solve(gram, cross)
        error = left_out[:, seen:] - np.einsum("ks,ksr->kr", left_out[:, :seen], gain)
        explained = np.einsum("ksr,ksr->kr", cross, gain)
        yield error, np.maximum(variance[:, seen:] - explained, 0.0) + noise[seen:]


def _t_density(
    error: Float[np.ndarray, "D R"], variance: Float[np.ndarray, "D R"], free: float
) -> Float[np.ndarray, "D R"]:
    """Logarithm of the Student-t density of every error."""
    constant = gammaln(0.5 * (free + 1.0)) - gammaln(0.5 * free)
    density: np.ndarray = constant - 0.5 * np.log(np.pi * free * variance)
    density -= 0.5 * (free + 1.0) * np.log1p(error**2 / (free * variance))
    return density
