"""Two ways to render a stiffness: a set-point that yields, and an arm that does."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from gplfd_env import ENVIRONMENT_IDS
from gplfd_env.robot.model import SERVO_DAMPING, SERVO_STIFFNESS
from gplfd_env.simulation.command import STIFFNESS_RANGES
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.rendering import (
    ARM_DYNAMICS,
    ArmRendering,
    Renderer,
    Rendering,
    VirtualRendering,
)
from gplfd_policies.control.stiffness import (
    DEFAULT_DYNAMICS,
)
from gplfd_policies.registry.catalogue import POLICIES, make_agent

H = 0.01
DESIRED = np.array([0.2, 0.01, -0.05, 0.02, 0.4, -0.03])
STIFFNESS = np.array([150.0, 300.0, 450.0, 15.0, 30.0, 45.0])
FORCE = np.array([5.0, -3.0, 8.0, 0.5, -0.2, 0.1])
AT_REST, NOTHING = np.zeros(3), np.zeros(6)


def arm() -> Renderer:
    return ArmRendering().renderer(ARM_DYNAMICS, H, ())


@pytest.mark.parametrize("rendering", [VirtualRendering(), ArmRendering()])
def test_without_load_at_rest_the_set_point_is_the_desired_pose(rendering):
    assert isinstance(rendering, Rendering)
    renderer = rendering.renderer(DEFAULT_DYNAMICS, H, ())
    unloaded = {"compliant_wrench": NOTHING, "compensated_force": AT_REST}
    action = renderer.step(DESIRED, AT_REST, STIFFNESS, **unloaded)
    np.testing.assert_allclose(action, DESIRED, atol=1e-15)
    assert action is not DESIRED


def test_virtual_dynamics_displace_the_set_point_by_the_yielded_force_alone():
    renderer = VirtualRendering().renderer(DEFAULT_DYNAMICS, H, ())
    admittance = Admittance(DEFAULT_DYNAMICS)
    for step in range(5):
        load = {
            "compliant_wrench": step * FORCE,
            "compensated_force": 10.0 * np.ones(3),
        }
        action = renderer.step(DESIRED, np.ones(3), STIFFNESS, **load)
        offset = admittance.step(STIFFNESS, step * FORCE, H)
    np.testing.assert_array_equal(action[:3], DESIRED[:3] + offset[:3])
    turned = compose_rotvecs(offset[3:], DESIRED[3:])
    np.testing.assert_array_equal(action[3:], turned)
    renderer.reset()
    still = {"compliant_wrench": NOTHING, "compensated_force": AT_REST}
    action = renderer.step(DESIRED, AT_REST, STIFFNESS, **still)
    np.testing.assert_allclose(action, DESIRED, atol=1e-15)


def test_the_arm_yields_by_itself():
    """What is to be yielded to moves no set-point: the spring of the servo gives."""
    load = {"compliant_wrench": FORCE, "compensated_force": AT_REST}
    action = arm().step(DESIRED, AT_REST, STIFFNESS, **load)
    np.testing.assert_array_equal(action, DESIRED)


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
    for _ in range(12 * round(2000.0 / stiffness) * (periods + 1)):
        load = {"compliant_wrench": NOTHING, "compensated_force": forces[-1 - periods]}
        action = arm().step(DESIRED, AT_REST, np.full(6, stiffness), **load)
        forces.append(stiffness * (action[:3] - held))
        assert np.linalg.norm(forces[-1]) <= 2000.0 * lag + 1e-9
    np.testing.assert_allclose(forces[-1], 2000.0 * lag * direction, atol=1e-2)


@pytest.mark.parametrize("periods", [0, 3])
@pytest.mark.parametrize("k", [150.0, 500.0])
def test_at_the_limit_of_the_load_clock_and_leads_come_to_rest(k, periods):
    """Held hand: load sets the clock's pace, pace the lead for the damper, that load.

    Without smoothing they alternate from one period to the next.
    """
    rule, renderer, stiffness = CarriedLoad(), arm(), np.full(6, k)
    direction, wrenches = np.array([1.0, 0.0, 0.0]), [np.zeros(6)] * (periods + 1)
    desired = np.zeros(6)
    for _ in range(1500):
        wrench = wrenches[-1 - periods]
        response = rule.compensate(wrench, direction)
        yielded = response.compliant_wrench
        velocity = 0.2 * response.pace * direction
        desired[:3] += H * velocity
        load = {
            "compliant_wrench": yielded,
            "compensated_force": (yielded - wrench)[:3],
        }
        action = renderer.step(desired, velocity, stiffness, **load)
        wrenches.append(-stiffness * action * np.eye(6)[0])
    last = -np.array(wrenches[-20:])[:, 0]
    np.testing.assert_allclose(last, rule.limit, atol=0.1)


@pytest.mark.parametrize("k", [50.0, 500.0])
def test_a_moving_arm_does_not_lag(k):
    """The servo brakes the hand's own motion: m ẍ = k (u - x) - d ẋ."""
    speed, mass = np.array([0.1, 0.0, -0.2]), ARM_DYNAMICS.mass[:3]
    damping = ARM_DYNAMICS.damping(np.full(6, k))[:3]
    position, velocity, desired = np.zeros(3), np.zeros(3), np.zeros(6)
    unloaded, renderer = (
        {"compliant_wrench": NOTHING, "compensated_force": AT_REST},
        arm(),
    )
    for _ in range(400):
        desired[:3] += H * speed
        action = renderer.step(desired, speed, np.full(6, k), **unloaded)
        for _ in range(10):
            force = k * (action[:3] - position) - damping * velocity
            velocity = velocity + 0.1 * H * force / mass
            position = position + 0.1 * H * velocity
    # Within what the desired pose moves in one period.
    np.testing.assert_allclose(position, desired[:3], atol=1.01 * H * 0.2)


def test_an_agent_leads_by_the_velocity_of_its_path(demonstrations):
    """In the middle of an opening, by about d/k of what the desired pose moves."""
    agent = make_agent("gp-impedance", demonstrations)
    observation = {"ee_pose": np.zeros(6), "wrench": np.zeros(6)}
    agent.reset(observation)
    steps = []
    for _ in range(250):
        steps.append(agent.act(observation))
        observation = {"ee_pose": steps[-1].desired, "wrench": np.zeros(6)}
    last = steps[-1]
    velocity = (last.desired - steps[-21].desired)[:3] / (20 * H)
    softness = ARM_DYNAMICS.damping(last.stiffness) / last.stiffness
    expected = softness[:3] * velocity
    lead = (last.action - last.desired)[:3]
    assert np.linalg.norm(lead - expected) < 0.3 * np.linalg.norm(expected)


def test_dynamics_and_range_are_those_of_the_arm():
    assert ArmRendering().stiffness_range == STIFFNESS_RANGES
    stiffest = np.repeat(SERVO_STIFFNESS, 3)
    damping = ARM_DYNAMICS.damping(stiffest)
    np.testing.assert_allclose(damping, np.repeat(SERVO_DAMPING, 3), rtol=0.01)


def test_each_rendering_has_an_environment():
    controls = {VirtualRendering().control, ArmRendering().control}
    assert controls == set(ENVIRONMENT_IDS)
    for name, control in (("gp", "pose"), ("gp-impedance", "impedance")):
        assert POLICIES[name].method.config.rendering.control == control
