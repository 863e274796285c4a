"""Deep and unpickled copies are environments of their own, in the same state."""

import copy
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import gplfd_env

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("scratch_folder")]

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID
MOBILE, GRIPPER = gplfd_env.MOBILE_ENVIRONMENT_ID, gplfd_env.GRIPPER_ENVIRONMENT_ID
DISTURBED = {
    "push": {"along": (5.0, 9.0), "start_time": 0.05},
    "person": {"start_angle": 0.002, "duration": 0.5, "on": "door"},
    "stop": {"angle": 0.02, "duration": 0.1},
    "bump": {"forward": 0.01, "duration": 0.6},
    "breakaway": {"stiction": 2.0, "seal": 1.0},
}
COPIERS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda original: pickle.loads(pickle.dumps(original)),
}


@pytest.fixture
def assert_they_go_on_alike(draw_actions: Callable) -> Callable:
    def check(*envs: Any, n: int = 30, seed: int = 1) -> None:
        for action in draw_actions(envs[0].action_space, n, seed):
            first, *others = [each.step(action.copy()) for each in envs]
            for other in others:
                assert data_equivalence(first, other, exact=True)

    return check


@pytest.mark.parametrize(
    ("id", "copier", "arguments"),
    [
        (POSE, "deepcopy", {"randomization": "hard"}),
        (POSE, "pickle", {"disturbance": DISTURBED}),
        (IMPEDANCE, "pickle", {"randomization": "hard"}),
        (IMPEDANCE, "deepcopy", {"disturbance": DISTURBED}),
        (MOBILE, "deepcopy", {"randomization": "hard"}),
        (GRIPPER, "deepcopy", {"randomization": "mild", "start": "approach"}),
        (gplfd_env.RL_ENVIRONMENT_ID, "deepcopy", {"randomization": "hard"}),
        (gplfd_env.RL_ENVIRONMENT_ID, "pickle", {"randomization": "hard"}),
    ],
)
def test_a_copy_does_what_the_original_does_and_leaves_it_alone(
    id, copier, arguments, opened, draw_actions, assert_they_go_on_alike
):
    """Stiffness, delay, noise, stall clock, time limit and generator included."""
    env, untouched = (opened(gym.make(id, door="small", **arguments)) for _ in range(2))
    copied = COPIERS[copier]
    for each in (env, untouched):
        each.reset(seed=3)
        for action in draw_actions(env.action_space, 30):
            each.step(action)
    twin, busy = copied(env), copied(env)
    for action in draw_actions(env.action_space, 10, seed=5):
        busy.step(action)
    large = {"door": "large"}
    busy.reset(options=large)
    assert_they_go_on_alike(env, untouched, twin)
    assert data_equivalence(env.reset(), twin.reset(), exact=True)
    assert_they_go_on_alike(env, twin, seed=2)
    changed = (each.reset(options=dict(large)) for each in (env, twin))
    assert data_equivalence(*changed, exact=True)
    assert_they_go_on_alike(env, twin, copied(twin), seed=3)


@pytest.mark.parametrize(
    ("mode", "id", "copier"),
    [
        (AutoresetMode.NEXT_STEP, POSE, "deepcopy"),
        (AutoresetMode.SAME_STEP, IMPEDANCE, "pickle"),
        (AutoresetMode.DISABLED, MOBILE, "pickle"),
        (AutoresetMode.DISABLED, POSE, "deepcopy"),
    ],
)
def test_a_copy_of_many(
    mode, id, copier, make_vec, draw_actions, assert_they_go_on_alike
):
    """One of three has ended, one has diverged, when the copy is made."""
    copied = COPIERS[copier]
    envs = make_vec(3, id=id, randomization="hard", autoreset_mode=mode)
    envs.reset(seed=5)
    steps = draw_actions(envs.single_action_space, 120).reshape(40, 3, -1)
    steps[:, 0, 0] = 0.6  # tears the hand off
    ended = np.zeros(3, dtype=bool)
    for step, action in enumerate(steps):
        if step == 38:
            envs._batch.qpos_of(1)[:] = np.nan
        *_, terminations, truncations, _ = envs.step(action)
        ended |= terminations | truncations
    assert ended.tolist() == [True, True, False]
    twin = copied(envs)
    assert_they_go_on_alike(envs, twin)
    assert data_equivalence(envs.reset(), twin.reset(), exact=True)
    assert_they_go_on_alike(envs, twin, copied(twin), seed=2)
    twin._batch.qpos_of(2)[:] = np.nan
    assert twin.step(steps[0])[3][2]
    assert not envs.step(steps[0])[3][2]
