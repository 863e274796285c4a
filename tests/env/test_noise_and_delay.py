"""Sensor noise and control delay, seen from outside the environment."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from numpy.testing import assert_array_equal

import gplfd_env

IDS = (gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID)
NOISE = {"pose_noise": (0.002, 0.01), "wrench_noise": (1.5, 0.08)}
STD = np.repeat([0.002, 0.01, 1.5, 0.08], 3)


def commands(env: Any, n: int, seed: int = 0) -> np.ndarray:
    """Return actions near the closed pose; stiffness anywhere."""
    low, high = env.action_space.low, env.action_space.high
    drawn = np.random.default_rng(seed).uniform(low, high, (n, len(low)))
    drawn[:, :6] *= 0.05
    return drawn


def test_noise_has_the_stated_spread_and_is_white(make_env: Callable) -> None:
    """Against a twin with perfect sensors: noise must not reach the simulation."""
    noisy, clean = make_env(randomization=NOISE), make_env()
    pairs = [(noisy.reset(seed=0)[0], clean.reset(seed=0)[0])]
    for action in commands(clean, 1200):
        seen, reward, *ended, info = noisy.step(action)
        true, true_reward, *true_ended, true_info = clean.step(action)
        pairs.append((seen, true))
        assert data_equivalence(info, true_info, exact=True)
        assert (reward, ended) == (true_reward, true_ended)
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


def test_every_episode_has_noise_of_its_own(make_env: Callable) -> None:
    env = make_env(randomization=NOISE)
    first, _ = env.reset(seed=0)
    second, _ = env.reset()
    again, _ = env.reset(seed=0)
    assert np.all(first["wrench"] != second["wrench"])
    assert_array_equal(first["wrench"], again["wrench"])


def test_position_noise_alone_blurs_position_alone(make_env: Callable) -> None:
    env, clean = make_env(randomization={"pose_noise": (0.01, 0.0)}), make_env()
    seen, true = env.reset(seed=0)[0], clean.reset(seed=0)[0]
    assert np.all(seen["ee_pose"][:3] != true["ee_pose"][:3])
    assert_array_equal(seen["ee_pose"][3:], true["ee_pose"][3:])
    assert_array_equal(seen["wrench"], true["wrench"])


def delayed_by(delay: int, make_env: Callable, **arguments: Any) -> Any:
    """Return an environment, just reset, whose commands take that many periods."""
    env = make_env(randomization={"longest_delay": max(delay, 1)}, **arguments)
    for seed in range(200):
        env.reset(seed=seed)
        if env.variation.delay == delay:
            return env
    raise AssertionError(f"no episode with a delay of {delay}")


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("delay", [0, 1, 3, 10])
def test_a_delayed_command_does_the_same_later(
    delay: int, id: str, make_env: Callable
) -> None:
    """Bit for bit what a twin does that is told to rest first, then the same."""
    delayed, twin = delayed_by(delay, make_env, id=id), make_env(id=id)
    twin.reset(seed=0)
    actions = commands(twin, 30)
    rest = np.zeros(6)
    if id == gplfd_env.IMPEDANCE_ENVIRONMENT_ID:
        rest = np.concatenate([rest, twin.action_space.high[6:]])
    shifted = [*delay * [rest], *actions]
    for action, later in zip(actions, shifted, strict=False):
        assert data_equivalence(delayed.step(action), twin.step(later), exact=True)


@pytest.mark.parametrize("delay", [1, 4])
def test_the_effect_begins_exactly_after_the_delay(
    delay: int, make_env: Callable
) -> None:
    delayed, still = delayed_by(delay, make_env), make_env()
    still.reset(seed=0)
    pull = np.array([0.05, 0.0, 0.0, 0.0, 0.0, 0.0])
    same = []
    for _ in range(delay + 2):
        moved, *_ = delayed.step(pull)
        rested, *_ = still.step(np.zeros(6))
        same.append(np.array_equal(moved["ee_twist"], rested["ee_twist"]))
    assert same == delay * [True] + [False, False]


def test_a_waiting_command_is_not_the_caller_s_array(make_env: Callable) -> None:
    first, second = (delayed_by(3, make_env) for _ in range(2))
    buffer = np.zeros(6)
    for action in commands(first, 10):
        buffer[:] = action
        result = first.step(buffer)
        buffer[:] = 9.0
        assert data_equivalence(result, second.step(action), exact=True)
