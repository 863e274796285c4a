"""Two ways to render a stiffness: a set-point that yields, and an arm that does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.rendering import (
    ARM_DYNAMICS,
    Admittance,
    ArmRendering,
    VirtualRendering,
)
from gplfd_policies.control.stiffness import DEFAULT_DYNAMICS

H = 0.01
DESIRED = np.array([0.2, 0.01, -0.05, 0.02, 0.4, -0.03])
STIFFNESS = np.array([150.0, 300.0, 450.0, 15.0, 30.0, 45.0])
FORCE = np.array([5.0, -3.0, 8.0, 0.5, -0.2, 0.1])
AT_REST, NOTHING = np.zeros(3), np.zeros(6)


def arm():
    return ArmRendering(ARM_DYNAMICS, H)


def step(
    renderer,
    *,
    desired=DESIRED,
    velocity=AT_REST,
    stiffness=STIFFNESS,
    wrench=NOTHING,
    force=AT_REST,
):
    """Set-point of a hand that yields to a wrench and compensates a force."""
    yielding = {"compliant_wrench": wrench, "compensated_force": force}
    return renderer.command(desired, velocity, stiffness, **yielding)


def test_virtual_dynamics_displace_the_set_point_by_the_yielded_force_alone():
    renderer = VirtualRendering(DEFAULT_DYNAMICS, H)
    admittance = Admittance(DEFAULT_DYNAMICS)
    for count in range(5):
        moving = {"velocity": np.ones(3), "force": 10.0 * np.ones(3)}
        action = step(renderer, wrench=count * FORCE, **moving)
        offset = admittance.step(STIFFNESS, count * FORCE, H)
    assert_array_equal(action[:3], DESIRED[:3] + offset[:3])
    turned = compose_rotvecs(offset[3:], DESIRED[3:])
    assert_array_equal(action[3:], turned)


@settings(max_examples=10, deadline=None)
@given(
    stiffness=st.floats(100.0, 2000.0),
    lag=st.floats(0.0, 0.02),
    periods=st.integers(0, 3),
)
def test_carried_load_settles_where_the_arm_is_as_stiff_as_can_be(
    stiffness, lag, periods
):
    """The hand is held ``lag`` behind the policy; its force becomes the next load."""
    forces = [np.zeros(3)] * (periods + 1)
    direction = np.array([0.6, 0.0, -0.8])
    held = DESIRED[:3] - lag * direction
    renderer = arm()
    for _ in range(12 * round(2000.0 / stiffness) * (periods + 1)):
        soft = np.full(6, stiffness)
        action = step(renderer, stiffness=soft, force=forces[-1 - periods])
        forces.append(stiffness * (action[:3] - held))
        assert np.linalg.norm(forces[-1]) <= 2000.0 * lag + 1e-9
    assert_allclose(forces[-1], 2000.0 * lag * direction, atol=1e-2)


@pytest.mark.parametrize("periods", [0, 3])
@pytest.mark.parametrize("k", [150.0, 500.0])
def test_at_the_limit_of_the_load_clock_and_leads_come_to_rest(k, periods):
    """At a held hand the load sets the clock, the clock the lead, the lead the load."""
    renderer, rule, direction = arm(), CarriedLoad(), np.array([1.0, 0.0, 0.0])
    desired, wrenches = np.zeros(6), [np.zeros(6)] * (periods + 1)
    for _ in range(1500):
        wrench = wrenches[-1 - periods]
        response = rule.compensate(wrench, direction)
        velocity = 0.2 * response.pace * direction
        desired[:3] += H * velocity
        action = step(
            renderer,
            desired=desired,
            velocity=velocity,
            stiffness=np.full(6, k),
            wrench=response.compliant_wrench,
            force=(response.compliant_wrench - wrench)[:3],
        )
        wrenches.append(-k * action * np.eye(6)[0])
    assert_allclose(-np.array(wrenches[-20:])[:, 0], rule.limit, atol=0.1)


@pytest.mark.parametrize("k", [50.0, 500.0])
def test_a_moving_arm_does_not_lag(k):
    """The servo brakes the hand's own motion: m ẍ = k (u - x) - d ẋ."""
    speed, mass = np.array([0.1, 0.0, -0.2]), ARM_DYNAMICS.mass[:3]
    soft = np.full(6, k)
    damping = ARM_DYNAMICS.damping(soft)[:3]
    position, velocity, desired, renderer = np.zeros(3), np.zeros(3), np.zeros(6), arm()
    for _ in range(400):
        desired[:3] += H * speed
        action = step(renderer, desired=desired, velocity=speed, stiffness=soft)
        for _ in range(10):
            force = k * (action[:3] - position) - damping * velocity
            velocity = velocity + 0.1 * H * force / mass
            position = position + 0.1 * H * velocity
    # Within what the desired pose moves in one period.
    assert_allclose(position, desired[:3], atol=1.01 * H * 0.2)
