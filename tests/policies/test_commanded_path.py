"""Set-points and stiffness that an agent commands without measurements."""

import contextlib
from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_policies import policy_named
from gplfd_policies.agents.commanded_path import CommandedPath, commanded_path
from gplfd_policies.control.rendering import ARM_DYNAMICS
from gplfd_policies.control.stiffness import DEFAULT_PROFILE

H = 0.01
GP = policy_named("gp").method
GAMMA = ARM_DYNAMICS.damping(DEFAULT_PROFILE.k_min) / ARM_DYNAMICS.mass
PLACE = [0.8, -0.1, 1.0]
BASE = Rotation.from_matrix([[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]])


def path_of(stiffness, period=H):
    """Return a path with stiffnesses (M, 6) at 0.2 m/s along every axis."""
    times = np.arange(len(stiffness)) * period
    path = np.tile([0.2, 0.2, 0.2, 0.3, 0.2, 0.1], (len(times), 1)) * times[:, None]
    lead = 0.2 * ARM_DYNAMICS.damping(stiffness) / stiffness * (np.arange(6) < 3)
    return CommandedPath(
        times=times,
        poses=path + lead,
        path=path,
        std=np.linspace(0.001, 0.06, 6) + 0.0 * stiffness,
        stiffness=stiffness,
        profile=DEFAULT_PROFILE,
        dynamics=ARM_DYNAMICS,
    )


def test_nothing_endless_or_not_finite_is_commanded(skill, commanded):
    for name in ("times", "poses", "path", "std", "stiffness"):
        values = getattr(commanded, name).copy()
        values[-1] = np.nan
        with pytest.raises(ValueError, match=f"{name} must be finite"):
            replace(commanded, **{name: values})
    endless = replace(skill, aligned=replace(skill.aligned, duration=599.0))
    with pytest.raises(
        ValueError, match="599 s; commands are computed for at most 60 s"
    ):
        commanded_path(GP.open_loop(0.001).follow(endless))


@pytest.fixture(scope="module")
def agent(skill):
    return GP.open_loop(H).follow(skill)


@pytest.fixture(scope="module")
def commanded(agent):
    return commanded_path(agent)


def test_the_agent_commands_the_same_whatever_the_hand_does(agent, commanded):
    rng = np.random.default_rng(0)
    agent.reset({})
    for pose, stiffness in zip(commanded.poses, commanded.stiffness, strict=True):
        hand, wrench = rng.normal(size=6), 20.0 * rng.normal(size=6)
        step = agent.act({"ee_pose": hand, "wrench": wrench})
        np.testing.assert_array_equal(step.action, pose)
        np.testing.assert_array_equal(step.stiffness, stiffness)


@pytest.mark.parametrize("rate", [20.0, 100.0])
def test_at_any_rate_it_is_the_path_of_the_skill_at_rest_at_both_ends(skill, rate):
    commanded = commanded_path(GP.open_loop(1.0 / rate).follow(skill))
    np.testing.assert_allclose(np.diff(commanded.times), 1.0 / rate)
    # Sample n is where the path is at n + 1.
    phases = np.minimum((commanded.times + 1.0 / rate) / skill.duration, 1.0)
    mean = skill.predict(phases).mean
    np.testing.assert_allclose(commanded.path, mean, atol=2e-3)
    np.testing.assert_allclose(commanded.poses[-1], mean[-1], atol=1e-4)
    assert np.abs(commanded.poses[0, :3]).max() < 2e-3


def test_every_step_satisfies_the_condition_and_so_does_a_constant_damping(commanded):
    k, d = commanded.stiffness, GAMMA * commanded.damping
    assert (np.diff(k + d, axis=0) < 2.0 * GAMMA * H * k[:-1]).all()
    assert (np.diff(k, axis=0) < 2.0 * GAMMA * H * k[:-1]).all()


@pytest.mark.parametrize(("share", "stable"), [(0.999, True), (1.001, False)])
def test_the_margin_is_that_of_the_condition_and_a_lack_is_refused(share, stable):
    """For short steps the condition of finite differences is that of rates."""
    k, short = np.repeat([200.0, 20.0], 3), 1e-6
    slope = 1.0 + GAMMA * ARM_DYNAMICS.damping(k) / (2.0 * k)
    risen = k + share * short * 2.0 * GAMMA * k / slope
    refused = pytest.raises(ValueError, match=r"axis 0 rises to 200.*faster")
    with contextlib.nullcontext() if stable else refused:
        path_of(np.stack([k, risen]), period=short)


@pytest.mark.parametrize(
    "turn",
    [
        BASE,
        BASE * Rotation.from_euler("y", 20.0, degrees=True),
        BASE * Rotation.from_euler("xyz", [10.0, 20.0, 30.0], degrees=True),
        Rotation.from_euler("x", 0.5) * Rotation.from_euler("y", 0.4),
    ],
    ids=("parallel", "yaw", "any", "one zero"),
)
def test_in_another_frame_it_is_nowhere_stiffer_and_the_same_motion(turn):
    stiffness = np.tile([500.0, 300.0, 150.0, 50.0, 20.0, 12.0], (20, 1))
    stiffness[10:, :2] = 120.0, 310.0
    commanded, matrix = path_of(stiffness), turn.as_matrix()
    tool = Rotation.from_euler("y", -90.0, degrees=True)
    task = np.array([*PLACE, *turn.as_rotvec()])
    seen = commanded.seen_from(task, tool.as_rotvec())
    for block in (slice(0, 3), slice(3, 6)):
        ours = matrix * commanded.stiffness[:, None, block] @ matrix.T
        excess = np.linalg.eigvalsh(ours - np.eye(3) * seen.stiffness[:, None, block])
        assert excess.min() > -1e-9
        if (np.abs(matrix) > 0.99).sum() == 3:
            np.testing.assert_allclose(excess, 0.0, atol=1e-9)
    assert seen.stiffness.min() >= 12.0
    # The lead d v/k of the same velocity.
    lead = (seen.poses - seen.path)[:, :3] * (seen.stiffness / seen.damping)[:, :3]
    np.testing.assert_allclose(lead, np.tile(matrix @ np.full(3, 0.2), (20, 1)))
    places = PLACE + commanded.path[:, :3] @ matrix.T
    np.testing.assert_allclose(seen.path[:, :3], places, atol=1e-12)
    expected = turn * Rotation.from_rotvec(commanded.poses[:, 3:].copy()) * tool
    seen_turns = Rotation.from_rotvec(seen.poses[:, 3:].copy())
    assert (seen_turns.inv() * expected).magnitude().max() < 1e-7
    covariance = matrix @ np.diag(commanded.std[0, :3] ** 2) @ matrix.T
    np.testing.assert_allclose(seen.std[0, :3] ** 2, np.diagonal(covariance))


def test_what_six_numbers_cannot_express_is_refused():
    with pytest.raises(ValueError, match="stiffness along the path"):
        policy_named("gp@stiffness-from-force").method.open_loop(H)
    mass = np.array([4.0, 5.0, 4.0, 0.15, 0.15, 0.15])
    commanded = path_of(np.tile(DEFAULT_PROFILE.k_max, (2, 1)))
    uneven = replace(commanded, dynamics=replace(ARM_DYNAMICS, mass=mass))
    with pytest.raises(ValueError, match="mass differ between axes"):
        uneven.seen_from(np.zeros(6), np.zeros(3))
