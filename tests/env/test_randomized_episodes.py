"""Randomized episodes: seeds, options, corners, sensor noise and control delay."""

from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from numpy.testing import assert_array_equal

import gplfd_env
from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_env.doors.variation import Variation

pytestmark = pytest.mark.slow

IDS = (gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID)
NOISE = {"pose_noise": (0.002, 0.01), "wrench_noise": (1.5, 0.08)}
STD = np.repeat([0.002, 0.01, 1.5, 0.08], 3)
REST = np.zeros(6)

both_ids = pytest.mark.parametrize("id", IDS)


def variations(env: Any, seed: int) -> list[Variation]:
    drawn = []
    for episode_seed in (seed, None, None, None):
        env.reset(seed=episode_seed)
        drawn.append(env.variation)
    return drawn


@both_ids
def test_seed_decides_all_that_is_drawn(id, make_env):
    first, second = (make_env(id=id, randomization="hard") for _ in range(2))
    drawn = variations(first, 11)
    assert variations(second, 11) == drawn
    assert len({one.door.radius for one in drawn}) == 4, "each episode draws anew"
    assert variations(second, 12) != drawn
    for one in drawn:
        assert one.noise.position == RANDOMIZATIONS["hard"].pose_noise[0]


def test_the_length_of_an_episode_does_not_change_the_next(make_env):
    """Nor does the noise in it: both come from generators of their own."""
    first, second = (make_env(randomization="hard") for _ in range(2))
    first.reset(seed=5)
    second.reset(seed=5)
    for _ in range(150):
        second.step(REST)
    assert data_equivalence(first.reset(), second.reset(), exact=True)
    assert first.variation == second.variation


@pytest.mark.parametrize(("name", "n"), [("mild", 3), ("hard", 8)])
def test_the_true_arc_opens_randomized_doors(name, n, make_vec, opening_poses):
    """Each arc is turned as the heading error turns it.

    Nothing is corrected: friction, closer and depth of the grasp matter alone.
    """
    envs = make_vec(n, randomization=name, autoreset_mode="Disabled")
    envs.reset(seed=100)
    poses = [opening_poses(door, 66.0, 6.0) for door in envs.door_geometries]
    success = np.zeros(n, dtype=bool)
    for pose in np.stack(poses, axis=1):
        *_, infos = envs.step(pose)
        success |= infos["success"]
    assert success.mean() >= 0.95


@pytest.mark.parametrize(
    ("id", "settings", "sensor", "reading"),
    [
        (IDS[0], {"randomization": NOISE}, "ee_pose", (0, 0, 0, 3.1415, 0, 0)),
        (gplfd_env.GRIPPER_ENVIRONMENT_ID, {}, "finger", (0.06,)),
    ],
    ids=["a half turn with noise", "a finger beyond its stop"],
)
def test_observations_are_within_their_space(make_env, id, settings, sensor, reading):
    env = make_env(id=id, **settings).unwrapped
    for seed in range(20):
        env.reset(seed=seed)
        sensed = env._sensed.copy()
        sensed[getattr(env._episode.reader, sensor)] = reading
        assert env.observation_space.contains(env._episode.observation(sensed))


def test_noise_has_the_stated_spread_and_is_white(make_env, draw_actions):
    """Against a twin with perfect sensors: noise must not reach the simulation."""
    noisy, clean = make_env(randomization=NOISE), make_env()
    pairs = [(noisy.reset(seed=0)[0], clean.reset(seed=0)[0])]
    for action in draw_actions(clean.action_space, 1200):
        seen, *result = noisy.step(action)
        true, *true_result = clean.step(action)
        pairs.append((seen, true))
        assert data_equivalence(result, true_result, exact=True)
        for key in ("ee_twist", "joint_pos", "joint_vel", "time"):
            assert_array_equal(seen[key], true[key])
    error = np.array(
        [
            np.concatenate([seen[key] - true[key] for key in ("ee_pose", "wrench")])
            for seen, true in pairs
        ]
    )
    unit, n = error / STD, len(error)
    assert np.abs(unit.mean(axis=0)).max() < 4 / np.sqrt(n)
    assert np.abs(unit.std(axis=0) - 1.0).max() < 4 / np.sqrt(2 * n)
    correlation = np.corrcoef(unit.T) - np.eye(12)
    assert np.abs(correlation).max() < 4 / np.sqrt(n)
    for lag in (1, 2, 128):
        assert np.abs((unit[lag:] * unit[:-lag]).mean(axis=0)).max() < 4.5 / np.sqrt(n)


@both_ids
@pytest.mark.parametrize("delay", [0, 1, 3, 10])
def test_a_delayed_command_does_the_same_later(delay, id, start_env, draw_actions):
    """Bit for bit what a twin does that is told to rest first, then the same.

    A waiting command is not the caller's array.
    """
    given = {"shortest_delay": delay, "longest_delay": delay}
    delayed, twin = start_env(randomization=given, id=id), start_env(id=id)
    assert delayed.variation.delay == delay
    actions = draw_actions(twin.action_space, 30)
    shifted = [*delay * [twin.command.rest], *actions]
    buffer = np.zeros_like(actions[0])
    for action, later in zip(actions, shifted, strict=False):
        buffer[:] = action
        result = delayed.step(buffer)
        buffer[:] = 9.0
        assert data_equivalence(result, twin.step(later), exact=True)
