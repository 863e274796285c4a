"""``gplfd/DoorOpeningRL-v1``: the same episodes, otherwise told, and what they earn."""

import math
import warnings
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from hypothesis import given
from hypothesis import strategies as st

import gplfd_env
from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.wrappers import (
    LIMITS,
    FlatObservation,
    RelativeAction,
    VectorRelativeAction,
    action_of,
    command_of,
)
from gplfd_env.wrappers.gentle_reward import FORCE_SCALE, SLIP_SCALE, Score

pytestmark = pytest.mark.slow

LEVER = dict(handle="lever", latch="spring", radius=0.53, leaf={"backset": 0.055})
everywhere = pytest.mark.parametrize(
    "arguments",
    [
        {"door": "small", "randomization": "hard", "disturbance": "person"},
        {"door": "heavy", "start": "approach"},
        {"door": LEVER},
        {"door": {**LEVER, "swing": "push", "hinge_side": "left"}, "base": "mobile"},
        {"door": "office-closer-2", "base": "mobile", "randomization": "mild"},
    ],
)


# --- The same episode ----------------------------------------------------------------


@pytest.mark.bits
@everywhere
def test_equal_commands_give_equal_episodes_by_both_ids(arguments, make_rl, make_env):
    wrapped, plain = make_rl(**arguments), make_env(**arguments)
    observation, info = plain.reset(seed=4)
    flat, said = wrapped.reset(seed=4)
    # They change slowly; some of them are beyond what is allowed.
    actions = np.random.default_rng(0).normal(0.0, 0.2, (80, 6)).cumsum(axis=0)
    for action in actions.astype(np.float32):
        expected = gym.spaces.flatten(plain.observation_space, observation)
        assert np.array_equal(flat, expected.astype(np.float32))
        assert flat.dtype == np.float32
        assert flat in wrapped.observation_space
        for key in ("reward_terms", "peak_force", "peak_slip", "return"):
            said.pop(key), info.pop(key, None)
        assert data_equivalence(said, info, exact=True)
        command = command_of(action, observation["ee_pose"])
        observation, _, *ended, info = plain.step(command)
        flat, reward, *also_ended, said = wrapped.step(action)
        # The time limit is the wrapper's, and far away.
        assert also_ended == ended
        assert type(reward) is float
    assert np.array_equal(wrapped.unwrapped.data.qpos, plain.data.qpos)


def test_a_command_is_the_hand_plus_the_limits():
    hand = np.array([0.1, 0.0, -0.2, 0.0, 0.4, 0.0])
    command = command_of([1.0, -0.5, 0.0, 0.0, 3.0, 0.0], hand)
    metres, radians = LIMITS
    offset = np.array([metres, -0.5 * metres, 0.0, 0.0, radians, 0.0])
    assert command == pytest.approx(hand + offset, abs=1e-15)
    assert action_of(command, hand)[:4] == pytest.approx([1.0, -0.5, 0.0, 0.0])
    assert action_of(hand, hand).tolist() == 6 * [0.0]


def test_zero_lets_the_hand_rest(make_rl):
    env = make_rl(door="medium")
    env.reset(seed=0)
    for _ in range(300):
        *_, info = env.step(np.zeros(6, np.float32))
    assert abs(info["door_angle"]) < math.radians(0.2)
    assert info["peak_force"] < 1.0


# --- Contracts -----------------------------------------------------------------------


@everywhere
def test_gymnasium_s_checker_is_silent(arguments, make_rl):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It is wrapped, and that is the point.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped")
        check_env(make_rl(**arguments), skip_render_check=True)


def test_wrong_actions_are_named(make_env, make_vec):
    one, many = RelativeAction(make_env()), VectorRelativeAction(make_vec(2))
    for env in (one, many):
        with pytest.raises(gym.error.ResetNeeded):
            env.step(np.zeros(env.action_space.shape))
        env.reset(seed=0)
    for env, wrong, message in (
        (one, np.zeros(5), r"numbers of shape \(6,\).*relative to the hand.*got array"),
        (one, np.full(6, np.nan), "the action must be finite"),
        (many, np.zeros(6), r"shape \(2, 6\)"),
    ):
        with pytest.raises(ValueError, match=message):
            env.step(wrong)


def test_what_cannot_be_wrapped_is_refused(make_env, make_vec):
    with pytest.raises(ValueError, match="needs a pose"):
        RelativeAction(make_env(id=gplfd_env.IMPEDANCE_ENVIRONMENT_ID))
    with pytest.raises(ValueError, match="must be above zero"):
        VectorRelativeAction(make_vec(2), limits=(0.0, 0.1))
    with pytest.raises(ValueError, match="dictionaries of vectors"):
        FlatObservation(FlatObservation(make_env()))


# --- What it earns -------------------------------------------------------------------

numbers = st.floats(0.0, 200.0)
steps = st.lists(
    st.tuples(
        st.floats(-0.01, 1.75), st.floats(-200.0, 200.0), numbers, numbers,
        st.floats(0.0, 0.05),
    ),
    min_size=1,
    max_size=20,
)  # fmt: skip


def infos(rows: Any, success: bool = False) -> list[dict[str, Any]]:
    names = ("door_angle", "force_radial", "person_force", "stop_force", "slip")
    said = [{**dict(zip(names, row, strict=True)), "success": False} for row in rows]
    said[-1]["success"] = success
    return said


def earned(said: list[dict[str, Any]]) -> float:
    score = Score(infos([(0.0, 0.0, 0.0, 0.0, 0.0)])[0])
    total = 0.0
    for info in said:
        score.advance(info)
        total += score.reward
    assert total == pytest.approx(score.earned, abs=1e-12)
    return total


def formula(angle: float, force: float, slip: float, success: bool) -> float:
    """What the page says."""
    progress = min(angle, SUCCESS_ANGLE) / SUCCESS_ANGLE
    return progress - force / FORCE_SCALE - slip / SLIP_SCALE + success


@given(steps, st.booleans())
def test_a_return_is_the_formula_of_the_page(rows, success):
    force = max(max(map(abs, row[1:4])) for row in rows)
    expected = formula(rows[-1][0], force, max(row[4] for row in rows), success)
    assert earned(infos(rows, success)) == pytest.approx(expected, abs=1e-9)


def worth(info: dict[str, Any]) -> float:
    names = ("door_angle", "peak_force", "peak_slip", "success")
    return formula(*(info[name] for name in names))


@pytest.mark.parametrize("base", ["fixed", "mobile"])
def test_a_lever_can_be_opened_within_the_limits(base, make_rl, opening_poses):
    env = make_rl(door=LEVER, base=base)
    poses = opening_poses(env.unwrapped.door_geometry, 66.0, duration=6.0)
    observation, info = env.reset(seed=0)
    assert info["return"] == 0.0
    begun, total, peak = worth(info), 0.0, abs(info["force_radial"])
    for step in range(1400):
        hand = observation[:6].astype(float)
        action = action_of(poses[min(step, len(poses) - 1)], hand)
        observation, reward, ended, _, info = env.step(action)
        assert reward == pytest.approx(sum(info["reward_terms"].values()), abs=1e-12)
        total += reward
        assert info["return"] == pytest.approx(total, abs=1e-9)
        peak = max(peak, abs(info["force_radial"]))
        assert info["peak_force"] == peak
        if ended:
            break
    assert info["return"] == pytest.approx(worth(info) - begun, abs=1e-9)
    assert info["success"]
    assert total > 0.3
