"""A simulation that blows up ends the episode and hands out no NaN."""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

from gplfd_env.envs.door_opening import DoorOpeningEnv


@pytest.fixture(autouse=True)
def _log_file_goes_to_a_scratch_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo writes MUJOCO_LOG.TXT into the working directory."""
    monkeypatch.chdir(tmp_path)


def assert_finite(value: Any) -> None:
    if isinstance(value, dict):
        for item in value.values():
            assert_finite(item)
    elif not isinstance(value, str):
        assert np.isfinite(value).all()


@pytest.mark.parametrize("field", ["qpos", "qvel"])
@pytest.mark.parametrize("value", [1e4, 1e8, 1e12, np.nan, np.inf])
def test_divergence_truncates_with_the_last_good_observation(
    value: float, field: str, make_env: Callable
) -> None:
    env = make_env("small")
    env.reset(seed=0)
    for _ in range(3):
        last, _, _, _, before = env.step(np.zeros(6))
    getattr(env.data, field)[:] = value
    observation, reward, terminated, truncated, info = env.step(np.zeros(6))
    assert (terminated, truncated) == (False, True)
    assert info["simulation_error"] is True
    assert info["failure"] == "simulation_error"
    assert not info["success"]
    assert reward == 0.0
    assert type(reward) is float
    assert data_equivalence(observation, last, exact=True)
    assert observation in env.observation_space
    assert_finite(observation)
    assert_finite(info)
    assert info.keys() == before.keys()
    assert info["door_angle"] == before["door_angle"]


@pytest.mark.parametrize("value", [30.0, 100.0, 300.0, 1000.0, 3000.0])
def test_fast_but_finite_motion_stays_in_the_spaces_or_is_an_error(
    value: float, make_env: Callable
) -> None:
    env = make_env("small")
    env.reset(seed=0)
    env.data.qvel[:] = value
    for _ in range(20):
        observation, reward, _, truncated, info = env.step(np.zeros(6))
        assert observation in env.observation_space
        assert_finite(observation)
        assert_finite(info)
        assert np.isfinite(reward)
        assert truncated is info["simulation_error"]


def test_error_lasts_until_reset_and_leaves_no_trace(make_env: Callable) -> None:
    env, fresh = make_env("small"), make_env("small")
    env.reset(seed=0)
    env.data.qvel[:] = 1e8
    for _ in range(3):
        *_, truncated, info = env.step(np.zeros(6))
        assert truncated
        assert info["simulation_error"]
    assert data_equivalence(env.reset(seed=1), fresh.reset(seed=1), exact=True)
    assert data_equivalence(env.step(np.zeros(6)), fresh.step(np.zeros(6)), exact=True)


def test_divergence_in_the_first_step(make_env: Callable) -> None:
    env = make_env("small")
    first, _ = env.reset(seed=0)
    env.data.qvel[:] = np.nan
    observation, *_ = env.step(np.zeros(6))
    assert data_equivalence(observation, first, exact=True)


def test_observation_after_divergence_is_a_copy(make_env: Callable) -> None:
    """Also when the caller has edited the array of the step before."""
    env = make_env("small")
    env.reset(seed=0)
    kept, *_ = env.step(np.zeros(6))
    original = {key: value.copy() for key, value in kept.items()}
    for value in kept.values():
        value[:] = 0.5
    env.data.qvel[:] = np.nan
    first, *_ = env.step(np.zeros(6))
    second, *_ = env.step(np.zeros(6))
    assert data_equivalence(first, original, exact=True)
    assert not any(np.shares_memory(first[key], second[key]) for key in first)


def test_passive_checker_accepts_a_diverged_step() -> None:
    env = gym.make("gplfd/DoorOpening-v1", door="small")
    env.reset(seed=0)
    assert isinstance(env.unwrapped, DoorOpeningEnv)
    env.unwrapped.data.qvel[:] = np.nan
    *_, truncated, info = env.step(np.zeros(6))
    assert truncated
    assert info["simulation_error"]
    env.close()
