"""Paired tests and intervals, exact where the number of pairs allows it.

Success is compared by McNemar's exact test, numbers by Wilcoxon's signed-rank test;
several tests at once are corrected after Holm, *A simple sequentially rejective
multiple test procedure*, Scandinavian Journal of Statistics 6:65-70, 1979. The typical
difference of pairs is estimated after Hodges and Lehmann, *Estimates of location based
on rank tests*, Annals of Mathematical Statistics 34:598-611, 1963.
"""

import functools
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final, TypeVar

import numpy as np
from numpy.typing import NDArray
from scipy.stats import binomtest, norm, wilcoxon

FloatArray = NDArray[np.float64]

ValueT = TypeVar("ValueT")

FEWEST_PAIRS: Final = 6
"""With fewer pairs no two-sided signed-rank test can reach 5 %."""

_EXACT_UP_TO: Final = 60
_LEVEL: Final = 0.95


@dataclass(frozen=True, kw_only=True, slots=True)
class Shift:
    """Typical difference of pairs, first minus second."""

    estimate: float
    """Median of the means of any two differences (Hodges and Lehmann)."""
    low: float
    """Lower end of its 95 % interval; minus infinity with too few pairs."""
    high: float
    """Upper end of its 95 % interval; infinity with too few pairs."""
    n: int
    """Number of tasks that both policies have."""


def paired(
    first: Mapping[str, ValueT], second: Mapping[str, ValueT]
) -> tuple[list[ValueT], list[ValueT]]:
    """Return the values of two policies at the tasks that both have, in one order."""
    shared = sorted(first.keys() & second.keys())
    return [first[key] for key in shared], [second[key] for key in shared]


@functools.cache
def wilson_interval(successes: int, trials: int) -> tuple[float, float]:
    """Return the Wilson score interval of a success rate at 95 %.

    Args:
        successes: Number of successes, 0 to ``trials``.
        trials: Number of trials, at least 1.
    """
    found = binomtest(successes, trials).proportion_ci(_LEVEL, method="wilson")
    return float(found.low), float(found.high)


def interval_text(successes: int, trials: int) -> str:
    """Write the interval of a success rate; a dash where nothing was tried."""
    if not trials:
        return "–"
    low, high = wilson_interval(successes, trials)
    return f"{low:.2f}–{high:.2f}"


def mcnemar(wins: int, losses: int) -> float:
    """Compare two policies' successes on the same tasks, exactly.

    Args:
        wins: Tasks at which the first alone succeeds.
        losses: Tasks at which the second alone does.

    Returns:
        Probability of a difference at least as large if there were none, two-sided.
    """
    different = wins + losses
    return float(binomtest(wins, different, 0.5).pvalue) if different else 1.0


def signed_rank(first: Sequence[float], second: Sequence[float]) -> float:
    """Compare two policies' numbers on the same tasks; returns as `mcnemar`."""
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
