"""The virtual dynamics, Eq. (22), in discrete time."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose
from scipy.integrate import solve_ivp

from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.stability import StiffnessGovernor, decay_rate
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    DEFAULT_PROFILE,
    PAPER_DYNAMICS,
    PAPER_PROFILE,
)

STIFF = PAPER_PROFILE.k_max
WRENCH = np.array([5.0, -3.0, 8.0, 0.5, -0.2, 0.1])


@pytest.mark.parametrize("dt", [0.001, 0.01, 0.05, 1.0])
def test_eq22_static_deflection_is_force_over_stiffness(dt):
    admittance = Admittance(DEFAULT_DYNAMICS)
    stiffness = DEFAULT_PROFILE.k_max
    for _ in range(max(50, round(2.0 / dt))):
        displacement = admittance.step(stiffness, WRENCH, dt)
    assert_allclose(displacement, WRENCH / stiffness, rtol=1e-6)


def test_eq22_is_stable_where_semi_implicit_euler_diverges():
    dt, mass = 0.05, PAPER_DYNAMICS.mass
    damping = PAPER_DYNAMICS.damping(STIFF)
    admittance = Admittance(PAPER_DYNAMICS)
    position, velocity, wrench = np.zeros(6), np.zeros(6), WRENCH
    for _ in range(100):
        velocity = (
            velocity + dt * (wrench - damping * velocity - STIFF * position) / mass
        )
        position = position + dt * velocity
        admittance.step(STIFF, wrench, dt)
        wrench = np.zeros(6)
    assert np.abs(position).min() > 1e3
    assert np.abs(admittance.displacement).max() < 1e-6


def test_eq22_converges_to_the_differential_equation():
    def stiffness(time):
        return (300 + 200 * np.sin(5 * time)) * np.ones(6)

    def force(time):
        return WRENCH * np.cos(8 * time)

    def motion(time, state):
        position, velocity = state[:6], state[6:]
        k = stiffness(time)
        damping = PAPER_DYNAMICS.damping(k)
        acceleration = force(time) - damping * velocity - k * position
        return np.concatenate([velocity, acceleration / PAPER_DYNAMICS.mass])

    exact = solve_ivp(motion, (0, 1), np.zeros(12), rtol=1e-10, atol=1e-12).y[:6, -1]
    errors = []
    for n in (100, 1000, 10_000):
        admittance, dt = Admittance(PAPER_DYNAMICS), 1.0 / n
        for index in range(1, n + 1):
            admittance.step(stiffness(index * dt), force(index * dt), dt)
        errors.append(np.abs(admittance.displacement - exact).max())
    assert errors[2] < 3e-5
    # First order: ten times smaller steps, ten times smaller errors.
    assert_allclose(np.divide(errors[:2], errors[1:]), 10.0, rtol=0.15)


def energies(targets, dt, *, governed):
    """Let a kicked hand go under a stiffness sequence.

    Return Kronander & Billard's function per axis, with M, D, K diagonal.
    """
    governor = StiffnessGovernor(PAPER_PROFILE, PAPER_DYNAMICS)
    admittance, mass = Admittance(PAPER_DYNAMICS), PAPER_DYNAMICS.mass
    gamma = decay_rate(PAPER_PROFILE.k_min, PAPER_DYNAMICS)
    admittance.step(PAPER_PROFILE.k_min, 50 * WRENCH, dt)
    values = []
    for target in targets:
        stiffness = governor.step(target, dt).stiffness if governed else target
        # The function belongs to the stiffness that acts from here on.
        error, velocity = admittance.displacement, admittance.velocity
        shape = stiffness + gamma * PAPER_DYNAMICS.damping(stiffness) - gamma**2 * mass
        values.append((mass * (velocity + gamma * error) ** 2 + shape * error**2) / 2)
        admittance.step(stiffness, np.zeros(6), dt)
    return np.array(values)


@given(
    sigma=arrays(np.float64, (40, 6), elements=st.floats(0.0, 0.03)),
    dt=st.sampled_from([0.001, 0.01, 0.05, 0.5]),
)
def test_lyapunov_function_never_grows(sigma, dt):
    values = energies(PAPER_PROFILE.stiffness(sigma), dt, governed=True)
    assert np.all(np.diff(values, axis=0) <= 1e-12 * values[:-1])


@pytest.mark.parametrize("dt", [0.001, 0.01])
def test_lyapunov_function_grows_without_the_governor(dt):
    jumping = np.where(np.arange(60)[:, None] % 2, 0.0, 0.03) * np.ones(6)
    targets = PAPER_PROFILE.stiffness(jumping)
    assert np.any(np.diff(energies(targets, dt, governed=False), axis=0) > 0)
    assert np.all(np.diff(energies(targets, dt, governed=True), axis=0) <= 0)
