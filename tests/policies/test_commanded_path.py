"""Set-points and stiffness that an agent commands without measurements."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import relative_poses
from gplfd_policies import make_agent, policy_named
from gplfd_policies.agents.commanded_path import CommandedPath, commanded_path
from gplfd_policies.control.rendering import ARM_DYNAMICS
from gplfd_policies.control.stability import decay_rate, rate_bound, step_condition
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.registry.open_loop import open_loop

H = 0.01
GP = policy_named("gp").method
K_MIN = DEFAULT_PROFILE.k_min
BASE = np.array([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


def path_of(stiffness, **changes):
    """Return a path along a helix with stiffnesses (T, 6)."""
    times = np.arange(len(stiffness)) * H
    path = np.stack([np.sin(times), times, 1.0 - np.cos(times)] + [0.3 * times] * 3, 1)
    damping = ARM_DYNAMICS.damping(stiffness)
    poses = path.copy()
    poses[:, :3] += (damping / stiffness)[:, :3] * 0.2
    given = {
        "times": times,
        "poses": poses,
        "path": path,
        "std": np.linspace(0.001, 0.06, 6) + 0.0 * stiffness,
        "stiffness": stiffness,
        "damping": damping,
        "margin": np.ones_like(stiffness),
        "profile": DEFAULT_PROFILE,
        "dynamics": ARM_DYNAMICS,
    }
    return CommandedPath(**(given | changes))


def frame_of(turn):
    return np.array([0.8, -0.1, 1.0, *Rotation.from_matrix(turn).as_rotvec()])


def falling(x_after):
    """x falls at once from 500 N/m, y and z stay at 200 N/m."""
    stiffness = np.tile(np.repeat([200.0, 20.0], 3), (20, 1))
    stiffness[:10, 0], stiffness[10:, 0] = 500.0, x_after
    return stiffness


@pytest.fixture(scope="module")
def agent(skill):
    return open_loop(GP).follow(skill)


@pytest.fixture(scope="module")
def commanded(agent):
    return commanded_path(agent)


def test_the_agent_commands_the_same_whatever_the_hand_does(agent, commanded):
    rng = np.random.default_rng(0)
    agent.reset({})
    for number in range(len(commanded.times)):
        hand, wrench = rng.normal(size=6), 20.0 * rng.normal(size=6)
        step = agent.act({"ee_pose": hand, "wrench": wrench})
        # Compensated force: x - x, which is exactly nothing.
        np.testing.assert_array_equal(step.action, commanded.poses[number])
        np.testing.assert_array_equal(step.stiffness, commanded.stiffness[number])


def test_it_goes_from_the_closed_door_to_the_end_of_the_path_and_rests(
    skill, commanded
):
    steps = np.diff(commanded.poses[:, :3], axis=0)
    np.testing.assert_allclose(
        commanded.path[0], skill.predict(np.zeros(1)).mean[0], atol=1e-3
    )
    np.testing.assert_allclose(commanded.path[-1], skill.predict(np.ones(1)).mean[0])
    np.testing.assert_allclose(commanded.poses[-1], commanded.path[-1], atol=1e-4)
    assert np.linalg.norm(steps, axis=1).max() < 0.6 * H
    assert not commanded.poses.flags.writeable


@pytest.mark.parametrize("rate", [20.0, 200.0])
def test_another_rate_is_the_same_motion(skill, commanded, rate):
    other = commanded_path(open_loop(GP, 1.0 / rate).follow(skill))
    assert other.period == pytest.approx(1.0 / rate)
    assert other.times[-1] == pytest.approx(commanded.times[-1], abs=0.4)
    # Sample n is where the path is at n + 1.
    ours = np.interp(
        other.times + other.period, commanded.times + H, commanded.path[:, 0]
    )
    inside = other.times > H
    np.testing.assert_allclose(other.path[inside, 0], ours[inside], atol=2e-4)


def test_every_step_satisfies_the_condition_and_so_does_a_constant_damping(commanded):
    k, gamma = commanded.stiffness, decay_rate(commanded.profile.k_min, ARM_DYNAMICS)
    assert (step_condition(k, H, commanded.profile.k_min, ARM_DYNAMICS) < 0.0).all()
    assert (np.diff(k, axis=0) < 2.0 * gamma * H * k[:-1]).all()
    assert (commanded.margin > 0.0).all()


@pytest.mark.parametrize("k", [100.0, 230.0, 500.0])
def test_the_condition_of_a_short_step_is_the_bound_on_the_rate(k):
    short, k = 1e-6, np.repeat([k, k / 10.0], 3)
    for share, stable in ((0.999, True), (1.001, False)):
        risen = k + share * short * rate_bound(k, K_MIN, ARM_DYNAMICS)
        condition = step_condition(np.stack([k, risen]), short, K_MIN, ARM_DYNAMICS)
        assert ((condition < 0.0) == stable).all()


def test_a_stiffness_that_rises_too_fast_is_refused():
    rising = falling(500.0)
    rising[:10, 1], rising[10:, 1] = 100.0, 120.0
    with pytest.raises(ValueError, match=r"of y rises from 100 to 120 within 0.01 s"):
        path_of(rising)
    with pytest.raises(ValueError, match="std of a commanded path must be finite"):
        path_of(falling(400.0), std=np.full((20, 6), np.nan))


def test_parallel_axes_only_change_places(commanded):
    seen = commanded.seen_from(frame_of(BASE), np.zeros(3))
    for name in ("std", "stiffness", "damping"):
        ours = getattr(commanded, name)[:, [0, 2, 1, 3, 5, 4]]
        np.testing.assert_allclose(getattr(seen, name), ours, rtol=1e-9)
    moved = np.array([0.8, -0.1, 1.0]) + commanded.poses[:, :3] @ BASE.T
    np.testing.assert_allclose(seen.poses[:, :3], moved, atol=1e-9)


@pytest.mark.parametrize("x_after", [200.0, 100.0])
def test_in_other_axes_it_is_nowhere_stiffer_and_stable(x_after):
    """As x falls, a diagonal of its own would rise faster than stable."""
    turn = Rotation.from_euler("xyz", [0.0, 0.0, 30.0], degrees=True).as_matrix()
    given = path_of(falling(x_after))
    seen = given.seen_from(frame_of(turn), np.zeros(3))
    for block in (slice(0, 3), slice(3, 6)):
        for ours, theirs in zip(
            given.stiffness[:, block], seen.stiffness[:, block], strict=True
        ):
            excess = turn @ np.diag(ours) @ turn.T - np.diag(theirs)
            assert np.linalg.eigvalsh(excess).min() > -1e-9
    assert (seen.stiffness >= K_MIN).all()
    assert seen.stiffness[:, 2] == pytest.approx(200.0)
    # The lead d v/k of the same velocity, 0.2 m/s along every axis of the task.
    lead = (seen.poses - seen.path)[:, :3] * (seen.stiffness / seen.damping)[:, :3]
    np.testing.assert_allclose(lead, np.tile(turn @ np.full(3, 0.2), (20, 1)))
    covariance = turn @ np.diag(given.std[0, :3] ** 2) @ turn.T
    np.testing.assert_allclose(seen.std[0, :3] ** 2, np.diagonal(covariance))


def test_the_pose_of_the_tool_is_that_of_the_robot():
    tool = Rotation.from_euler("y", -90.0, degrees=True)
    turn = Rotation.from_matrix(BASE) * Rotation.from_euler("y", 20.0, degrees=True)
    given = path_of(falling(200.0))
    task = frame_of(turn.as_matrix())
    bare = given.seen_from(task, np.zeros(3))
    np.testing.assert_allclose(
        relative_poses(bare.path, task)[:, :3], given.path[:, :3]
    )
    held = given.seen_from(task, tool.as_rotvec())
    expected = turn * Rotation.from_rotvec(given.poses[:, 3:].copy()) * tool
    found = Rotation.from_rotvec(held.poses[:, 3:].copy())
    assert (found.inv() * expected).magnitude().max() < 1e-7
    np.testing.assert_array_equal(held.poses[:, :3], bare.poses[:, :3])


def test_what_cannot_be_exported_is_refused(demonstrations):
    with pytest.raises(ValueError, match="stiffness along the path"):
        open_loop(policy_named("stiffness-from-force").method)
    with pytest.raises(ValueError, match="commands poses alone"):
        commanded_path(make_agent("gp", demonstrations))
    uneven = replace(ARM_DYNAMICS, mass=np.array([4.0, 5.0, 4.0, 0.15, 0.15, 0.15]))
    with pytest.raises(ValueError, match="virtual mass is the same along"):
        path_of(falling(400.0), dynamics=uneven).seen_from(np.zeros(6), np.zeros(3))
