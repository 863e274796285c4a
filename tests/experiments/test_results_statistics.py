"""Paired tests and intervals against scipy, published tables and brute force."""

import itertools
import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy import stats

from experiments.results.statistics import (
    FEWEST_PAIRS,
    _signed_rank_quantile,
    holm,
    mcnemar,
    shift,
    signed_rank,
    wilson_interval,
)


@pytest.mark.parametrize(
    ("successes", "trials", "low", "high"),
    # Newcombe 1998, table I, and 20 of 20.
    [(81, 263, 0.2553, 0.3662), (15, 148, 0.0624, 0.1605), (20, 20, 0.8389, 1.0)],
)
def test_wilson_interval_has_the_published_values(successes, trials, low, high):
    assert wilson_interval(successes, trials) == pytest.approx((low, high), abs=5e-5)


def test_mcnemar_is_the_binomial_test_of_the_pairs_that_differ():
    found = mcnemar(12, 3)
    assert found == pytest.approx(stats.binomtest(12, 15).pvalue)
    # Written out: twice the chance of 3 or fewer heads of 15.
    heads = sum(math.comb(15, k) for k in range(4))
    assert found == pytest.approx(2.0 * heads / 2**15)


def test_policies_that_never_differ_cannot_be_told_apart():
    assert mcnemar(0, 0) == 1.0
    assert signed_rank([1.0, 2.0], [1.0, 2.0]) == 1.0


def test_signed_rank_is_scipys_without_the_pairs_that_are_equal():
    rng = np.random.default_rng(0)
    first, second = rng.normal(0.3, 1.0, 17), rng.normal(0.0, 1.0, 17)
    second[:3] = first[:3]
    found = signed_rank(first, second)
    assert found == pytest.approx(stats.wilcoxon(first[3:], second[3:]).pvalue)


def test_holm_on_a_worked_example():
    assert holm([0.01, 0.04, 0.03, 0.005]) == pytest.approx([0.03, 0.06, 0.06, 0.02])
    assert holm([0.6, 0.7]) == [1.0, 1.0]
    assert holm([]) == []


@given(st.lists(st.floats(0.0, 1.0), min_size=1, max_size=8))
def test_holm_lies_between_no_correction_and_bonferroni(p_values):
    for p, corrected in zip(p_values, holm(p_values), strict=True):
        assert p <= corrected <= min(1.0, len(p_values) * p) + 1e-12


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


def test_the_interval_leaves_zero_out_where_the_test_rejects():
    rng = np.random.default_rng(1)
    for _ in range(40):
        x = rng.normal(0.5, 1.0, 15)
        found, p = shift(x, np.zeros(15)), stats.wilcoxon(x).pvalue
        assert (found.low > 0.0 or found.high < 0.0) == (p <= 0.05)


def test_too_few_pairs_have_no_interval():
    few = shift([1.0] * (FEWEST_PAIRS - 1), [0.0] * (FEWEST_PAIRS - 1))
    assert (few.estimate, few.low, few.high) == (1.0, -math.inf, math.inf)
    enough = shift([1.0] * FEWEST_PAIRS, [0.0] * FEWEST_PAIRS)
    assert (enough.low, enough.high) == (1.0, 1.0)
