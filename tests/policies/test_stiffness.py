"""The stiffness profile, Eqs. (24) to (26), and its presets."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import AlignedDemonstrations
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    HELD_HAND,
    PAPER_PROFILE,
    VirtualDynamics,
)
from gplfd_policies.registry.method import profile_of_spread

PROFILES = [PAPER_PROFILE, DEFAULT_PROFILE]


@pytest.mark.parametrize("law", PROFILES)
def test_eq24_matches_the_printed_sigmoid(law):
    std = law.beta * np.linspace(0.0, 3.0, 31)[:, None]
    softening = 1.0 / (1.0 + np.exp(-law.alpha * (std - law.beta)))
    expected = law.k_max - (law.k_max - law.k_min) * softening
    assert_allclose(law.stiffness(std), expected, rtol=1e-14)
    assert_allclose(law.stiffness(law.beta), (law.k_max + law.k_min) / 2)


@pytest.mark.parametrize("std", [-np.inf, -1e308, 0.0, 1e3, 1e307, 1e308, np.inf])
def test_eq24_saturates_without_overflow(std):
    stiffness = PAPER_PROFILE.stiffness(np.full(6, std))
    rate = PAPER_PROFILE.rate(np.full(6, std), np.ones(6))
    expected = 100.0 if std > 1 else 500.0
    assert_allclose(stiffness, expected, rtol=0.003)
    assert np.isfinite(rate).all()


@pytest.mark.parametrize("law", PROFILES)
@pytest.mark.parametrize("sigma_rate", [-0.3, 0.7])
def test_eq25_rate_is_the_derivative_of_eq24(law, sigma_rate):
    std = law.beta * np.linspace(0.0, 3.0, 61)[:, None]
    std_rate = sigma_rate * law.beta * np.ones_like(std)
    step = 1e-6
    ahead = law.stiffness(std + step * std_rate)
    behind = law.stiffness(std - step * std_rate)
    numeric = (ahead - behind) / (2 * step)
    assert_allclose(law.rate(std, std_rate), numeric, atol=1e-6 * np.abs(numeric).max())
    # Rising uncertainty softens, falling uncertainty stiffens.
    assert np.all(law.rate(std, std_rate) * sigma_rate < 0.0)


def test_printed_eq25_has_the_wrong_sign():
    std, unit = np.full(6, 0.011), np.ones(6)
    assert_allclose(PAPER_PROFILE.printed_rate(std, unit), 57_387, atol=0.5)
    assert_allclose(PAPER_PROFILE.rate(std, unit), -54_908, atol=0.5)


def test_eq26_the_rate_is_largest_half_way_between_the_stiffnesses():
    std = np.linspace(0.0, 0.03, 30_001)[:, None] * np.ones(6)
    size = np.abs(PAPER_PROFILE.rate(std, np.ones_like(std)))[:, 0]
    at_largest = PAPER_PROFILE.stiffness(std)[np.argmax(size), 0]
    assert size.max() == pytest.approx(600.0 / 4 * 400.0, rel=1e-9)
    assert at_largest == pytest.approx(300.0, abs=0.1)  # not (500 - 100)/2 = 200


@pytest.mark.parametrize("stiffness", [1.0, 100.0, 500.0, 5000.0])
def test_damping_keeps_its_ratio_and_is_never_less_than_the_least(stiffness):
    least = np.array([0.0, 60.0, 60.0, 0.0, 3.0, 3.0])
    dynamics = VirtualDynamics(mass=np.ones(6), damping_ratio=0.7, least_damping=least)
    critical = 2.0 * 0.7 * np.sqrt(stiffness)
    damping = dynamics.damping(np.full(6, stiffness))
    assert_allclose(damping, np.maximum(critical, least))


def test_default_dynamics_are_damped_for_a_held_hand():
    """k_s τ, whatever the stiffness: the condition of docs/method.md for contact."""
    held = HELD_HAND.stiffness * HELD_HAND.delay
    for stiffness in (DEFAULT_PROFILE.k_min, DEFAULT_PROFILE.k_max):
        damping = DEFAULT_DYNAMICS.damping(stiffness)
        assert np.all(damping >= held * (1.0 - 1e-12))
        delay = HELD_HAND.tolerated_delay(stiffness, damping, DEFAULT_DYNAMICS.mass)
        assert np.all(delay > HELD_HAND.delay)


def test_the_middle_is_between_an_observation_and_the_spread():
    """And a task that spreads by less than can be observed is as sure as can be."""
    spread = np.array([0.09, 0.004, 0.0, 0.12, 0.03, 0.001])
    poses = np.array([[-spread, -spread], [spread, spread]]) / np.sqrt(2.0)
    aligned = AlignedDemonstrations(times=np.array([0.0, 1.0]), poses=poses)
    law = profile_of_spread(aligned, (1e-3, 0.03))
    expected = [9.4868e-3, 2e-3, 1e-3, 0.06, 0.03, 0.03]
    assert_allclose(law.beta, expected, rtol=1e-4)
    assert_allclose(law.alpha * law.beta, 6.0)
    middle = 0.5 * (law.k_min + law.k_max)
    assert_allclose(law.stiffness(law.beta), middle)
    assert_array_equal(law.k_max, DEFAULT_PROFILE.k_max)
