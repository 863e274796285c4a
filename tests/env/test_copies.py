"""Deep and unpickled copies are environments of their own, in the same state."""

import copy
import pickle
import subprocess
import sys
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
both_copiers = pytest.mark.parametrize("copied", COPIERS.values(), ids=COPIERS)


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


@both_copiers
def test_a_copy_has_a_simulation_of_its_own_that_may_diverge(copied, start_env):
    env = start_env()
    twin = copied(env)
    assert twin.data.model is twin.model is not env.model
    for name in ("xpos", "sensordata", "ncon"):
        assert np.array_equal(getattr(twin.data, name), getattr(env.data, name))
    twin.data.qvel[:] = np.nan
    rest = env.command.rest
    for each, diverged in (
        (twin, True),
        (twin, True),
        (copied(twin), True),
        (env, False),
    ):
        *_, truncated, info = each.step(rest)
        assert (truncated, info["simulation_error"]) == (diverged, diverged)


@both_copiers
def test_a_copy_made_before_the_first_reset(
    copied, make_env, make_vec, assert_they_go_on_alike
):
    for env in (make_env(), make_vec(2)):
        twin = copied(env)
        with pytest.raises(gym.error.ResetNeeded):
            twin.step(twin.action_space.sample())
        assert data_equivalence(twin.reset(seed=0), env.reset(seed=0), exact=True)
        assert_they_go_on_alike(env, twin, n=5)


@pytest.mark.needs("opengl")
@pytest.mark.parametrize(("copier", "n"), [("deepcopy", None), ("pickle", 2)])
def test_a_copy_draws_itself(copier, n, make_env, make_vec):
    look = {"render_mode": "rgb_array", "width": 64, "height": 48}
    env = make_env(**look) if n is None else make_vec(n, **look)
    env.reset(seed=0)
    before = np.array(env.render())
    twin = COPIERS[copier](env)
    assert np.array_equal(twin.render(), before)
    twin.reset(options={"door": "large"})
    assert not np.array_equal(twin.render(), before)
    assert np.array_equal(env.render(), before)
    twin.close()


@pytest.mark.parametrize(
    ("mode", "id", "numbers", "copier"),
    [
        (AutoresetMode.NEXT_STEP, POSE, "arrays", "deepcopy"),
        (AutoresetMode.SAME_STEP, IMPEDANCE, "floats", "pickle"),
        (AutoresetMode.DISABLED, MOBILE, "arrays", "pickle"),
        (AutoresetMode.DISABLED, POSE, "floats", "deepcopy"),
    ],
)
def test_a_copy_of_many(
    mode, id, numbers, copier, count_as, make_vec, draw_actions, assert_they_go_on_alike
):
    """One of three has ended, one has diverged, when the copy is made."""
    count_as(numbers)
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


@pytest.mark.parametrize("id", [IMPEDANCE, MOBILE])
def test_a_copy_in_another_process(id, start_env, draw_actions):
    env = start_env(id=id, randomization="mild")
    env.step(env.command.rest)
    program = (
        "import pickle, sys\n"
        "env, steps = pickle.load(sys.stdin.buffer)\n"
        "sys.stdout.buffer.write(pickle.dumps([env.step(step) for step in steps]))"
    )
    steps = draw_actions(env.action_space, 10)
    ran = subprocess.run(
        [sys.executable, "-c", program],
        input=pickle.dumps((env, steps)),
        capture_output=True,
        check=False,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr.decode()
    here = [env.step(step) for step in steps]
    assert data_equivalence(here, pickle.loads(ran.stdout), exact=True)
