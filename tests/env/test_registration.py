"""Registration: the id, its spec, and what `gym.make` wraps around it."""

import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env
from gplfd_env.door_opening import DoorOpeningEnv
from gplfd_env.task import handle_pose_on_arc


def test_time_limit_truncates_after_fifteen_seconds() -> None:
    env = gym.make(gplfd_env.ENVIRONMENT_ID, door="small")
    env.reset(seed=0)
    for step in range(1, 1501):
        _, _, terminated, truncated, info = env.step(np.zeros(6))
        assert (terminated, truncated) == (False, step == 1500)
    assert info["failure"] == "stalled"
    env.close()


@pytest.mark.parametrize("door", ["small", 0.42, {"radius": 0.4, "panel_mass": 8.0}])
def test_spec_survives_json(door: Any) -> None:
    env = gym.make(gplfd_env.ENVIRONMENT_ID, door=door, grasp="weld")
    assert env.spec is not None
    restored = gym.envs.registration.EnvSpec.from_json(env.spec.to_json())
    assert json.loads(env.spec.to_json())["kwargs"]["door"] == door
    twin = gym.make(restored)
    for made in (env, twin):
        assert isinstance(made.unwrapped, DoorOpeningEnv)
    assert env.unwrapped.door == twin.unwrapped.door  # type: ignore[attr-defined]
    assert twin.unwrapped.model.neq == 2  # type: ignore[attr-defined]
    env.close()
    twin.close()


def test_make_by_module_and_id_needs_no_import(tmp_path: Path) -> None:
    program = (
        "import gymnasium as gym\n"
        "env = gym.make('gplfd_env:gplfd/DoorOpening-v1', door='large')\n"
        "observation, info = env.reset(seed=0)\n"
        "print(env.spec.id, info['door_radius'])\n"
    )
    result = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert result.stderr == ""
    assert result.stdout.split() == ["gplfd/DoorOpening-v1", "0.65"]


@pytest.mark.parametrize(
    ("id", "name"),
    [
        ("gplfd/DoorOpening-v1", "DoorOpening"),
        ("gplfd/DoorOpeningImpedance-v1", "DoorOpeningImpedance"),
    ],
)
def test_specs_of_the_registered_ids(id: str, name: str) -> None:
    spec = gym.spec(id)
    assert spec.entry_point == f"gplfd_env.door_opening:{name}Env"
    assert spec.vector_entry_point == f"gplfd_env.vector:{name}VectorEnv"
    assert spec.max_episode_steps == 1500
    assert not spec.nondeterministic


FIRST = [
    id.replace("-v1", "-v0")
    for id in (
        gplfd_env.ENVIRONMENT_ID,
        gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
        gplfd_env.GRIPPER_ENVIRONMENT_ID,
        gplfd_env.RL_ENVIRONMENT_ID,
    )
]


@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize("id", FIRST)
def test_the_first_version_stands_still_as_the_second_does(
    id: str, make: Callable
) -> None:
    """Bit for bit; Gymnasium says which version is newer."""
    with pytest.warns(DeprecationWarning, match="upgrading to version `v1`"):
        old = make(id, door="small")
    new = make(id.replace("-v0", "-v1"), door="small")
    assert old.action_space == new.action_space
    rng = np.random.default_rng(0)
    space = old.action_space
    results = [[env.reset(seed=1)[0] for env in (old, new)]]
    for _ in range(20):
        action = rng.uniform(0.1 * space.low, 0.1 * space.high).astype(space.dtype)
        results.append([env.step(action)[0] for env in (old, new)])
    for one, other in results:
        assert data_equivalence(one, other, exact=True)
    old.close()
    new.close()


@pytest.mark.filterwarnings("ignore:.*upgrading to version:DeprecationWarning")
@pytest.mark.parametrize("make", [gym.make, gym.make_vec])
@pytest.mark.parametrize("id", FIRST)
def test_the_first_version_refuses_to_drive(id: str, make: Callable) -> None:
    with pytest.raises(ValueError, match=f'mobile" needs {id.replace("-v0", "-v1")}:'):
        make(id, base="mobile")


@pytest.mark.filterwarnings("ignore:.*upgrading to version:DeprecationWarning")
def test_an_id_that_always_drives_has_no_first_version() -> None:
    with pytest.raises(gym.error.DeprecatedEnv, match="DoorOpeningMobile-v1"):
        gym.make("gplfd/DoorOpeningMobile-v0")


def test_async_vector_environments_step(make_env: Callable) -> None:
    """Copies in other processes give what a single environment gives."""
    envs = gym.make_vec(
        gplfd_env.ENVIRONMENT_ID, 2, vectorization_mode="async", door="small"
    )
    env = make_env("small")
    try:
        expected, _ = env.reset(seed=0)
        batch, _ = envs.reset(seed=0)
        command = handle_pose_on_arc(0.35, 0.05)
        for _ in range(3):
            for key, value in expected.items():
                assert np.array_equal(batch[key], np.stack([value, value]))
            batch, *_ = envs.step(np.stack([command, command]))
            expected, *_ = env.step(command)
    finally:
        envs.close()
