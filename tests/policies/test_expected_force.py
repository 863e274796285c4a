"""What hands expect to feel, and what they learn from feeling it."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import POLICIES, TrainingInput
from gplfd_policies.adaptation.gridded import LOOK_AHEAD

RADIUS = 0.5


def along_the_path(poses, newtons):
    """Wrenches with a force along the arc of a door, whose hand turns about y."""
    wrenches = np.zeros(poses.shape)
    wrenches[:, 0] = newtons * np.cos(poses[:, 4])
    wrenches[:, 2] = -newtons * np.sin(poses[:, 4])
    return wrenches


@pytest.fixture(scope="module")
def agent(demonstrations):
    """An agent that was shown doors which take 2 to 4 N, 3 N on average."""
    forced = [
        replace(motion, wrenches=along_the_path(motion.poses, force))
        for motion, force in zip(demonstrations, np.linspace(2.0, 4.0, 6), strict=True)
    ]
    return POLICIES["gp"].method(TrainingInput(demonstrations=forced))


def felt(agent, newtons, count=60, end=0.6):
    """Lead its hand through a door that resists with a force; return its steps."""
    agent.reset({})
    poses = handle_pose_on_arc(RADIUS, np.linspace(0.0, end, count))
    resisting = -along_the_path(poses, newtons)
    return [
        agent.act({"ee_pose": pose, "wrench": wrench})
        for pose, wrench in zip(poses, resisting, strict=True)
    ]


def test_a_door_as_demonstrated_is_expected_to_feel_so(agent):
    steps = felt(agent, 2.7)
    force = np.array([np.linalg.norm(step.expected_force) for step in steps])
    spread = np.array([step.expected_force_std for step in steps])
    assert_allclose(steps[0].expected_force, [3.0, 0.0, 0.0], atol=0.1)
    assert spread[0, 0] == pytest.approx(0.8, rel=0.5)
    assert (np.abs(force - 2.7) < 1.96 * spread[:, 0]).mean() > 0.9
    assert spread[-1, 0] < 0.5 * spread[0, 0]


def test_a_heavier_door_is_expected_to_stay_heavy(agent):
    """Expected before it is felt: the first step knows the demonstrations only."""
    steps = felt(agent, 9.0)
    assert_allclose(steps[0].expected_force[0], 3.0, atol=0.1)
    assert np.linalg.norm(steps[-1].expected_force) == pytest.approx(9.0, abs=1.0)
    assert steps[-1].expected_force[0] > 5.0  # the hand pulls
    agent.reset({})
    again = felt(agent, 2.0, count=2)
    assert_allclose(again[0].expected_force, steps[0].expected_force)


def test_a_force_is_learned_before_the_next_is_expected_at_that_door(agent):
    forecast, phase = agent._controller._forces, np.float64(0.4)
    expected = []
    for forget in (True, False):
        forecast.reset()
        forecast.measure(np.full(6, -9.0), np.eye(3))
        forecast.learn(np.bool_(True), phase)
        if forget:
            forecast.reset()
        expected += [forecast.expect(phase, np.eye(3))[0].mean for _ in range(2)]
    assert_array_equal(expected[0], expected[1])
    assert np.linalg.norm(expected[2] - expected[0]) > 1.0
    assert_array_equal(expected[3], expected[2])


def test_what_is_expected_ahead_is_that_of_the_phase_ahead(agent):
    forecast = agent._controller._forces
    forecast.reset()
    rotation, phase = np.eye(3), np.float64(0.4)
    here, ahead = forecast.expect(phase, rotation)
    later, _ = forecast.expect(phase + LOOK_AHEAD, rotation)
    assert_allclose(ahead.mean, later.mean)
    assert_allclose(ahead.std, later.std)
    assert not np.allclose(here.mean, ahead.mean, rtol=1e-6)
    assert here.largest == pytest.approx(4.0, abs=0.1)
