"""Paired tests and intervals, exact where the number of pairs allows it.

Policies are compared seed by seed, by Wilcoxon's signed-rank test of their mean values;
several tests at once are corrected after Holm, *A simple sequentially rejective
multiple test procedure*, Scandinavian Journal of Statistics 6:65-70, 1979. The typical
difference of pairs is estimated after Hodges and Lehmann, *Estimates of location based
on rank tests*, Annals of Mathematical Statistics 34:598-611, 1963.
"""

import math
from collections.abc import Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm, t, wilcoxon

FloatArray = NDArray[np.float64]

FEWEST_PAIRS: Final = 6
"""With fewer pairs no two-sided signed-rank test can reach 5 %."""

_EXACT_UP_TO: Final = 60
_LEVEL: Final = 0.95


@dataclass(frozen=True, kw_only=True, slots=True)
class Shift:
    """Typical difference of pairs, first minus second."""

    estimate: float
    """Median of the means of any two differences (Hodges and Lehmann), or the mean."""
    low: float
    """Lower end of its 95 % interval; minus infinity with too few pairs."""
    high: float
    """Upper end of its 95 % interval; infinity with too few pairs."""
    n: int
    """Number of pairs."""


Key = tuple[int, str]
"""Seed of a task, and what names it among those of all policies."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Pairs:
    """Values of two policies at the tasks that both have, in one order."""

    seeds: tuple[int, ...]
    """Seed of each task."""
    first: tuple[float, ...]
    """Values of the first policy."""
    second: tuple[float, ...]
    """Values of the second."""

    def per_seed(self) -> tuple[list[float], list[float]]:
        """Return the mean values of each seed.

        Doors of a seed share the demonstrations that were learned from, so that they
        are no independent trials; seeds are.
        """
        places: dict[int, list[int]] = {}
        for place, seed in enumerate(self.seeds):
            places.setdefault(seed, []).append(place)
        first, second = (
            [
                float(np.mean([values[place] for place in own]))
                for own in places.values()
            ]
            for values in (self.first, self.second)
        )
        return first, second


def paired(first: Mapping[Key, float], second: Mapping[Key, float]) -> Pairs:
    """Return the values of two policies at the tasks that both have."""
    shared = sorted(first.keys() & second.keys())
    return Pairs(
        seeds=tuple(seed for seed, _ in shared),
        first=tuple(first[key] for key in shared),
        second=tuple(second[key] for key in shared),
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class Rate:
    """A success rate with its 95 % interval."""

    successes: int
    """How often."""
    trials: int
    """Of how many."""
    low: float
    """Lower end of the interval; NaN where nothing was tried."""
    high: float
    """Upper end."""

    @property
    def estimate(self) -> float:
        """Successes over trials; NaN where nothing was tried."""
        return self.successes / self.trials if self.trials else math.nan

    @property
    def interval(self) -> str:
        """The interval in words; a dash where nothing was tried."""
        return f"{self.low:.2f}–{self.high:.2f}" if self.trials else "–"


def success_rate(outcomes: Iterable[tuple[int, bool]]) -> Rate:
    """Return how often something succeeded, with an interval that knows of clusters.

    Wilson's score interval for the effective number of trials n / (1 + (m - 1) ρ), with
    m trials per seed (weighted by themselves) and their intraclass correlation ρ, the
    estimate of an analysis of variance. Where all trials have the same outcome nothing
    says that those of a seed are alike, and ρ is 0.

    Args:
        outcomes: Seed and outcome of every trial.
    """
    clusters: dict[int, list[bool]] = {}
    for seed, outcome in outcomes:
        clusters.setdefault(seed, []).append(outcome)
    trials = sum(map(len, clusters.values()))
    successes = sum(map(sum, clusters.values()))
    if not trials:
        return Rate(successes=0, trials=0, low=math.nan, high=math.nan)
    rate, effective = successes / trials, trials / _design_effect(clusters.values())
    z = -float(norm.ppf(0.5 * (1.0 - _LEVEL)))
    centre = rate + z * z / (2.0 * effective)
    spread = z * math.sqrt(rate * (1.0 - rate) / effective + (0.5 * z / effective) ** 2)
    scale = 1.0 + z * z / effective
    return Rate(
        successes=successes,
        trials=trials,
        low=max((centre - spread) / scale, 0.0),
        high=min((centre + spread) / scale, 1.0),
    )


def _design_effect(clusters: Collection[Sequence[bool]]) -> float:
    """Return how many trials of a cluster say as much as one alone, at least 1."""
    sizes = np.array([len(own) for own in clusters], dtype=float)
    rates = np.array([np.mean(own) for own in clusters])
    n, k = sizes.sum(), sizes.size
    total = float(sizes @ rates / n)
    if k < 2 or n == k or total in (0.0, 1.0):
        return 1.0
    between = float(sizes @ (rates - total) ** 2) / (k - 1)
    within = float(sizes @ (rates * (1.0 - rates))) / (n - k)
    typical = (n - float(sizes @ sizes) / n) / (k - 1)
    correlation = (between - within) / (between + (typical - 1.0) * within)
    return float(1.0 + (sizes @ sizes / n - 1.0) * max(correlation, 0.0))


def signed_rank(first: Sequence[float], second: Sequence[float]) -> float:
    """Compare two policies' values of the same seeds.

    Returns:
        Probability of a difference at least as large if there were none, two-sided.
    """
    differences = np.subtract(first, second)
    different = differences[differences != 0.0]
    # Pairs without difference are left out, as Wilcoxon did.
    return float(wilcoxon(different).pvalue) if different.size else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct for testing several times; in the order given.

    A corrected value below 0.05 keeps the chance of any false finding among all tests
    below 5 %.
    """
    order = np.argsort(p_values)
    corrected = np.empty(order.size)
    multiplied = np.arange(order.size, 0, -1) * np.take(p_values, order)
    corrected[order] = np.maximum.accumulate(np.minimum(multiplied, 1.0))
    return [float(p) for p in corrected]


