"""``gplfd/DoorOpeningRL-v1``: the same episodes, otherwise told, and what they earn."""

import copy
import math
import pickle
import re
import warnings
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.vector import AutoresetMode, SyncVectorEnv

import gplfd_env
from gplfd_env.wrappers import (
    LIMITS,
    FlatObservation,
    GentleReward,
    RelativeAction,
    VectorFlatObservation,
    VectorRelativeAction,
    action_of,
    command_of,
)
from gplfd_env.wrappers.gentle_reward import FORCE_SCALE, SLIP_SCALE

pytestmark = pytest.mark.slow

ID = gplfd_env.RL_ENVIRONMENT_ID
PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")
LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53, "backset": 0.055}
DOORS: list[dict[str, Any]] = [
    {"door": "small", "randomization": "hard", "disturbance": "person"},
    {"door": "heavy"},
    {"door": LEVER},
    {"door": {**LEVER, "swing": "push", "hinge_side": "left"}, "base": "mobile"},
    {"door": "office-closer-2", "base": "mobile", "randomization": "mild"},
]
everywhere = pytest.mark.parametrize("arguments", DOORS)


def drawn_actions(n: int, seed: int = 0) -> np.ndarray:
    """Return actions that change slowly, some of them beyond what is allowed."""
    rng = np.random.default_rng(seed)
    steps = rng.normal(0.0, 0.2, (n, 6)).cumsum(axis=0)
    return steps.astype(np.float32)


# --- The same episode ----------------------------------------------------------------


@pytest.mark.bits
@everywhere
def test_the_same_commands_give_the_same_episode_under_both_ids(
    arguments: dict[str, Any], make_rl: Callable
) -> None:
    wrapped = make_rl(**arguments)
    plain = gym.make(gplfd_env.ENVIRONMENT_ID, **arguments)
    observation, info = plain.reset(seed=4)
    flat, said = wrapped.reset(seed=4)
    own = ("reward_terms", "peak_force", "peak_slip", "return")
    for action in drawn_actions(80):
        expected = gym.spaces.flatten(plain.observation_space, observation)
        assert np.array_equal(flat, expected.astype(np.float32))
        assert flat.dtype == np.float32
        assert flat in wrapped.observation_space
        for key in own:
            said.pop(key), info.pop(key, None)
        assert data_equivalence(said, info, exact=True)
        command = command_of(action, observation["ee_pose"])
        observation, _, *ended, info = plain.step(command)
        flat, reward, *also_ended, said = wrapped.step(action)
        assert also_ended == ended
        assert type(reward) is float
    inner, other = wrapped.unwrapped, plain.unwrapped
    assert np.array_equal(inner.data.qpos, other.data.qpos)  # type: ignore[attr-defined]
    plain.close()


def test_a_command_is_the_hand_plus_the_limits() -> None:
    hand = np.array([0.1, 0.0, -0.2, 0.0, 0.4, 0.0])
    command = command_of([1.0, -0.5, 0.0, 0.0, 3.0, 0.0], hand)
    metres, radians = LIMITS
    offset = np.array([metres, -0.5 * metres, 0.0, 0.0, radians, 0.0])
    assert command == pytest.approx(hand + offset, abs=1e-15)
    assert action_of(command, hand)[:4] == pytest.approx([1.0, -0.5, 0.0, 0.0])
    assert action_of(hand, hand).tolist() == 6 * [0.0]


def test_zero_lets_the_hand_rest(make_rl: Callable) -> None:
    env = make_rl(door="medium")
    env.reset(seed=0)
    for _ in range(300):
        *_, info = env.step(np.zeros(6, np.float32))
    assert abs(info["door_angle"]) < math.radians(0.2)
    assert info["peak_force"] < 1.0


@pytest.mark.bits
@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("randomization", ["none", "hard"])
def test_many_are_single_ones_bit_for_bit(
    mode: AutoresetMode, randomization: str
) -> None:
    doors = ["small", 0.42, LEVER, "heavy"]
    arguments = {"max_episode_steps": 40, "randomization": randomization}

    def single(door: Any) -> Callable[[], gym.Env]:
        return lambda: gym.make(ID, door=door, **arguments)

    model = SyncVectorEnv([single(door) for door in doors], autoreset_mode=mode)
    ours = gym.make_vec(ID, 4, door=doors, autoreset_mode=mode, **arguments)
    assert ours.single_observation_space == model.single_observation_space
    assert ours.action_space == model.action_space
    actions = np.stack([drawn_actions(95, row) for row in range(4)], axis=1)
    actions[:, 0] = [1, 1, 1, 0, 0, 0]  # off the handle
    assert_same(ours.reset(seed=5), model.reset(seed=5))
    alone = 0
    for action in actions:
        result = ours.step(action)
        assert_same(result, model.step(action))
        ended = result[2] | result[3]
        alone += 0 < ended.sum() < 4
        if mode is AutoresetMode.DISABLED and ended.any():
            masks = ({"reset_mask": ended.copy()} for _ in range(2))
            assert_same(
                ours.reset(options=next(masks)), model.reset(options=next(masks))
            )
    assert alone > 0
    ours.close()
    model.close()


def assert_same(ours: Any, model: Any) -> None:
    *ours, said = ours
    *model, expected = model
    assert data_equivalence(ours, model, exact=True)
    assert_same_info(said, expected)


