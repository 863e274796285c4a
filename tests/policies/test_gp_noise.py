"""Estimates of the spread r(t) and their biases: Eqs. (10)-(11), (15)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.special import digamma, polygamma

from gplfd_policies.gp.heteroscedastic import KerstingNoise, MapNoise

pytestmark = pytest.mark.slow

TIMES = np.linspace(0.0, 1.0, 120)
TRUE = 0.05**2 * np.exp(2.0 * np.sin(5.0 * TIMES))


def samples(count, seed):
    rng = np.random.default_rng(seed)
    return np.sin(3.0 * TIMES) + np.sqrt(TRUE) * rng.normal(size=(count, len(TIMES)))


def log_bias(model, count, seeds=8):
    errors = [
        np.mean(model.fit(TIMES, samples(count, seed)).log_variance(TIMES))
        for seed in range(seeds)
    ]
    return float(np.mean(errors) - np.mean(np.log(TRUE)))


@pytest.mark.parametrize("free", [1, 5])
def test_log_of_an_empirical_variance_is_biased(free):
    rng = np.random.default_rng(0)
    draws = np.log(rng.chisquare(free, 200_000) / free)
    assert np.mean(draws) == pytest.approx(
        digamma(free / 2) - np.log(free / 2), abs=0.01
    )
    assert np.var(draws) == pytest.approx(polygamma(1, free / 2), rel=0.02)
    assert np.mean(draws) == pytest.approx({1: -1.27, 5: -0.21}[free], abs=0.02)


@pytest.mark.parametrize("count", [2, 3, 6])
def test_default_estimate_is_unbiased(count):
    assert abs(log_bias(MapNoise(), count)) < 0.12


def test_default_estimate_starts_from_an_unbiased_level():
    levels = [MapNoise().fit(TIMES, samples(2, seed)).level for seed in range(8)]
    assert np.mean(levels) == pytest.approx(np.mean(np.log(TRUE)), abs=0.15)


def test_kersting_converges_to_too_small_a_spread():
    """Its standard deviation is about 0.81 of the truth for every D."""
    for count in (6, 20):
        ratio = np.exp(0.5 * log_bias(KerstingNoise(n_iterations=20), count, seeds=1))
        assert ratio == pytest.approx(0.81, abs=0.04)


def test_kersting_depends_on_when_it_is_stopped():
    early = log_bias(KerstingNoise(n_iterations=1), 6, seeds=2)
    late = log_bias(KerstingNoise(n_iterations=10), 6, seeds=2)
    assert early > 0.3
    assert late < 0.0


def test_default_estimate_is_the_mode_of_the_gamma_likelihood():
    """No small change of z(t) that its own prior allows raises the posterior."""
    data = samples(6, 2)
    profile = MapNoise(least_spread=0.0).fit(TIMES, data)
    squares = np.sum((data - data.mean(axis=0)) ** 2, axis=0)

    def log_likelihood(z):
        return float(np.sum(-2.5 * z - 0.5 * squares * np.exp(-z)))

    z = profile.log_variance(TIMES)
    # The prior barely holds a constant, so along it the likelihood itself is at rest.
    slope = (log_likelihood(z + 1e-5) - log_likelihood(z - 1e-5)) / 2e-5
    assert abs(slope) < 0.5
    assert abs(log_likelihood(z + 0.1) - log_likelihood(z)) > 1.0


def test_agreement_by_chance_does_not_ruin_the_likelihood():
    """Six end at exactly one place, the seventh a thousandth of the task beside it."""
    rng = np.random.default_rng(0)
    apart = 0.05 * np.minimum(np.maximum(0.9 - TIMES, 0.0) / 0.3, 1.0)
    data = np.sin(3.0 * TIMES) + apart * rng.normal(size=(6, 1))

    def density(model):
        variance = model.fit(TIMES, data).variance(TIMES)[TIMES > 0.9]
        return np.mean(-0.5 * np.log(2.0 * np.pi * variance) - 0.5e-6 / variance)

    assert density(MapNoise(least_spread=0.0)) < -1000.0
    assert density(MapNoise()) > 3.0


@pytest.mark.parametrize("least", [0.0, 0.02])
def test_the_least_spread_is_added_to_what_was_learned(least):
    learned = MapNoise(least_spread=0.0).fit(TIMES, samples(6, 0)).variance(TIMES)
    floored = MapNoise(least_spread=least).fit(TIMES, samples(6, 0)).variance(TIMES)
    assert_allclose(floored, learned + least**2, rtol=1e-12)


def test_profile_rate_equals_finite_differences():
    profile = MapNoise(least_spread=0.05).fit(TIMES, samples(6, 3))
    grid, step = np.linspace(0.01, 0.99, 40), 1e-6
    numeric = profile.log_variance(grid + step) - profile.log_variance(grid - step)
    assert_allclose(profile.log_variance_rate(grid), numeric / (2.0 * step), atol=1e-6)


def test_profile_keeps_its_ends_outside():
    profile = MapNoise().fit(TIMES, samples(6, 3))
    outside = profile.variance(np.array([-0.5, 0.0, 1.0, 2.0]))
    assert outside[0] == outside[1]
    assert outside[2] == outside[3]
    assert_array_equal(profile.log_variance_rate(np.array([-0.5, 2.0])), 0.0)


@pytest.mark.parametrize("model", [MapNoise, KerstingNoise])
def test_no_spread_changes_faster_than_the_shortest_scale(model):
    spread = np.exp(1.5 * np.sin(12.0 * TIMES))
    data = spread * np.random.default_rng(5).normal(size=(12, len(TIMES)))
    followed = [
        np.corrcoef(
            model(shortest_scale=scale).fit(TIMES, data).log_variance(TIMES),
            np.log(spread),
        )[0, 1]
        for scale in (0.1, 1.0)
    ]
    assert followed[0] > 0.9 > 0.8 > followed[1]
