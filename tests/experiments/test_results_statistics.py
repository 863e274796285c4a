"""Paired tests and intervals against scipy, published tables and brute force."""

import itertools
import math

import numpy as np
import pytest
from scipy import stats

from gplfd_experiments.analysis.results.statistics import (
    FEWEST_PAIRS,
    _signed_rank_quantile,
    holm,
    paired,
    shift,
    signed_rank,
    success_rate,
)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe 1998, table I; all and none of 20.
    [
        (81, 263, 0.2553, 0.3662),
        (15, 148, 0.0624, 0.1605),
        (20, 20, 0.8389, 1.0),
        (0, 20, 0.0, 0.1611),
    ],
)
def test_independent_trials_have_wilson_s_interval(successes, trials, low, high):
    rate = success_rate((seed, seed < successes) for seed in range(trials))
    assert (rate.successes, rate.trials) == (successes, trials)
    assert (rate.low, rate.high) == pytest.approx((low, high), abs=5e-5)


def rate_of(outcomes):
    """The rate of outcomes by seed."""
    return success_rate(
        (seed, bool(one)) for seed, own in enumerate(outcomes) for one in own
    )


def width(outcomes):
    return rate_of(outcomes).high - rate_of(outcomes).low


def test_trials_count_as_much_as_they_differ():
    """Copies count once, independent trials each; nothing differs, nothing is alike."""
    rng = np.random.default_rng(0)
    once = rng.random((30, 1)) < 0.6
    assert width(once.repeat(7, axis=1)) == pytest.approx(width(once), rel=0.02)
    outcomes = rng.random((200, 7)) < 0.5
    assert width(outcomes) == pytest.approx(width(outcomes.reshape(-1, 1)), rel=0.05)
    assert width(np.ones((20, 7))) == pytest.approx(width(np.ones((140, 1))))
    nothing = success_rate(())
    assert (nothing.trials, nothing.interval) == (0, "–")


def test_the_interval_of_clusters_covers_the_rate():
    """With correlated trials Wilson's own interval holds it far too seldom."""
    rng = np.random.default_rng(1)
    held = plain = 0
    for _ in range(400):
        # Half of the outcomes are successes, their intraclass correlation is 0.4.
        copied = rng.random((20, 7)) < math.sqrt(0.4)
        own, common = rng.random((20, 7)) < 0.5, rng.random((20, 1)) < 0.5
        drawn = np.where(copied, common, own)
        rate = rate_of(drawn)
        held += rate.low <= 0.5 <= rate.high
        naive = stats.binomtest(int(drawn.sum()), drawn.size).proportion_ci(
            method="wilson"
        )
        plain += naive.low <= 0.5 <= naive.high
    assert held / 400 > 0.91
    assert plain / 400 < 0.8


def test_pairs_are_compared_seed_by_seed():
    first = {(0, "a"): 1.0, (0, "b"): 3.0, (1, "a"): 5.0, (2, "a"): 9.0}
    second = {(1, "a"): 1.0, (0, "b"): 1.0, (0, "a"): 0.0, (3, "a"): 7.0}
    assert paired(first, second) == ([2.0, 5.0], [0.5, 1.0])
    assert paired(first, {}) == ([], [])


def test_signed_rank_is_scipys_without_the_pairs_that_are_equal():
    rng = np.random.default_rng(0)
    first, second = rng.normal(0.3, 1.0, 17), rng.normal(0.0, 1.0, 17)
    second[:3] = first[:3]
    found = signed_rank(first, second)
    assert found == pytest.approx(stats.wilcoxon(first[3:], second[3:]).pvalue)
    assert signed_rank([0.1 + 0.2] * 8, [0.3] * 8) == 1.0  # rounding errors


def test_holm_on_a_worked_example():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


@pytest.mark.parametrize("n", [6, 9, 12])
def test_the_interval_holds_95_percent_of_all_signs(n):
    """All 2ⁿ signs by brute force: what the interval leaves out is at most 5 %."""
    ranks = np.arange(1, n + 1)
    signs = np.array(list(itertools.product([0, 1], repeat=n)))
    sums = signs @ ranks
    cut = _signed_rank_quantile(n)
    assert 2.0 * np.mean(sums <= cut - 1) <= 0.05
    assert 2.0 * np.mean(sums <= cut) > 0.05


def test_the_interval_holds_the_shifts_that_wilcoxon_does_not_reject():
    # Darwin's maize, eighths of an inch: heights of crossed less self-fertilised.
    darwin = np.array([49, -67, 8, 16, 6, 23, 28, 41, 14, 29, 56, 24, 75, 60, -48])
    found = shift(darwin.tolist(), [0.0] * darwin.size)

    def p(theta):
        return stats.wilcoxon(darwin - theta, method="exact").pvalue

    # A hair beside each end, where no rank is tied.
    assert p(found.low - 0.1) <= 0.05 < p(found.low + 0.1)
    assert p(found.high + 0.1) <= 0.05 < p(found.high - 0.1)
    pairs = itertools.combinations_with_replacement(darwin.tolist(), 2)
    assert found.estimate == np.median([0.5 * (a + b) for a, b in pairs])


def test_exact_and_approximate_quantiles_meet():
    exact = _signed_rank_quantile(60)
    normal = 60 * 61 / 4 - 1.959964 * math.sqrt(60 * 61 * 121 / 24)
    assert exact == pytest.approx(normal, abs=1.5)
    assert _signed_rank_quantile(61) > exact


def test_too_few_pairs_have_no_interval():
    few = shift([1.0] * (FEWEST_PAIRS - 1), [0.0] * (FEWEST_PAIRS - 1))
    assert (few.estimate, few.low, few.high) == (1.0, -math.inf, math.inf)
    enough = shift([1.0] * FEWEST_PAIRS, [0.0] * FEWEST_PAIRS)
    assert (enough.low, enough.high) == (1.0, 1.0)
