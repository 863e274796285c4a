"""TorchRL's own wrapper on these environments; needs torchrl, run by .ci/learners."""

import os

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env

if os.environ.get("GPLFD_REQUIRE_ALL") != "1":
    pytest.importorskip("torchrl", reason="needs pip install torchrl")

import torch
from torchrl.envs import GymEnv, check_env_specs

RL = gplfd_env.RL_ENVIRONMENT_ID


def test_its_specs_hold():
    env = GymEnv(RL, door="small")
    check_env_specs(env)
    env.close()


def test_its_episode_is_gymnasium_s_bit_for_bit():
    rng = np.random.default_rng(0)
    actions = (0.2 * rng.uniform(-1.0, 1.0, (40, 6))).astype(np.float32)
    actions[:, :3] += np.float32([0.5, 0.0, 0.0])
    theirs, ours = GymEnv(RL, door="small"), gym.make(RL, door="small")
    step = theirs.reset()
    observation, _ = ours.reset(seed=0)
    np.testing.assert_array_equal(step["observation"].numpy(), observation)
    for action in actions:
        step["action"] = torch.from_numpy(action)
        step = theirs.step(step)["next"]
        observation, reward, terminated, truncated, _ = ours.step(action)
        np.testing.assert_array_equal(step["observation"].numpy(), observation)
        assert step["reward"].item() == np.float32(reward)
        assert step["terminated"].item() == terminated
        assert step["truncated"].item() == truncated
    assert observation[0] != 0.0
    theirs.close()
    ours.close()