def assert_same_info(said: Any, expected: Any) -> None:
    assert said.keys() == expected.keys()
    for key, value in expected.items():
        if isinstance(value, dict):
            assert_same_info(said[key], value)
        elif key.startswith("_"):
            assert np.array_equal(said[key], value), key
        else:
            rows = expected[f"_{key}"]
            assert data_equivalence(said[key][rows], value[rows], exact=True), key


# --- Contracts -----------------------------------------------------------------------


@everywhere
def test_gymnasium_s_checker_is_silent(
    arguments: dict[str, Any], make_rl: Callable
) -> None:
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It is wrapped, and that is the point.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped")
        check_env(make_rl(**arguments), skip_render_check=True)


@pytest.mark.parametrize(
    "copied", [copy.deepcopy, lambda e: pickle.loads(pickle.dumps(e))]
)
def test_a_copy_goes_on_like_the_original(copied: Callable, make_rl: Callable) -> None:
    env = make_rl(door="small", randomization="hard")
    env.reset(seed=1)
    for action in drawn_actions(20):
        env.step(action)
    twin = copied(env)
    for action in drawn_actions(20, seed=1):
        assert data_equivalence(env.step(action), twin.step(action), exact=True)


def test_the_spec_makes_it_again(make_rl: Callable) -> None:
    env = make_rl(door=0.42)
    again = gym.make(gym.envs.registration.EnvSpec.from_json(env.spec.to_json()))
    assert str(again) == str(env)
    assert data_equivalence(env.reset(seed=3), again.reset(seed=3), exact=True)
    again.close()


def test_what_is_returned_is_the_caller_s_own() -> None:
    ours, other = (gym.make_vec(ID, 2, door="small") for _ in range(2))
    for envs in (ours, other):
        envs.reset(seed=0)
    for action in drawn_actions(20):
        both = np.stack([action, action])
        result, expected = ours.step(both), other.step(both)
        assert data_equivalence(result, expected, exact=True)
        observations, rewards, *_, infos = result
        for array in (
            observations,
            rewards,
            infos["return"],
            infos["peak_force"],
            infos["slip"],
            infos["door_angle"],
            *infos["reward_terms"].values(),
        ):
            array[:] = 1.0
    ours.close()
    other.close()


def test_a_reward_of_another_kind_is_refused() -> None:
    for make in (gym.make, gym.make_vec):
        with pytest.raises(ValueError, match=r"has a reward of its own.*got reward='d"):
            make(ID, reward="dense")


@pytest.mark.parametrize(
    ("action", "message"),
    [
        (np.zeros(5), r"numbers of shape \(6,\).*relative to the hand.*got array"),
        ("pull", r"numbers of shape \(6,\).*got 'pull'"),
        (np.full(6, np.nan), "the action must be finite"),
        (np.full(6, np.inf), "the action must be finite"),
    ],
)
def test_a_wrong_action_is_named(action: Any, message: str, make_env: Callable) -> None:
    env = RelativeAction(make_env())
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(6))
    env.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        env.step(action)


def test_many_wrong_actions_are_named(make_vec: Callable) -> None:
    envs = VectorRelativeAction(make_vec(2))
    with pytest.raises(gym.error.ResetNeeded):
        envs.step(np.zeros((2, 6)))
    envs.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(2, 6\)"):
        envs.step(np.zeros(6))
    with pytest.raises(ValueError, match="must be finite"):
        envs.step(np.full((2, 6), np.nan))


def test_what_cannot_be_wrapped_is_refused(
    make_env: Callable, make_vec: Callable
) -> None:
    with pytest.raises(ValueError, match="whose action is a pose"):
        RelativeAction(make_env(id=gplfd_env.IMPEDANCE_ENVIRONMENT_ID))
    with pytest.raises(ValueError, match="above zero, got"):
        VectorRelativeAction(make_vec(2), limits=(0.0, 0.1))
    with pytest.raises(ValueError, match="a dictionary of vectors"):
        FlatObservation(FlatObservation(make_env()))
    with pytest.raises(ValueError, match="a dictionary of vectors"):
        VectorFlatObservation(VectorFlatObservation(make_vec(2)))


def test_a_few_centimetres_can_be_chosen(make_env: Callable) -> None:
    env = GentleReward(RelativeAction(make_env("medium"), limits=(0.01, 0.05)))
    observation, _ = env.reset(seed=0)
    twin = make_env("medium")
    twin.reset(seed=0)
    pose = observation["ee_pose"] + np.repeat([0.01, 0.05], 3)
    expected, *_ = twin.step(pose)
    observation, *_ = env.step(np.ones(6))
    assert data_equivalence(observation, expected, exact=True)


def test_the_page_says_what_the_spaces_are(make_rl: Callable) -> None:
    section = PAGE.split("\n## Learners\n")[1].split("\n## ")[0]
    rows = re.findall(r"^\| (\d+)-?(\d*) \| `(\w+)`", section, re.MULTILINE)
    inner = make_rl().unwrapped.observation_space
    told = {name: int(last or first) - int(first) + 1 for first, last, name in rows}
    assert told == {name: box.shape[0] for name, box in inner.spaces.items()}
    assert list(told) == list(inner.spaces)
    metres, radians = LIMITS
    for said in (
        f"{metres:g} m",
        f"{radians:g} rad",
        f"{FORCE_SCALE:g} N",
        f"{1e3 * SLIP_SCALE:g} mm",
    ):
        assert said in section
