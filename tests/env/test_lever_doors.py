"""A hand that turns the handle and opens the door, by itself and among others."""

import math
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD

pytestmark = pytest.mark.slow

LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53, "backset": 0.055}
KNOB = {
    "handle": "knob",
    "latch": "spring",
    "radius": 0.45,
    "handle_preload": 0.2,
    "handle_stiffness": 0.3,
}


def eased(share: float) -> float:
    s = min(max(share, 0.0), 1.0)
    return 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5


def unlatching(env: Any, degrees: float, turn: float = 0.8) -> list[np.ndarray]:
    """Turn the handle in 1.5 s, open in 4 s, and let the handle back meanwhile."""
    door = env.door_geometry
    poses = []
    for step in range(round(6.5 / CONTROL_PERIOD)):
        time = (step + 1) * CONTROL_PERIOD
        angle = math.radians(degrees) * eased((time - 1.5) / 4.0)
        back = eased((time - 3.5) / 1.5)
        poses.append(door.hand_poses(angle, turn * eased(time / 1.5) * (1.0 - back)))
    return poses


@pytest.mark.parametrize("fields", [LEVER, KNOB], ids=["lever", "knob"])
@pytest.mark.parametrize("side", ["right", "left"])
@pytest.mark.parametrize("swing", ["pull", "push"])
def test_a_hand_turns_the_handle_and_opens(
    fields: dict[str, Any], swing: str, side: str, make_env: Callable
) -> None:
    env = make_env({**fields, "hinge_side": side, "swing": swing})
    env.reset(seed=0)
    most = dict.fromkeys(("handle_angle", "bolt", "force", "slip"), 0.0)
    for pose in unlatching(env, 35.0):
        *_, info = env.step(pose)
        forces = [info[f"force_{a}"] for a in ("tangential", "radial", "vertical")]
        now = {**info, "force": math.hypot(*forces)}
        most = {name: max(now[name], value) for name, value in most.items()}
        if info["bolt"] < 0.004:
            assert info["door_angle"] < math.radians(0.5) or most["bolt"] > 0.006
    assert most["handle_angle"] > 0.7
    assert most["bolt"] > 0.011
    assert info["door_angle"] > math.radians(30.0)
    assert info["grasped"]
    assert info["handle_angle"] < 0.05
    assert info["bolt"] < 5e-4
    assert most["slip"] < 0.005
    assert most["force"] < 30.0


def test_a_pull_alone_does_not_open(make_env: Callable) -> None:
    env = make_env(LEVER)
    env.reset(seed=0)
    for pose in unlatching(env, 35.0, turn=0.0)[:300]:
        *_, info = env.step(pose)
        assert info["door_angle"] < math.radians(0.5)
    assert info["failure"] == ""
    for _ in range(60):
        *_, info = env.step(pose)
    assert info["failure"] == "latched"


@pytest.mark.bits
def test_many_doors_of_different_structure_are_single_ones(make_env: Callable) -> None:
    """Bit for bit, and after each has become another door."""
    doors = [LEVER, "small", KNOB, "office-closer-2", {**LEVER, "swing": "push"}]
    n = len(doors)
    envs = gym.make_vec(gplfd_env.ENVIRONMENT_ID, n, door=doors, base="mobile")
    alone = [make_env(door, base="mobile") for door in doors]
    for shift in range(3):
        turned = doors[shift:] + doors[:shift]
        many, infos = envs.reset(seed=3, options={"door": turned})
        ones = [
            env.reset(seed=3 + row, options={"door": turned[row]})
            for row, env in enumerate(alone)
        ]
        envs.action_space.seed(shift)
        for _ in range(30):
            for row, (observation, *_, info) in enumerate(ones):
                row_of = {name: values[row] for name, values in many.items()}
                assert data_equivalence(observation, row_of, exact=True)
                for name in ("handle_angle", "bolt", "closer_torque", "door_angle"):
                    assert info[name] == infos[name][row]
                assert np.array_equal(info["handle_pose"], infos["handle_pose"][row])
            actions = 0.02 * envs.action_space.sample()
            many, *_, infos = envs.step(actions)
            ones = [env.step(a) for env, a in zip(alone, actions, strict=True)]
    assert envs.qpos.shape[0] == n
    envs.close()


def test_a_reset_to_another_structure_is_as_a_new_environment(
    make_env: Callable,
) -> None:
    used, fresh = make_env("medium"), make_env(LEVER)
    used.reset(seed=0)
    used.step(used.action_space.sample())
    first = used.reset(seed=1, options={"door": LEVER})
    assert data_equivalence(first, fresh.reset(seed=1), exact=True)
    for pose in unlatching(fresh, 20.0)[:150]:
        assert data_equivalence(used.step(pose), fresh.step(pose), exact=True)
