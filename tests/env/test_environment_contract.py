"""Gymnasium's contract: checker, determinism, spaces, info, registration."""

import warnings
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.utils.env_match import check_environments_match

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DoorConfig
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.opening import SUCCESS_ANGLE

INFO_TYPES = {
    "door_angle": float,
    "door_velocity": float,
    "door_radius": float,
    "handle_pose": np.ndarray,
    "success": bool,
    "is_success": bool,
    "grasped": bool,
    "slip": float,
    "force_tangential": float,
    "force_radial": float,
    "force_vertical": float,
    "push_force": float,
    "person_force": float,
    "person_energy": float,
    "base_shift": float,
    "stop_force": float,
    "handle_angle": float,
    "bolt": float,
    "closer_torque": float,
    "capability": int,
    "base_pose": np.ndarray,
    "base_velocity": np.ndarray,
    "failure": str,
    "reason": str,
    "stage": str,
    "simulation_error": bool,
    "reward_terms": dict,
}

# The action is a pose in metres and radians: ±1 m and ±π/2 rad. Normalising it to
# ±1 would hide its units, so this one recommendation is declined.
DECLINED = "For Box action spaces, we recommend using a symmetric and normalized space"


def rollout(env: DoorOpeningEnv, seed: int, steps: int = 60) -> list[Any]:
    env.action_space.seed(seed)
    results: list[Any] = [env.reset(seed=seed)]
    for _ in range(steps):
        results.append(env.step(0.1 * env.action_space.sample()))
    return results


def assert_identical(first: Any, second: Any) -> None:
    assert data_equivalence(first, second, exact=True)


IDS = (
    gplfd_env.ENVIRONMENT_ID,
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID,
    gplfd_env.MOBILE_ENVIRONMENT_ID,
)


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize(
    "arguments",
    [
        {"grasp": "weld"},
        {"randomization": "hard", "reward": "sparse", "disturbance": "person"},
    ],
)
def test_checker_has_one_declined_recommendation_and_no_other_warning(
    arguments: dict[str, str], id: str, make_env: Callable
) -> None:
    """Rendering, human mode included, is checked in test_rendering.py."""
    env = make_env("medium", id=id, **arguments)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    messages = [str(warning.message) for warning in caught]
    assert len(messages) == 1
    assert DECLINED in messages[0]


@pytest.mark.parametrize(
    ("id", "randomization"), [*zip(IDS, ["none", "mild", "hard"], strict=True)]
)
def test_two_copies_match(id: str, randomization: str, make_env: Callable) -> None:
    door = {"preset": "large", "panel_mass": 30}
    first, second = (
        make_env(door, id=id, randomization=randomization) for _ in range(2)
    )
    check_environments_match(first, second, num_steps=50, info_comparison="equivalence")


