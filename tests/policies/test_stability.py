"""The stability bounds, Eqs. (23), (27), (28), and the governor that keeps them."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies.control.stability import (
    StiffnessGovernor,
    decay_rate,
    rate_bound,
    uncertainty_fall_bound,
)
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
    VirtualDynamics,
)

SETTINGS = [(PAPER_PROFILE, PAPER_DYNAMICS), (DEFAULT_PROFILE, DEFAULT_DYNAMICS)]
DT = 0.01


def condition_2(stiffness, stiffness_rate, gamma, dynamics):
    """K̇ + γḊ - 2γK, with Ḋ from d = 2δ√(m k) by the chain rule."""
    damping_rate = dynamics.damping_ratio * np.sqrt(dynamics.mass / stiffness)
    return stiffness_rate * (1 + gamma * damping_rate) - 2 * gamma * stiffness


def test_eq23_tight_bound_follows_from_condition_2():
    import sympy  # which takes a second

    k, m, delta, gamma = sympy.symbols("k m delta gamma", positive=True)
    k_rate = sympy.Symbol("k_rate", real=True)
    damping_rate = sympy.diff(2 * delta * sympy.sqrt(m * k), k) * k_rate
    [edge] = sympy.solve(k_rate + gamma * damping_rate - 2 * gamma * k, k_rate)
    root = sympy.sqrt(k)
    tight = 2 * gamma * root**3 / (root + delta * gamma * sympy.sqrt(m))
    assert sympy.simplify(edge - tight) == 0
    # The code is this expression; γ is the largest of condition 1, γ m ≤ d(k_min).
    k_min = sympy.Symbol("k_min", positive=True)
    largest = 2 * delta * sympy.sqrt(m * k_min) / m
    values = {k: 230.0, k_min: 110.0, m: 1.3, delta: 0.8}
    dynamics = VirtualDynamics(mass=np.full(6, 1.3), damping_ratio=0.8)
    expected = float(tight.subs(gamma, largest).subs(values))
    assert_allclose(
        rate_bound(np.full(6, 230.0), np.full(6, 110.0), dynamics), expected, rtol=1e-13
    )
    printed = 2 * gamma * root**3 / (root + 2 * delta * gamma * sympy.sqrt(m))
    assert_allclose(
        rate_bound(np.full(6, 230.0), np.full(6, 110.0), dynamics, printed=True),
        float(printed.subs(gamma, largest).subs(values)),
        rtol=1e-13,
    )


@pytest.mark.parametrize(("profile", "dynamics"), SETTINGS)
def test_condition_1_holds_on_the_whole_range_and_is_tight(profile, dynamics):
    gamma = decay_rate(profile.k_min, dynamics)
    stiffness = np.linspace(profile.k_min, profile.k_max, 50)
    excess = gamma * dynamics.mass - dynamics.damping(stiffness)
    assert np.all(excess <= 1e-12)
    assert_allclose(excess[0], 0.0, atol=1e-12)


@pytest.mark.parametrize(("profile", "dynamics"), SETTINGS)
def test_eq23_is_the_edge_of_condition_2_and_the_printed_one_lies_inside(
    profile, dynamics
):
    gamma = decay_rate(profile.k_min, dynamics)
    stiffness = np.linspace(profile.k_min, profile.k_max, 50)
    tight = rate_bound(stiffness, profile.k_min, dynamics)
    printed = rate_bound(stiffness, profile.k_min, dynamics, printed=True)
    scale = gamma * stiffness
    edge = condition_2(stiffness, tight, gamma, dynamics) / scale
    assert_allclose(edge, 0.0, atol=1e-13)
    assert np.all(condition_2(stiffness, printed, gamma, dynamics) / scale < -0.1)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
def test_eq27_constant_bound_is_the_least_pointwise_bound(ratio):
    k_min, mass = np.full(6, 100.0), np.linspace(0.5, 2.0, 6)
    dynamics = VirtualDynamics(mass=mass, damping_ratio=ratio)
    constant = rate_bound(k_min, k_min, dynamics)
    printed = rate_bound(k_min, k_min, dynamics, printed=True)
    assert_allclose(constant, 4 * ratio * 1000.0 / ((1 + 2 * ratio**2) * np.sqrt(mass)))
    assert_allclose(printed, 4 * ratio * 1000.0 / ((1 + 4 * ratio**2) * np.sqrt(mass)))
    stiffness = np.linspace(100.0, 500.0, 100)[:, None] * np.ones(6)
    pointwise = rate_bound(stiffness, k_min, dynamics)
    assert np.all(np.diff(pointwise, axis=0) > 0)
    assert np.all(pointwise >= constant * (1 - 1e-14))
    assert np.all(
        rate_bound(stiffness, k_min, dynamics, printed=True) >= printed * (1 - 1e-14)
    )


def test_eq28_gives_the_published_numbers():
    assert_allclose(
        uncertainty_fall_bound(PAPER_PROFILE, PAPER_DYNAMICS), 0.0222, atol=3e-5
    )
    assert_allclose(
        uncertainty_fall_bound(PAPER_PROFILE, PAPER_DYNAMICS, printed=True),
        0.0133,
        atol=5e-5,
    )


@pytest.mark.parametrize(("profile", "dynamics"), SETTINGS)
def test_eq28_bounds_falling_uncertainty(profile, dynamics):
    bound = uncertainty_fall_bound(profile, dynamics)
    std = np.linspace(0.0, 3.0, 301)[:, None] * profile.beta
    stiffness = profile.stiffness(std)

    def margin(std_rate):
        rate = profile.rate(std, np.broadcast_to(std_rate, std.shape))
        return rate_bound(stiffness, profile.k_min, dynamics) - rate

    assert np.all(margin(-0.999 * bound) > 0)
    # Sufficient, not necessary: the slope is steepest where more rate is allowed.
    assert np.any(margin(-4.0 * bound) < 0)
    assert np.all(margin(1000.0 * bound) > 0)  # rising never does


# --- Governor ----------------------------------------------------------------


def govern(profile, dynamics, std, dt=DT):
    """Run the governor over σ (T, 6); return stiffness, rate, margin (T, 6)."""
    governor = StiffnessGovernor(profile, dynamics)
    steps = [governor.step(profile.stiffness(row), dt) for row in std]
    return (
        np.array([step.stiffness for step in steps]),
        np.array([step.rate for step in steps]),
        np.array([step.margin for step in steps]),
    )


@given(
    units=arrays(np.float64, (30, 6), elements=st.floats(0.0, 4.0)),
    dt=st.sampled_from([1e-4, 0.01, 1.0]),
)
def test_governor_holds_the_bound_for_any_uncertainty(units, dt):
    """K̇ + γḊ - 2γK < 0 with K̇, Ḋ the differences of what was rendered."""
    for profile, dynamics in SETTINGS:
        stiffness, rate, margin = govern(profile, dynamics, units * profile.beta, dt)
        assert margin.min() > 0
        gamma = decay_rate(profile.k_min, dynamics)
        k_rate = np.diff(stiffness, axis=0) / dt
        d_rate = np.diff(dynamics.damping(stiffness), axis=0) / dt
        assert np.all(k_rate + gamma * d_rate - 2 * gamma * stiffness[:-1] < 0)
        assert_allclose(
            np.diff(stiffness, axis=0), dt * rate[1:], atol=1e-9 * stiffness.max()
        )


def test_governor_is_idle_when_not_needed():
    bound = uncertainty_fall_bound(PAPER_PROFILE, PAPER_DYNAMICS)[0]
    time = DT * np.arange(300)[:, None]
    std = np.maximum(0.02 - 0.9 * bound * time, 0.0) * np.ones(6)
    wished = PAPER_PROFILE.stiffness(std)
    stiffness, rate, _ = govern(PAPER_PROFILE, PAPER_DYNAMICS, std)
    assert_array_equal(stiffness, wished)
    assert_allclose(rate[1:], np.diff(wished, axis=0) / DT)


def test_governor_lets_stiffness_fall_at_once_and_reaches_a_higher_one():
    governor = StiffnessGovernor(PAPER_PROFILE, PAPER_DYNAMICS)
    low, high = np.full(6, 100.0), np.full(6, 500.0)
    first = governor.step(high, DT)
    assert_array_equal(first.stiffness, high)
    assert_array_equal(first.rate, 0.0)
    assert_array_equal(governor.step(low, DT).stiffness, low)
    climb = [governor.step(high, DT).stiffness[0] for _ in range(100)]
    assert climb[0] == pytest.approx(100.0 + 0.999 * DT * 4000 / 3)
    assert climb[-1] == 500.0
