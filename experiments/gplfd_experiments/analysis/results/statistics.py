"""Paired tests and intervals, exact where the number of pairs allows it."""

import itertools
import math
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from operator import itemgetter
from typing import Final

import numpy as np
import scipy  # which imports `special`, 0.2 s, where it is used

FEWEST_PAIRS: Final = 6
"""With fewer pairs no two-sided signed-rank test can reach 5 %."""

_EXACT_UP_TO, _LEVEL = 60, 0.95

Key = tuple[int, str]
"""Seed of a task, and its key among the tasks of all policies."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Shift:
    """Typical difference of pairs, and its 95 % interval, infinite for few pairs."""

    estimate: float
    low: float
    high: float

    def interval(self, digits: int) -> str:
        """The ends as text; "" for too few pairs or too many failures."""
        if math.isinf(self.low) or math.isinf(self.high):
            return ""
        return f"{number_text(self.low, digits)} to {number_text(self.high, digits)}"

    def cell(self, digits: int) -> str:
        """The estimate above its interval, if it has one; a dash without a number."""
        if not math.isfinite(self.estimate):
            return "–"
        return f"{number_text(self.estimate, digits)}\n{self.interval(digits)}".strip()


def number_text(value: float, digits: int, *, signed: bool = False) -> str:
    """Format a number with a typographic minus, and zero without a sign."""
    # Adding zero turns minus zero into zero.
    rounded = round(value, digits) + 0.0
    plus = "+" if signed and rounded != 0.0 else ""
    return f"{rounded:{plus}.{digits}f}".replace("-", "−")


def paired(
    first: Mapping[Key, float], second: Mapping[Key, float]
) -> tuple[list[float], list[float]]:
    """Return means over the common tasks of each seed, which is a pair of a test."""
    common = sorted(first.keys() & second.keys())
    seeds = [[*keys] for _, keys in itertools.groupby(common, itemgetter(0))]
    first_means, second_means = (
        [float(np.mean([values[key] for key in keys])) for keys in seeds]
        for values in (first, second)
    )
    return first_means, second_means


@dataclass(frozen=True, kw_only=True, slots=True)
class Rate:
    """A success rate with its 95 % interval; NaN without trials."""

    successes: int
    trials: int
    estimate: float
    """Successes over trials."""
    low: float
    high: float

    @property
    def interval(self) -> str:
        """The interval as text; a dash without trials."""
        return f"{self.low:.2f}–{self.high:.2f}" if self.trials else "–"

    def cell(self, _: int = 0) -> str:
        """Successes and trials, above the interval; a share needs no digits."""
        return f"{self.successes}/{self.trials}\n{self.interval}"


Estimate = Rate | Shift


def success_rate(outcomes: Iterable[tuple[int, bool]]) -> Rate:
    """Return the success rate, from the seed and outcome of every trial.

    Wilson's score interval for the effective number of trials n / (1 + (m - 1) ρ), with
    m trials per seed (weighted by themselves) and their intraclass correlation ρ, the
    estimate of an analysis of variance, or 0 if all trials have the same outcome.
    """
    clusters: dict[int, list[bool]] = {}
    for seed, outcome in outcomes:
        clusters.setdefault(seed, []).append(outcome)
    trials = sum(map(len, clusters.values()))
    successes = sum(map(sum, clusters.values()))
    if not trials:
        unknown = dict.fromkeys(("estimate", "low", "high"), math.nan)
        return Rate(successes=0, trials=0, **unknown)

    # Number of trials of a seed that are equivalent to one independent trial.
    sizes = np.array([len(group) for group in clusters.values()], dtype=float)
    rates = np.array([np.mean(group) for group in clusters.values()])
    n, k = sizes.sum(), sizes.size
    total = float(sizes @ rates / n)
    design_effect = 1.0
    if k >= 2 and n != k and total not in (0.0, 1.0):
        between = float(sizes @ (rates - total) ** 2) / (k - 1)
        within = float(sizes @ (rates * (1.0 - rates))) / (n - k)
        typical = (n - float(sizes @ sizes) / n) / (k - 1)
        correlation = (between - within) / (between + (typical - 1.0) * within)
        design_effect = float(1.0 + (sizes @ sizes / n - 1.0) * max(correlation, 0.0))

    rate, effective = successes / trials, trials / design_effect
    z = -float(scipy.special.ndtri(0.5 * (1.0 - _LEVEL)))
    centre = rate + z * z / (2.0 * effective)
    spread = z * math.sqrt(rate * (1.0 - rate) / effective + (0.5 * z / effective) ** 2)
    scale = 1.0 + z * z / effective
    return Rate(
        successes=successes,
        trials=trials,
        estimate=rate,
        low=max((centre - spread) / scale, 0.0),
        high=min((centre + spread) / scale, 1.0),
    )


def signed_rank(first: Sequence[float], second: Sequence[float]) -> float:
    """Return Wilcoxon's two-sided p-value; pairs without difference are excluded."""
    from scipy.stats import wilcoxon  # which takes a second to import

    differences = np.round(np.subtract(first, second), 7)  # Means have rounding errors.
    different = differences[differences != 0.0]
    return float(wilcoxon(different).pvalue) if different.size else 1.0