@pytest.mark.parametrize("id", IDS)
def test_flat_and_normalised_it_passes_without_a_remark(
    id: str, make_env: Callable
) -> None:
    """Two wrappers of Gymnasium give learners a Box in and a Box of ±1 out."""
    flat = gym.wrappers.FlattenObservation(make_env(id=id, randomization="mild"))
    env = gym.wrappers.RescaleAction(flat, -1.0, 1.0)
    assert env.observation_space.shape == (39 if "Mobile" in id else 33,)
    assert np.all(env.action_space.high == 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It is wrapped, and that is the point.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped")
        check_env(env, skip_render_check=True)


def test_an_episode_leaves_nothing_behind(make_env: Callable) -> None:
    env = make_env("small")
    rollout(env, 1)
    env.data.xfrc_applied[:] = 3.0
    assert_identical(rollout(env, 2), rollout(make_env("small"), 2))


@pytest.mark.parametrize(
    "door",
    [
        "large",
        0.37,
        {"preset": "medium", "closer_preload": 2.0},
        DoorConfig(radius=0.6),
    ],
)
def test_door_chosen_at_reset_equals_door_chosen_at_make(
    door: Any, make_env: Callable
) -> None:
    env, fresh = make_env("small"), make_env(door)
    env.reset(seed=0)
    changed = env.reset(seed=5, options={"door": door})
    assert_identical(changed, fresh.reset(seed=5))
    command = handle_pose_on_arc(0.5, 0.05)
    for _ in range(30):
        result = env.step(command)
        assert_identical(result, fresh.step(command))
    assert result[4]["door_radius"] == env.door.radius
    # The choice lasts until the next one.
    assert env.reset()[1]["door_radius"] == fresh.door.radius


def test_model_and_data_are_the_simulation(make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    model = env.model
    env.step(np.zeros(6))
    assert env.data.time == pytest.approx(CONTROL_PERIOD)
    env.reset(options={"door": "large"})
    assert env.model is model, "views into model and data stay valid across doors"
    assert model.body("door").pos[2] == pytest.approx(-0.65)
    assert env.dt == CONTROL_PERIOD
    assert env.metadata["render_fps"] == 100


def test_info_has_the_same_keys_and_types_at_reset_and_step(make_env: Callable) -> None:
    env = make_env("medium")
    _, info = env.reset(seed=0)
    infos = [info, *(env.step(np.zeros(6))[4] for _ in range(3))]
    for info in infos:
        assert {key: type(value) for key, value in info.items()} == INFO_TYPES
        numbers = [v for v in info.values() if isinstance(v, float | np.ndarray)]
        assert all(np.isfinite(number).all() for number in numbers)
        assert info["handle_pose"].shape == (6,)
        assert set(info["reward_terms"]) == {"progress", "radial_force", "success"}
        assert info["success"] is info["is_success"]


def test_step_returns_python_scalars_inside_the_spaces(make_env: Callable) -> None:
    env = make_env("medium")
    observation, _ = env.reset(seed=0)
    assert observation in env.observation_space
    for _ in range(100):
        result = env.step(env.action_space.sample())
        observation, reward, terminated, truncated, _ = result
        assert observation in env.observation_space
        assert (type(reward), type(terminated), type(truncated)) == (float, bool, bool)
        if terminated:
            break


def test_returned_arrays_are_the_caller_s_own(make_env: Callable) -> None:
    """Kept data does not change later; spoiling it does not reach the simulation."""
    env, untouched = make_env("medium"), make_env("medium")
    command = handle_pose_on_arc(0.5, 0.1)
    kept = [env.reset(seed=0)[0]]
    untouched.reset(seed=0)
    copies = [{key: value.copy() for key, value in kept[0].items()}]
    for _ in range(10):
        observation, *_, info = env.step(command)
        kept.append(observation)
        copies.append({key: value.copy() for key, value in observation.items()})
        info["handle_pose"][:] = 99.0
        info["reward_terms"]["progress"] = 99.0
    assert_identical(kept, copies)
    for observation in kept:
        for value in observation.values():
            value[:] = 99.0
    for _ in range(10):
        untouched.step(command)
    assert_identical(env.step(command), untouched.step(command))


def test_rewards_are_the_sum_of_their_terms_and_tell_the_opening(
    make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env("medium")
    _, info = env.reset(seed=0)
    start, progress, bonus, previous = info["door_angle"], 0.0, 0.0, info
    for command in arc_commands(0.5):
        _, reward, terminated, _, info = env.step(command)
        terms = info["reward_terms"]
        assert reward == sum(terms.values())
        assert terms["radial_force"] == -1e-5 * abs(info["force_radial"])
        gain = info["door_angle"] - previous["door_angle"]
        assert terms["progress"] == pytest.approx(gain / SUCCESS_ANGLE, abs=1e-12)
        progress += terms["progress"]
        bonus += terms["success"]
        previous = info
        if terminated:
            break
    assert progress == pytest.approx((info["door_angle"] - start) / SUCCESS_ANGLE)
    assert progress > 1.0
    assert bonus == 1.0


def test_sparse_reward_is_one_in_success_and_nothing_else(
    make_env: Callable, arc_commands: Callable
) -> None:
    sparse, dense = make_env("small", reward="sparse"), make_env("small")
    _, info = sparse.reset(seed=0)
    dense.reset(seed=0)
    assert info["reward_terms"] == {"success": 0.0}
    rewards = []
    for command in arc_commands(0.35, duration=5.0):
        observation, reward, terminated, _, info = sparse.step(command)
        expected, dense_reward, *_ = dense.step(command)
        assert_identical(observation, expected)
        assert info["reward_terms"] == {"success": reward}
        assert type(reward) is float
        rewards.append(reward)
        if terminated:
            break
    assert dense_reward > 0.9
    assert rewards == [*(len(rewards) - 1) * [0.0], 1.0]


def test_success_takes_half_a_second_beyond_sixty_degrees(
    make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env("small")
    env.reset(seed=0)
    open_steps = 0
    for command in arc_commands(0.35):
        _, _, terminated, truncated, info = env.step(command)
        open_steps += info["door_angle"] >= np.radians(60.0)
        assert info["success"] is terminated
        if terminated:
            break
    assert terminated
    assert not truncated
    assert open_steps * CONTROL_PERIOD == pytest.approx(0.5)


def test_stopping_short_is_no_success(
    make_env: Callable, arc_commands: Callable
) -> None:
    """58° and wait: the door stalls, and nothing terminates."""
    env = make_env("small")
    env.reset(seed=0)
    for command in [*arc_commands(0.35, degrees=58.0, duration=4.0)] + 250 * [
        handle_pose_on_arc(0.35, np.radians(58.0))
    ]:
        _, _, terminated, truncated, info = env.step(command)
        assert not terminated
        assert not truncated
    assert not info["success"]
    assert info["failure"] == "stalled"


def test_opened_door_reports_its_handle_on_the_arc(
    make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env(0.42)
    env.reset(seed=0)
    for command in arc_commands(0.42, degrees=40.0, duration=3.0)[:300]:
        observation, *_, info = env.step(command)
    expected = handle_pose_on_arc(0.42, info["door_angle"])
    assert info["handle_pose"] == pytest.approx(expected, abs=1e-12)
    # The hand is on it, up to slip and the turn that friction allows about the bar.
    assert observation["ee_pose"][:3] == pytest.approx(expected[:3], abs=2e-3)
    assert info["slip"] == pytest.approx(
        np.linalg.norm(observation["ee_pose"][:3] - expected[:3]), abs=1e-4
    )
