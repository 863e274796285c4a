"""Interquartile mean and probability of improvement.

After Agarwal et al., *Deep reinforcement learning at the edge of the statistical
precipice*, NeurIPS 2021. Scores have shape (seeds, strata), greater is better. A
stratum is a door at a level of a trial. NaN is a run that does not exist, minus
infinity one that failed. Intervals are 95 % percentiles of a stratified bootstrap.

The paper draws the runs of each stratum alone (unit "run"). Here the doors of a seed
share the demonstrations, and policies share seeds. With the unit "seed", a seed is
drawn with all its strata, for both policies of a comparison.
"""

import math
from typing import Final, Literal

import numpy as np

from gplfd_experiments.analysis.results.statistics import FEWEST_PAIRS, Shift
from gplfd_experiments.files.arrays import FloatArray

Unit = Literal["seed", "run"]

REPLICATES: Final = 2000
"""Number of samples of the bootstrap; its seed is 0."""


def interquartile_mean(scores: FloatArray, unit: Unit = "seed") -> Shift:
    """Return the mean of the middle half of all runs; −∞ if more than 1/4 failed."""
    counts = _drawn(scores.shape, unit)[0].reshape(-1, scores.size)
    order = np.argsort(scores, axis=None)[: np.count_nonzero(~np.isnan(scores))]
    values, counts = scores.ravel()[order], counts[:, order]
    up_to = np.cumsum(counts, axis=1)
    cut = up_to[:, -1:] // 4
    # Weight of each run in the middle half.
    inside = np.minimum(up_to, up_to[:, -1:] - cut) - np.maximum(up_to - counts, cut)
    inside = np.maximum(inside, 0.0)
    known = np.isfinite(values)
    sums = np.einsum("rk,k->r", inside[:, known], values[known])
    sums[np.any(inside[:, ~known] > 0.0, axis=1)] = -math.inf
    return _interval(_ratio(sums, np.sum(inside, axis=1)), len(scores))


def probability_of_improvement(
    first: FloatArray, second: FloatArray, unit: Unit = "seed"
) -> Shift:
    """Return P(first > second) of independent runs, the mean over the strata.

    Ties count half. Strata that one of them lacks are excluded.
    """
    ours, theirs = first[:, None, :], second[None, :, :]
    compared = ~(np.isnan(ours) | np.isnan(theirs))
    wins = np.where(ours == theirs, 0.5, ours > theirs)
    own, other = _drawn(first.shape, unit)
    # Multiples of one half: the sums are exact.
    won, pairs = (
        np.einsum("rim,ijm,rjm->rm", own, table, other, optimize=True)
        for table in (wins * compared, compared.astype(float))
    )
    total = np.nansum(_ratio(won, pairs), axis=1)
    return _interval(_ratio(total, np.sum(pairs > 0.0, axis=1)), len(first))


def _drawn(shape: tuple[int, ...], unit: Unit) -> FloatArray:
    """Return how often a sample contains a run: (policy, sample, seed, stratum).

    The first sample is the data as they are.
    """
    seeds, strata = shape
    alike = (1, REPLICATES, 1) if unit == "seed" else (2, REPLICATES, strata)
    rng = np.random.default_rng(0)
    drawn = rng.multinomial(seeds, np.full(seeds, 1.0 / seeds), size=alike)
    counts = np.ones((2, 1 + REPLICATES, seeds, strata))
    counts[:, 1:] = np.swapaxes(drawn, 2, 3)
    return counts


def _ratio(part: FloatArray, whole: FloatArray) -> FloatArray:
    ratio = np.full(part.shape, math.nan)
    np.divide(part, whole, out=ratio, where=whole > 0)
    return ratio


def _interval(values: FloatArray, seeds: int) -> Shift:
    """Return the first value, and percentiles of the others (bootstrap samples)."""
    samples = np.sort(values[1:][~np.isnan(values[1:])])
    low, high = -math.inf, math.inf
    if seeds >= FEWEST_PAIRS and samples.size:
        last = samples.size - 1
        low, high = samples[[math.floor(0.025 * last), math.ceil(0.975 * last)]]
    return Shift(estimate=float(values[0]), low=float(low), high=float(high), n=seeds)
