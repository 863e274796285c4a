"""What the model-based policies do about a door, without a simulator."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import DoorConfig
from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_policies import make_agent

pytestmark = pytest.mark.slow


def observation(pose, force=(0.0, 0.0, 0.0)):
    return {"ee_pose": np.array(pose), "wrench": np.array([*force, 0.0, 0.0, 0.0])}


def acted(agent, periods, force=(0.0, 0.0, 0.0), door=None):
    """Let an agent act whose hand stands still under a constant force."""
    if door is not None:
        agent.inform(door)
    agent.reset(observation(np.zeros(6)))
    return [agent.act(observation(np.zeros(6), force)) for _ in range(periods)]


def follow(agent, door, periods, lag=0.2):
    """Let a hand that a door guides follow the commands without any force."""
    angle, steps = 0.0, []
    agent.reset(observation(np.zeros(6)))
    for _ in range(periods):
        step = agent.act(observation(door.hand_poses(angle)))
        angle += lag * (float(door.angle(step.action[:3])) - angle)
        steps.append(step)
    return angle, steps


@pytest.mark.parametrize(("name", "radius"), [("reflex", 0.3), ("chord", 0.65)])
def test_a_door_is_opened_along_its_circle(name, radius):
    door = DoorGeometry.of(DoorConfig(radius=radius))
    angle, steps = follow(make_agent(name, ()), door, 1000)
    assert np.radians(60.0) < angle < np.radians(85.0)
    turned = steps[-1].action[3:]
    assert_allclose(turned, [0.0, DEMONSTRATED_ANGLE, 0.0], atol=0.1)


def test_hinge_fit_follows_the_circle_to_where_demonstrations_end():
    door = DoorGeometry(
        hinge=np.array([0.01, 0.0, -0.35]), axis=np.array([0.0, 1.0, 0.0])
    )
    angle, steps = follow(make_agent("hinge-fit", ()), door, 900)
    assert angle == pytest.approx(DEMONSTRATED_ANGLE, abs=0.01)
    poses = np.array([step.action for step in steps])
    distances = np.linalg.norm((poses[:, :3] - door.hinge)[:, [0, 2]], axis=1)
    assert np.abs(distances - door.radius).max() < 4e-3
    assert np.abs(np.diff(poses[:, :3], axis=0)).max() < 0.25 * 0.35 * 0.01 * 1.5
    assert np.diff([step.phase for step in steps]).min() > -0.01
    assert steps[-1].phase == pytest.approx(1.0, abs=0.01)


def test_hinge_fit_nulls_a_lasting_radial_force():
    moved = acted(make_agent("hinge-fit", ()), 100, force=[0.0, 0.0, 2.0])[-1]
    # 2 N over 100 N s/m for a second, nearly.
    assert (moved.action - moved.desired)[2] == pytest.approx(0.02, rel=0.05)


LATCHED = DoorGeometry.of(DoorConfig(radius=0.6, handle="lever", latch="spring"))


def test_the_oracle_turns_the_handle_first_and_lets_it_go_back():
    steps = acted(make_agent("oracle", ()), 700, door=LATCHED)
    poses = np.array([step.action for step in steps])
    turned = LATCHED.hand_poses(0.0, LATCHED.travel)
    # 0.8 s later the handle is turned, and nothing else has happened.
    assert_allclose(poses[79], turned, atol=1e-12)
    opened = LATCHED.hand_poses(DEMONSTRATED_ANGLE, 0.0)
    assert_allclose(poses[-1], opened, atol=1e-12)
    assert np.abs(np.diff(poses[:, :3], axis=0)).max() < 0.01


def test_what_is_told_the_handle_sees_the_leaf_through_it():
    """A hand that a latched door guides: on the handle's circle, then on the leaf's."""
    agent, angle = make_agent("hinge-fit-told", ()), 0.0
    agent.inform(LATCHED)
    agent.reset(observation(np.zeros(6)))
    pose, phases = np.zeros(6), []
    for period in range(1000):
        step = agent.act(observation(pose))
        phases.append(step.phase)
        if period < 100:
            pose = step.action
            turn = LATCHED.travel
            continue
        # The hand follows along the path that this door allows it.
        angles = angle + np.linspace(-0.008, 0.008, 17)
        handles = np.linspace(0.0, turn, 41)
        possible = LATCHED.hand_poses(angles[:, None], handles[None, :])
        error = np.linalg.norm((possible - step.action)[..., :3], axis=-1)
        best = np.unravel_index(np.argmin(error), error.shape)
        angle, pose = angles[best[0]], possible[best]
    assert np.degrees(angle) > 60.0
    assert_allclose(pose[3], 0.0, atol=0.05)
    assert phases[99] == 0.0
