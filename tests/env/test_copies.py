"""Deep and unpickled copies are environments of their own, in the same state."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env

pytestmark = pytest.mark.slow

DISTURBED = {
    "push": {"along": (5.0, 9.0), "start_time": 0.05},
    "person": {"start_angle": 0.002, "duration": 0.5, "on": "door"},
    "stop": {"angle": 0.02, "duration": 0.1},
}


def unpickled(original: Any) -> Any:
    return pickle.loads(pickle.dumps(original))


@pytest.mark.parametrize(
    ("make", "id", "copied", "arguments"),
    [
        (gym.make, gplfd_env.ENVIRONMENT_ID, unpickled, {"disturbance": DISTURBED}),
        (gym.make, gplfd_env.GRIPPER_ENVIRONMENT_ID, copy.deepcopy, {}),
        (gym.make, gplfd_env.RL_ENVIRONMENT_ID, unpickled, {}),
        (gym.make_vec, gplfd_env.IMPEDANCE_ENVIRONMENT_ID, unpickled, {}),
        (gym.make_vec, gplfd_env.MOBILE_ENVIRONMENT_ID, copy.deepcopy, {}),
    ],
)
def test_a_copy_does_what_the_original_does_and_leaves_it_alone(
    make: Callable, id, copied, arguments, opened, draw_actions
):
    """Stiffness, delay, noise, stall clock, time limit and generator included."""
    env = opened(make(id, door="small", randomization="hard", **arguments))
    space = env.action_space
    env.reset(seed=3)
    for action in draw_actions(space, 30):
        env.step(action)
    twin, busy = copied(env), copied(env)
    for action in draw_actions(space, 10, seed=5):
        busy.step(action)
    busy.reset(options={"door": "large"})
    for seed in (1, 2):
        for action in draw_actions(space, 20, seed):
            first, second = env.step(action), twin.step(action)
            assert data_equivalence(first, second, exact=True)
        assert data_equivalence(env.reset(), twin.reset(), exact=True)
