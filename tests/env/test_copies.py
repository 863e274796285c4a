"""Deep and unpickled copies are environments of their own, in the same state."""

import copy
import pickle
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode

import gplfd_env

pytestmark = pytest.mark.slow

IDS = (
    gplfd_env.ENVIRONMENT_ID,
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
    gplfd_env.MOBILE_ENVIRONMENT_ID,
)
COPIERS: dict[str, Callable[[Any], Any]] = {
    "deepcopy": copy.deepcopy,
    "pickle": lambda original: pickle.loads(pickle.dumps(original)),
}

both_ids = pytest.mark.parametrize("id", IDS)
both_copiers = pytest.mark.parametrize("copied", COPIERS.values(), ids=COPIERS)


@pytest.fixture(autouse=True)
def _log_file_goes_to_a_scratch_folder(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """MuJoCo reports what diverges to a file in the working directory."""
    monkeypatch.chdir(tmp_path)


def actions(space: gym.spaces.Box, n: int, seed: int) -> np.ndarray:
    """Return small motions; stiffnesses, if commanded, from the whole range."""
    rng = np.random.default_rng(seed)
    drawn = rng.uniform(space.low, space.high, (n, *space.shape))
    drawn[..., :6] *= 0.03
    return drawn


def assert_they_go_on_alike(*envs: Any, n: int = 60, seed: int = 1) -> None:
    for action in actions(envs[0].action_space, n, seed):
        first, *others = [each.step(action.copy()) for each in envs]
        for other in others:
            assert data_equivalence(first, other, exact=True)


@pytest.mark.parametrize(
    ("copied", "wrapped"), [*zip(COPIERS.values(), [True, False], strict=True)]
)
@both_ids
def test_a_copy_does_what_the_original_does(
    wrapped: bool, id: str, copied: Callable, make_env: Callable
) -> None:
    """Commands, delay, noise, stall clock, time limit and generator included."""
    arguments = {"door": "small", "randomization": "hard"}
    env = gym.make(id, **arguments) if wrapped else make_env(id=id, **arguments)
    env.reset(seed=3)
    for action in actions(env.action_space, 40, seed=0):
        env.step(action)
    twin = copied(env)
    assert_they_go_on_alike(env, twin)
    assert data_equivalence(env.reset(), twin.reset(), exact=True)
    assert_they_go_on_alike(env, twin, seed=2)
    options = {"door": "large"}
    assert data_equivalence(
        env.reset(options=options), twin.reset(options=options), exact=True
    )
    assert_they_go_on_alike(env, twin, copied(twin), seed=3)
    env.close()


@both_copiers
@both_ids
def test_a_copy_leaves_the_original_alone(
    id: str, copied: Callable, make_env: Callable
) -> None:
    env, untouched = make_env(id=id), make_env(id=id)
    env.reset(seed=0)
    untouched.reset(seed=0)
    twin = copied(env)
    for action in actions(env.action_space, 20, seed=0):
        twin.step(action)
    twin.reset(options={"door": "large"})
    assert_they_go_on_alike(env, untouched)


@both_copiers
def test_a_copy_is_as_soft_as_commanded(copied: Callable, make_env: Callable) -> None:
    """3 cm at 20 N/m are less than the hinge's friction, at 2000 N/m much more."""
    env = make_env(id=gplfd_env.IMPEDANCE_ENVIRONMENT_ID)
    env.reset(seed=0)
    twin = copied(env)
    pull = np.array([0.03, *5 * [0.0]])
    for _ in range(100):
        *_, soft = twin.step(np.concatenate([pull, env.action_space.low[6:]]))
        *_, stiff = env.step(np.concatenate([pull, env.action_space.high[6:]]))
    assert np.degrees(soft["door_angle"]) < 0.1
    assert np.degrees(stiff["door_angle"]) > 2.0
    assert twin.model.actuator("servo_x").gainprm[0] == 20.0
    assert env.model.actuator("servo_x").gainprm[0] == 2000.0


@both_copiers
@both_ids
def test_a_copy_reports_that_it_diverged(
    id: str, copied: Callable, make_env: Callable
) -> None:
    env = make_env(id=id)
    env.reset(seed=0)
    twin = copied(env)
    twin.data.qvel[:] = np.nan
    for _ in range(2):
        *_, truncated, info = twin.step(env.command.rest)
        assert (truncated, info["simulation_error"]) == (True, True)
    assert copied(twin).step(env.command.rest)[-1]["simulation_error"]
    *_, truncated, info = env.step(env.command.rest)
    assert (truncated, info["simulation_error"]) == (False, False)


@both_copiers
def test_model_and_data_of_a_copy_belong_together(
    copied: Callable, make_env: Callable
) -> None:
    env = make_env()
    env.reset(seed=0)
    twin = copied(env)
    assert twin.data.model is twin.model
    assert twin.model is not env.model
    assert np.array_equal(twin.data.xpos, env.data.xpos)
    assert np.array_equal(twin.data.sensordata, env.data.sensordata)
    assert twin.data.ncon == env.data.ncon


@both_copiers
def test_a_copy_made_before_the_first_reset(
    copied: Callable, make_env: Callable, make_vec: Callable
) -> None:
    for env in (make_env(), make_vec(2)):
        twin = copied(env)
        with pytest.raises(gym.error.ResetNeeded):
            twin.step(twin.action_space.sample())
        assert data_equivalence(twin.reset(seed=0), env.reset(seed=0), exact=True)
        assert_they_go_on_alike(env, twin, n=5)


@pytest.mark.needs("opengl")
@pytest.mark.parametrize(("copier", "n"), [("deepcopy", None), ("pickle", 2)])
def test_a_copy_draws_itself(
    copier: str, n: int | None, make_env: Callable, make_vec: Callable
) -> None:
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


@both_copiers
@pytest.mark.parametrize(
    ("mode", "id", "arrays_from"), [*zip(AutoresetMode, IDS, (2, 100, 2), strict=True)]
)
def test_a_copy_of_many(
    mode: AutoresetMode,
    id: str,
    arrays_from: int,
    copied: Callable,
    make_vec: Callable,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """One of three has ended, one has diverged, when the copy is made."""
    monkeypatch.setattr("gplfd_env.task.episodes.MANY", arrays_from)
    envs = make_vec(3, id=id, randomization="hard", autoreset_mode=mode)
    envs.reset(seed=5)
    steps = actions(envs.action_space, 40, seed=0)
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
    (step,) = actions(envs.action_space, 1, seed=4)
    assert twin.step(step)[3][2]
    assert not envs.step(step)[3][2]


@both_ids
def test_a_copy_in_another_process(id: str, make_env: Callable) -> None:
    env = make_env(id=id, randomization="mild")
    env.reset(seed=0)
    env.step(env.command.rest)
    program = (
        "import pickle, sys\n"
        "env, steps = pickle.load(sys.stdin.buffer)\n"
        "sys.stdout.buffer.write(pickle.dumps([env.step(step) for step in steps]))"
    )
    steps = actions(env.action_space, 10, seed=0)
    ran = subprocess.run(
        [sys.executable, "-c", program],
        input=pickle.dumps((env, steps)),
        capture_output=True,
        check=False,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr.decode()
    there = pickle.loads(ran.stdout)
    here = [env.step(step) for step in steps]
    assert data_equivalence(here, there, exact=True)