def holm(p_values: Sequence[float]) -> list[float]:
    """Correct p-values for multiple testing, in the given order.

    After Holm, *A simple sequentially rejective multiple test procedure*, Scandinavian
    Journal of Statistics 6:65-70, 1979: the chance of any false finding among all tests
    stays below the level to which a corrected value is compared.
    """
    order = np.argsort(p_values)
    corrected = np.empty(order.size)
    multiplied = np.arange(order.size, 0, -1) * np.take(p_values, order)
    corrected[order] = np.maximum.accumulate(np.minimum(multiplied, 1.0))
    return [float(p) for p in corrected]


def shift(first: Sequence[float], second: Sequence[float]) -> Shift:
    """Estimate the typical difference of pairs, first minus second; at least one pair.

    Median of the means of any two differences, after Hodges and Lehmann, *Estimates of
    location based on rank tests*, Annals of Mathematical Statistics 34:598-611, 1963.
    """
    differences = np.asarray(np.subtract(first, second), dtype=float)
    n = differences.size
    rows, columns = np.triu_indices(n)
    means = np.sort(0.5 * (differences[rows] + differences[columns]))
    low, high = -math.inf, math.inf
    if n >= FEWEST_PAIRS:
        cut = _signed_rank_quantile(n)
        low, high = float(means[cut - 1]), float(means[means.size - cut])
    return Shift(estimate=float(np.median(means)), low=low, high=high)


def mean_shift(first: Sequence[float], second: Sequence[float]) -> Shift:
    """Return the mean difference of pairs, such as of rates; Student's interval."""
    differences = np.asarray(np.subtract(first, second), dtype=float)
    n, mean = differences.size, float(np.mean(differences))
    reach = math.inf
    if n >= FEWEST_PAIRS:
        quantile = float(scipy.special.stdtrit(n - 1, 0.5 + 0.5 * _LEVEL))
        reach = quantile * float(np.std(differences, ddof=1)) / math.sqrt(n)
    return Shift(estimate=mean, low=mean - reach, high=mean + reach)


def _signed_rank_quantile(n: int) -> int:
    """Smallest rank sum that is not in the lower 2.5 % of n pairs; 1 or more."""
    tail = 0.5 * (1.0 - _LEVEL)
    if n > _EXACT_UP_TO:
        spread = math.sqrt(n * (n + 1) * (2 * n + 1) / 24.0)
        return max(1, math.floor(n * (n + 1) / 4 + scipy.special.ndtri(tail) * spread))
    # ways[s]: number of the 2ⁿ sign combinations with the rank sum s.
    ways = np.zeros(n * (n + 1) // 2 + 1)
    ways[0] = 1.0
    for rank in range(1, n + 1):
        ways[rank:] = ways[rank:] + ways[:-rank]
    below = np.cumsum(ways) / 2.0**n
    return max(1, int(np.argmax(below >= tail)))
