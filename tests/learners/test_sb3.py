"""Stable-Baselines3 on these environments; needs the extra sb3, run by .ci/learners."""

import os
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env

if os.environ.get("GPLFD_REQUIRE_ALL") != "1":
    pytest.importorskip("stable_baselines3", reason="needs pip install '.[sb3]'")

import torch
from stable_baselines3 import PPO
from stable_baselines3.common.env_checker import check_env
from stable_baselines3.common.vec_env import DummyVecEnv, VecMonitor

from gplfd_env.wrappers.sb3 import SB3VecEnv, make_sb3

POSE, RL = gplfd_env.ENVIRONMENT_ID, gplfd_env.RL_ENVIRONMENT_ID
LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53}
DOORS = ["small", LEVER, "heavy"]
LIMIT = 60


def drawn_actions(n: int, seed: int = 0) -> np.ndarray:
    """Return actions that pull the first hand off its handle and spare the others."""
    rng = np.random.default_rng(seed)
    actions = rng.uniform(-1.0, 1.0, (n, 3, 6)).astype(np.float32)
    actions[:, 0] = [1, 1, 1, 0, 0, 0]
    actions[:, 1:] *= 0.2
    return actions


@pytest.fixture(params=["none", "hard"])
def pair(request: pytest.FixtureRequest) -> Any:
    """Ours, and Stable-Baselines3's own of single environments."""
    arguments = {"randomization": request.param, "max_episode_steps": LIMIT}
    ours = make_sb3(3, door=DOORS, **arguments)
    model = DummyVecEnv(
        [lambda door=door: gym.make(RL, door=door, **arguments) for door in DOORS]
    )
    yield ours, model
    ours.close()
    model.close()


def test_it_is_stable_baselines3_s_own_bit_for_bit(pair):
    """As the vector environment is; see tests/env/test_one_and_many.py."""
    for envs in pair:
        envs.seed(4)
    ours, model = pair
    first, expected = ours.reset(), model.reset()
    assert np.array_equal(first, expected)
    assert first.dtype == expected.dtype
    assert data_equivalence(ours.reset_infos, model.reset_infos, exact=True)
    cut = []
    for actions in drawn_actions(2 * LIMIT + 5):
        result, wanted = ours.step(actions), model.step(actions)
        assert data_equivalence(result, wanted, exact=True)
        assert data_equivalence(ours.reset_infos, model.reset_infos, exact=True)
        *_, dones, infos = result
        for done, info in zip(dones, infos, strict=True):
            assert ("terminal_observation" in info) is bool(done)
            cut += [info["TimeLimit.truncated"]] if done else []
    assert True in cut
    assert False in cut, "some must end by themselves"


def test_stable_baselines3_s_checker_is_silent():
    env = gym.make(RL, door=LEVER)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(env)
    env.close()


def test_learners_learn_from_it_and_equal_seeds_learn_equally():
    weights = []
    for _ in range(2):
        envs = VecMonitor(make_sb3(2, door="small", max_episode_steps=30))
        model = PPO("MlpPolicy", envs, n_steps=32, batch_size=32, n_epochs=2, seed=7)
        model.learn(128)
        assert model.ep_info_buffer[0]["l"] == 30
        weights.append(torch.cat([p.flatten() for p in model.policy.parameters()]))
        envs.close()
    assert torch.equal(*weights)


def test_seeds_and_options_are_used_once():
    envs = make_sb3(2, door="small", randomization="hard")
    envs.seed(5)
    envs.set_options({"door": ["small", 0.42]})
    envs.reset()
    assert envs.unwrapped.env.unwrapped.np_random_seed == (5, 6)
    radii = [info["door_radius"] for info in envs.reset_infos]
    first = envs.get_attr("variation")
    assert radii == [each.door.radius for each in first]
    envs.reset()
    assert envs.get_attr("variation") != first
    envs.close()


def test_what_it_does_not_have_is_said():
    envs = make_sb3(3, door=DOORS)
    envs.reset()
    geometries = envs.get_attr("door_geometry", indices=[0, 2])
    assert [geometry.radius for geometry in geometries] == [0.35, 0.5]
    assert not envs.has_attr("spoons")
    with pytest.raises(AttributeError, match="without attributes or methods"):
        envs.set_attr("x", 1)
    with pytest.raises(AttributeError, match="DummyVecEnv"):
        envs.env_method("reset")
    with pytest.raises(ValueError, match=r'"SameStep", not.*NEXT_STEP'):
        SB3VecEnv(gym.make_vec(RL, 2))
    envs.close()
