"""Registration: the ids, their specs and versions, and what `gym.make` needs."""

import hashlib
import pickle
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID
RL = gplfd_env.RL_ENVIRONMENT_ID


@pytest.mark.parametrize(
    ("id", "arguments"),
    [
        (POSE, {"door": {"radius": 0.4, "panel_mass": 8.0}, "grasp": "weld"}),
        (POSE, {"door": "small", "randomization": "hard", "reward": "sparse"}),
        (IMPEDANCE, {"randomization": {"preset": "mild", "radius": [0.35, 0.6]}}),
        (RL, {"door": 0.42}),
        (POSE, {"disturbance": {"preset": "push", "bump": {"left": [0.0, 0.01]}}}),
    ],
)
def test_spec_survives_json_and_pickle(id, arguments, opened):
    env = opened(gym.make(id, **arguments))
    first = env.reset(seed=9)
    for spec in (
        EnvSpec.from_json(env.spec.to_json()),
        pickle.loads(pickle.dumps(env.spec)),
    ):
        assert spec.kwargs == env.spec.kwargs
        twin = opened(gym.make(spec))
        assert str(twin) == str(env)
        assert data_equivalence(twin.reset(seed=9), first, exact=True)
        assert twin.unwrapped.variation == env.unwrapped.variation
        assert twin.unwrapped.model.neq == env.unwrapped.model.neq


FIRST = {
    "gplfd/DoorOpening-v1": "9be92ef08a05354b",
    "gplfd/DoorOpeningImpedance-v1": "825d1e907beddb17",
    "gplfd/DoorOpeningGripper-v1": "29de4787adaee984",
    "gplfd/DoorOpeningRL-v1": "0e134be4aad67931",
}
"""Ids, and the digest of an episode that commit e13d8bb gives."""


@pytest.mark.bits
@pytest.mark.parametrize("id", FIRST)
def test_a_fixed_base_gives_the_numbers_it_gave(id, opened):
    """Positions to 1e-6."""
    env = opened(gym.make(id, door="small"))
    envs = opened(gym.make_vec(id, door="small"))
    space: Any = env.action_space
    assert envs.single_action_space == space
    env.reset(seed=1)
    envs.reset(seed=1)
    rng = np.random.default_rng(0)
    positions = []
    for _ in range(20):
        action = rng.uniform(0.1 * space.low, 0.1 * space.high).astype(space.dtype)
        _, reward, *_ = env.step(action)
        _, rewards, *_ = envs.step(action[None])
        assert rewards.tolist() == [reward]
        positions.append(env.unwrapped.data.qpos.copy())
    rounded = np.round(positions, 6) + 0.0  # No -0.0.
    assert hashlib.sha256(rounded.tobytes()).hexdigest()[:16] == FIRST[id]
