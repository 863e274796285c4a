"""The loop that a held hand closes: its model, its condition, its margin."""

from dataclasses import replace
from itertools import product

import gymnasium as gym
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st

from gplfd_env import ENVIRONMENT_ID
from gplfd_policies.control.rendering import Admittance
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
    HELD_HAND,
    SERVO_LAG,
    ContactLoop,
    VirtualDynamics,
)

H, HELD = 0.01, 2000.0
LOOP = ContactLoop(stiffness=np.full(6, HELD), delay=0.03)


def magnitudes(low, high):
    return st.floats(np.log(low), np.log(high)).map(np.exp)


def six(number):
    return np.full(6, float(number))


def tolerated(k, d, m, loop=LOOP):
    return float(loop.tolerated_delay(six(k), six(d), six(m))[0])


@given(
    k=magnitudes(0.1, 0.99 * HELD),
    d=magnitudes(0.1, 1000.0),
    m=magnitudes(0.001, 100.0),
    periods=st.integers(0, 8),
)
def test_tolerated_delay_is_the_edge_of_stability(k, d, m, periods):
    """By the largest root of the discretised loop, from its polynomial in 1/z."""
    inertia, resistance = m / H**2, d / H
    polynomial = np.zeros(max(periods + 2, 3))
    polynomial[:3] = [inertia + resistance + k, -2 * inertia - resistance, inertia]
    polynomial[periods + 1] += HELD
    modulus = np.abs(np.roots(polynomial)).max()
    assume(abs(modulus - 1.0) > 1e-6)
    assert (periods * H < tolerated(k, d, m)) == (modulus < 1.0)


@pytest.mark.parametrize("periods", [1, 2, 3])
def test_edges_at_critical_damping_are_those_that_were_measured_on_agents(periods):
    """Unstable below k = 92, 292 and 517 N/m at one to three periods, with m = 1 kg."""
    edge = {1: 91.1, 2: 291.8, 3: 516.6}[periods]
    for k, stable in ((edge - 1.0, False), (edge + 1.0, True)):
        assert (tolerated(k, 2.0 * np.sqrt(k), 1.0) > periods * H) == stable


@pytest.mark.parametrize("periods", [0, 1, 2, 3])
@pytest.mark.parametrize("k", [100.0, 200.0, 330.0, 500.0])
@pytest.mark.parametrize("least", [0.0, 60.0])
def test_simulated_loop_agrees_with_the_margin(least, k, periods):
    """`Admittance` itself, its command held back by whole periods."""
    dynamics = VirtualDynamics(
        mass=DEFAULT_DYNAMICS.mass, damping_ratio=1.0, least_damping=np.full(6, least)
    )
    admittance = Admittance(dynamics)
    waiting = [np.zeros(6)] * periods
    force, offsets = np.ones(6), []
    for _ in range(1000):
        waiting.append(admittance.step(six(k), force, H))
        force = -HELD * waiting.pop(0)
        offsets.append(abs(admittance.displacement[0]))
    margin = LOOP.tolerated_delay(six(k), dynamics.damping(six(k)), dynamics.mass)
    grew = max(offsets[-100:]) > max(offsets[:100])
    assert grew == (margin[0] < periods * H)
    if least:
        assert not grew


@given(
    k=magnitudes(0.01, 0.99 * HELD),
    m=magnitudes(1e-4, 1e4),
    delay=st.integers(1, 9),
    more=st.floats(1.0, 10.0),
)
def test_enough_damping_is_enough_for_every_mass_and_stiffness(k, m, delay, more):
    loop = ContactLoop(stiffness=six(HELD), delay=delay * H)
    damping = more * loop.sufficient_damping
    assert (loop.tolerated_delay(six(k), damping, six(m)) > loop.delay).all()


def test_less_damping_is_not_enough_for_a_large_mass():
    low, high = (
        LOOP.tolerated_delay(six(0.01), share * LOOP.sufficient_damping, six(1e6))[0]
        for share in (0.999, 1.001)
    )
    assert low < LOOP.delay < high


@given(k=magnitudes(1.0, 0.99 * HELD), m=magnitudes(0.1, 10.0))
def test_fast_control_is_the_loop_in_continuous_time(k, m):
    """With d = 2√(m k) the gain is one at ω² = (k_s - k)/m."""
    fast = ContactLoop(stiffness=six(HELD), delay=0.0, period=1e-7)
    omega, d = np.sqrt((HELD - k) / m), 2.0 * np.sqrt(m * k)
    expected = np.arctan2(d * omega, m * omega**2 - k) / omega
    assert tolerated(k, d, m, fast) == pytest.approx(expected, rel=1e-4)


def remaining_force(k, least, periods, held):
    """Displace the set-point of a simulated hand once, at a locked door or without bar.

    Returns the ratio of the standard deviations of the force along x in the last and in
    the first second, infinite if the grasp is lost.
    """
    env = gym.make(
        ENVIRONMENT_ID,
        randomization={"shortest_delay": periods, "longest_delay": periods},
        disturbance="locked" if held else "none",
        max_episode_steps=10_000,
    )
    observation, _ = env.reset(seed=0)
    if not held:
        env.unwrapped.model.geom("handle_bar").conaffinity = 0
    admittance = Admittance(replace(DEFAULT_DYNAMICS, least_damping=six(least)))
    along, forces = np.eye(6)[0], []
    for step in range(260):
        offset = admittance.step(six(k), observation["wrench"] * along, H)
        action = offset + 0.001 * (50 <= step < 60) * along
        observation, _, ended, _, _ = env.step(action)
        forces.append(observation["wrench"][0])
        if held and ended:
            return np.inf
    return np.std(forces[-100:]) / np.std(forces[60:160])


@pytest.mark.slow
@pytest.mark.parametrize("held", [True, False])
def test_contact_model_agrees_with_the_simulation(held):
    """0 to 3 periods of delay, 100 to 500 N/m, without and with a least damping."""
    # A free hand has no contact loop that could oscillate, whatever its stiffness.
    stiffnesses = (100, 200, 330, 500) if held else (100, 500)
    delays = range(4) if held else (0, 3)
    for periods, k, least in product(delays, stiffnesses, (0, 60)):
        dynamics = replace(DEFAULT_DYNAMICS, least_damping=six(least))
        limit = HELD_HAND.tolerated_delay(
            six(k), dynamics.damping(six(k)), dynamics.mass
        )
        margin = limit[0] - (periods * H + SERVO_LAG)
        if held and abs(margin) < 5e-4:
            continue
        calm = remaining_force(k, least, periods, held) < 0.5
        assert calm == (margin > 0.0 or not held), (periods, k, least)
