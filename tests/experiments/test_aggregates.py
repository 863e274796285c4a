"""Interquartile means and improvement against rliable and by hand."""

import math

import numpy as np
import pytest
from scipy.stats import mannwhitneyu, trim_mean

from gplfd_experiments.analysis.results.aggregates import (
    interquartile_mean,
    probability_of_improvement,
)
from gplfd_experiments.analysis.results.statistics import FEWEST_PAIRS

RNG = np.random.default_rng(3)
X = np.round(RNG.normal(1.0, 1.0, (12, 4)) + np.arange(4), 2)
Y = np.round(RNG.normal(0.5, 1.5, (12, 4)) + np.arange(4), 2)
# rliable 1.2.0 (with pandas 2.3.3, arch 7.2.0) on the same arrays, np.random.seed(0):
#   metrics.aggregate_iqm(X), metrics.probability_of_improvement(X, Y)
#   library.get_interval_estimates({"x": X}, aggregate_iqm, reps=50000)
#   library.get_interval_estimates({"p": (X, Y)}, probability_of_improvement, reps=5000)
IQM = 2.64125, 2.28875, 2.96875
IMPROVEMENT = 0.6397569444444444, 0.52256944, 0.75


def test_the_numbers_are_those_of_rliable():
    """The ends of the intervals to the error of 2,000 samples."""
    found = interquartile_mean(X, "run")
    assert found == interquartile_mean(X, "run")  # bit for bit
    assert found.estimate == pytest.approx(IQM[0], abs=1e-12)
    assert (found.low, found.high) == pytest.approx(IQM[1:], abs=0.03)
    found = probability_of_improvement(X, Y, "run")
    assert found.estimate == pytest.approx(IMPROVEMENT[0], abs=1e-12)
    assert (found.low, found.high) == pytest.approx(IMPROVEMENT[1:], abs=0.01)


def test_missing_runs_are_left_out():
    holes = X.copy()
    holes[[0, 3, 5], [1, 1, 2]] = math.nan
    there = holes[~np.isnan(holes)]
    assert interquartile_mean(holes).estimate == pytest.approx(trim_mean(there, 0.25))
    by_hand = [
        mannwhitneyu(own, other, nan_policy="omit").statistic
        / (12 * np.sum(own == own))
        for own, other in zip(holes.T, Y.T, strict=True)
    ]
    found = probability_of_improvement(holes, Y)
    assert found.estimate == pytest.approx(np.mean(by_hand), abs=1e-12)
    holes[:, 3] = math.nan
    found = probability_of_improvement(holes, Y)
    assert found.estimate == pytest.approx(np.mean(by_hand[:3]), abs=1e-12)


def test_failures_are_worse_than_every_number():
    failed = X.copy()
    failed[:3] = -math.inf  # a quarter
    kept = trim_mean(np.where(np.isinf(failed), -1e9, failed), 0.25, axis=None)
    found = interquartile_mean(failed)
    assert found.estimate == pytest.approx(kept)
    assert found.low == -math.inf
    failed[3] = -math.inf
    assert interquartile_mean(failed).estimate == -math.inf
    nothing = np.full_like(X, -math.inf)
    assert probability_of_improvement(nothing, nothing).estimate == 0.5
    assert probability_of_improvement(X, nothing).low == 1.0


def test_few_seeds_have_no_interval():
    few = interquartile_mean(X[: FEWEST_PAIRS - 1])
    assert math.isfinite(few.estimate)
    assert (few.low, few.high) == (-math.inf, math.inf)
    assert math.isfinite(interquartile_mean(X[:FEWEST_PAIRS]).low)
    assert math.isnan(interquartile_mean(np.full((8, 2), math.nan)).estimate)


def test_runs_that_share_a_seed_need_seeds_to_be_drawn():
    """Coverage of the mean of the middle half, 0: runs alone are far too sure."""
    rng = np.random.default_rng(0)
    held = {"seed": 0, "run": 0}
    for _ in range(100):
        common = rng.normal(size=(20, 1))
        drawn = common + 0.5 * rng.normal(size=(20, 6))
        for unit in held:
            found = interquartile_mean(drawn, unit)
            held[unit] += found.low <= 0.0 <= found.high
    assert held["seed"] / 100 > 0.88
    assert held["run"] / 100 < 0.7
