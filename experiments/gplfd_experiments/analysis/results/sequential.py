"""Sequential comparison of two policies that is valid at every look.

A payoff x ∈ [−1, 1] of a seed has mean zero, given all earlier seeds, if the policies
are equal. Π (1 + λ xᵢ), the capital after bets of the share λ, is then a martingale,
and so is its mean over λ ∈ (−1, 1), the e-value. By Ville's inequality it ever reaches
1/α with probability at most α, for any stopping rule. If it does, the policies are
*separated*.

Robbins, Annals of Mathematical Statistics 41:1397-1409, 1970; Waudby-Smith and Ramdas,
*Estimating means of bounded random variables by betting*, JRSS B 86:1-27, 2024. For
studies with robots: Kress-Gazit et al., arXiv:2409.09491.
"""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from scipy.special import betaln
from scipy.stats import binom

from gplfd_experiments.files.arrays import FloatArray

LEVEL: Final = 0.05
"""Largest probability of separating equal policies, over all looks together."""
_POWER: Final = 0.8
_BETS, _WEIGHTS = np.polynomial.legendre.leggauss(100)
"""λ and twice its weight: a mixture for any number of seeds, exact up to 199 seeds."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Comparison:
    """State of a comparison: seeds, mean outcomes, and the largest e-value so far.

    `separated_at` is the number of seeds at which the policies were separated, or None;
    `ahead` is then 1 if the first has the larger outcomes, −1 if the second, else 0.
    """

    seeds: int
    first: float
    second: float
    e_value: float
    separated_at: int | None
    ahead: int


def rank_payoffs(differences: FloatArray) -> FloatArray:
    """Return signs times sequential ranks of paired differences; shape (..., n).

    The rank of |dᵢ| among |d₁| ... |dᵢ|, divided by i, does not depend on the sign. The
    mean is zero if a difference of any size has either sign with equal probability.
    After Reynolds, *A sequential signed-rank test for symmetry*, Annals of Statistics
    3:382-400, 1975.
    """
    sizes, n = np.abs(differences), differences.shape[-1]
    smaller = (sizes[..., None, :] <= sizes[..., :, None]) & np.tri(n, dtype=bool)
    ranks: FloatArray = np.sum(smaller, axis=-1) / np.arange(1, n + 1)
    return np.sign(differences) * ranks


def e_values(payoffs: FloatArray) -> FloatArray:
    """Return the e-value after each payoff, of shape (..., n) like the payoffs."""
    capital = np.cumsum(np.log1p(_BETS * payoffs[..., None]), axis=-2)
    values: FloatArray = np.exp(capital) @ (0.5 * _WEIGHTS)
    return values


def compare(
    first: Sequence[float], second: Sequence[float], *, shares: bool
) -> Comparison:
    """Compare two policies by their outcomes at the same seeds, one or more, in order.

    Under the null hypothesis, shares in [0, 1] have equal means, and differences of
    other outcomes are symmetric about zero.
    """
    differences = np.subtract(first, second)
    payoffs = differences if shares else rank_payoffs(differences)
    values = e_values(payoffs)
    reached = np.flatnonzero(values >= 1.0 / LEVEL)
    at = int(reached[0]) + 1 if reached.size else None
    return Comparison(
        seeds=len(first),
        first=float(np.mean(first)),
        second=float(np.mean(second)),
        e_value=float(np.max(values)),
        separated_at=at,
        ahead=0 if at is None else int(np.sign(np.sum(payoffs[:at]))),
    )


def seeds_needed(first: float, second: float, *, limit: int = 1000) -> int | None:
    """Return how many seeds separate two success rates with a probability of 0.8.

    Exact for one door per seed and independent outcomes of the policies. Fewer seeds
    suffice if difficulty is shared or a seed has several doors. None: over the limit.
    """
    if not (0.0 <= first <= 1.0 and 0.0 <= second <= 1.0):
        raise ValueError(f"success rates must be from 0 to 1, got {first}, {second}")
    behind, ahead = sorted((first * (1.0 - second), second * (1.0 - first)))
    share = ahead / (ahead + behind) if ahead else 0.5
    # Over the pairs with different outcomes so far; k of them for the better policy.
    alive, separated = np.ones(1), np.zeros(limit + 1)
    for pairs in range(1, limit + 1):
        alive = np.append(0.0, alive * share) + np.append(alive * (1.0 - share), 0.0)
        k = np.arange(pairs + 1)
        # The mean over λ is a beta function.
        e_value = pairs * math.log(2.0) + betaln(k + 1, pairs - k + 1)
        stopped = e_value >= -math.log(LEVEL)
        right = np.sum(alive[stopped & (2 * k > pairs)])
        separated[pairs] = separated[pairs - 1] + right
        alive[stopped] = 0.0
    counts = np.arange(limit + 1)
    reached = binom.pmf(counts, counts[:, None], ahead + behind) @ separated >= _POWER
    return int(np.argmax(reached)) if np.any(reached) else None