def shift(first: Sequence[float], second: Sequence[float]) -> Shift:
    """Estimate how much larger the first of a pair is; at least one pair."""
    differences: FloatArray = np.subtract(first, second)
    n = differences.size
    rows, columns = np.triu_indices(n)
    means = np.sort(0.5 * (differences[rows] + differences[columns]))
    low, high = -math.inf, math.inf
    if n >= FEWEST_PAIRS:
        cut = _signed_rank_quantile(n)
        low, high = float(means[cut - 1]), float(means[means.size - cut])
    return Shift(estimate=float(np.median(means)), low=low, high=high, n=n)


def mean_shift(first: Sequence[float], second: Sequence[float]) -> Shift:
    """Estimate how much larger the first of a pair is on average, as of rates.

    Most seeds' rates are equal, so that the median of differences says nothing. Mean
    difference and Student's interval.
    """
    differences: FloatArray = np.subtract(first, second)
    n, mean = differences.size, float(np.mean(differences))
    reach = math.inf
    if n >= FEWEST_PAIRS:
        quantile = float(t.ppf(0.5 + 0.5 * _LEVEL, n - 1))
        reach = quantile * float(np.std(differences, ddof=1)) / math.sqrt(n)
    return Shift(estimate=mean, low=mean - reach, high=mean + reach, n=n)


def _signed_rank_quantile(n: int) -> int:
    """Smallest rank sum that is not in the lower 2.5 % of n pairs; 1 or more."""
    tail = 0.5 * (1.0 - _LEVEL)
    if n > _EXACT_UP_TO:
        spread = math.sqrt(n * (n + 1) * (2 * n + 1) / 24.0)
        return max(1, math.floor(n * (n + 1) / 4.0 + norm.ppf(tail) * spread))
    # ways[s]: how many of the 2ⁿ signs give the rank sum s.
    ways = np.zeros(n * (n + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        ways[rank:] = ways[rank:] + ways[:-rank]
    below = np.cumsum(ways) / 2.0**n
    return max(1, int(np.argmax(below >= tail)))
