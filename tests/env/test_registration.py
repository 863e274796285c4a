"""Registration: the id, its spec, and what `gym.make` wraps around it."""

import hashlib
import json
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.spatial.arc import handle_pose_on_arc


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
    assert spec.entry_point == f"gplfd_env.envs.door_opening:{name}Env"
    assert spec.vector_entry_point == f"gplfd_env.envs.vector:{name}VectorEnv"
    assert spec.max_episode_steps == 1500
    assert not spec.nondeterministic


FIRST = {
    "gplfd/DoorOpening-v0": "9be92ef08a05354b",
    "gplfd/DoorOpeningImpedance-v0": "825d1e907beddb17",
    "gplfd/DoorOpeningGripper-v0": "29de4787adaee984",
    "gplfd/DoorOpeningRL-v0": "0e134be4aad67931",
}
"""Ids of version 0, and the digest of an episode that commit e13d8bb gives, the last
one at which version 0 was the only one."""


@pytest.mark.bits
@pytest.mark.parametrize("id", FIRST)
def test_the_first_version_with_a_fixed_base_gives_the_numbers_it_gave(id: str) -> None:
    """Positions to 1e-6; Gymnasium says which version is newer."""
    with pytest.warns(DeprecationWarning, match="upgrading to version `v1`"):
        env = gym.make(id, door="small")
    with pytest.warns(DeprecationWarning, match="upgrading to version `v1`"):
        envs = gym.make_vec(id, door="small")
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
        positions.append(env.unwrapped.data.qpos.copy())  # type: ignore[attr-defined]
    rounded = np.round(positions, 6) + 0.0  # No -0.0.
    assert hashlib.sha256(rounded.tobytes()).hexdigest()[:16] == FIRST[id]
    env.close()
    envs.close()


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


def test_the_package_keeps_no_names_of_the_registration() -> None:
    assert not {"_id", "_name"} & vars(gplfd_env).keys()
