"""A simulation that blows up ends the episode and hands out no NaN."""

from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env

pytestmark = pytest.mark.usefixtures("scratch_folder")
REST = np.zeros(6)


def assert_finite(value: Any) -> None:
    if isinstance(value, dict):
        for item in value.values():
            assert_finite(item)
    elif not isinstance(value, str):
        assert np.isfinite(value).all()


@pytest.mark.parametrize(("field", "value"), [("qpos", np.nan), ("qvel", 1e12)])
def test_divergence_truncates_with_the_last_good_observation(value, field, opened):
    """Gymnasium's passive checker included; the caller's own arrays are no matter."""
    env = opened(gym.make(gplfd_env.ENVIRONMENT_ID, door="small"))
    env.reset(seed=0)
    for _ in range(3):
        last, _, _, _, before = env.step(REST)
    kept = {key: array.copy() for key, array in last.items()}
    for array in last.values():
        array[:] = 0.5
    getattr(env.unwrapped.data, field)[:] = value
    observation, reward, terminated, truncated, info = env.step(REST)
    assert (reward, terminated, truncated) == (0.0, False, True)
    assert info["simulation_error"] is True
    assert (info["failure"], info["success"]) == ("simulation_error", False)
    assert data_equivalence(observation, kept, exact=True)
    assert observation in env.observation_space
    assert_finite(info)
    assert info.keys() == before.keys()
    assert info["door_angle"] == before["door_angle"]
    again, *_ = env.step(REST)
    assert not any(np.shares_memory(observation[key], again[key]) for key in again)
