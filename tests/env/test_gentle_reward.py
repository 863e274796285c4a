"""What an episode earns under the id for learners: the formula, and two scripts."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.task.opening import SUCCESS_ANGLE
from gplfd_env.wrappers import action_of
from gplfd_env.wrappers.gentle_reward import FORCE_SCALE, SLIP_SCALE, Score

pytestmark = pytest.mark.slow

ID = gplfd_env.RL_ENVIRONMENT_ID
LEVER = {"handle": "lever", "latch": "spring", "radius": 0.53, "backset": 0.055}


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


@given(steps, st.booleans())
def test_a_return_is_the_formula_of_the_page(rows: Any, success: bool) -> None:
    angle, *_ = rows[-1]
    force = max(max(map(abs, row[1:4])) for row in rows)
    slip = max(row[4] for row in rows)
    expected = min(angle, SUCCESS_ANGLE) / SUCCESS_ANGLE - force / 20 - slip / 0.02
    assert earned(infos(rows, success)) == pytest.approx(expected + success, abs=1e-9)


@given(steps, steps)
def test_going_on_earns_no_more_than_the_door_moves(rows: Any, more: Any) -> None:
    """So nothing is gained by staying, or by going to and fro."""
    rest = [(rows[-1][0], *row[1:]) for row in more]
    assert earned(infos([*rows, *rest])) <= earned(infos(rows)) + 1e-9
    assert earned(infos([*rows, *more, rows[-1]])) <= earned(infos(rows)) + 1e-9


@given(steps, st.floats(0.1, 100.0))
def test_every_newton_more_at_the_peak_costs_the_same(rows: Any, more: float) -> None:
    said = infos(rows, success=True)
    peak = max(abs(row[1]) for row in rows)
    before = max(peak, *(max(row[2:4]) for row in rows))
    harder = [dict(info) for info in said]
    harder[0]["force_radial"] = before + more
    lost = earned(said) - earned(harder)
    assert lost == pytest.approx(more / FORCE_SCALE, abs=1e-9)


def play(env: Any, decide: Callable) -> tuple[float, float, dict[str, Any]]:
    """Return what an episode earns, what the dense reward says of it, its last info."""
    observation, info = env.reset(seed=0)
    begun = formula(info)
    earned = dense = before = 0.0
    for step in range(1400):
        hand = observation[:6].astype(float)
        observation, reward, ended, _, info = env.step(decide(step + 1, hand))
        earned += reward
        dense += (info["door_angle"] - before) / SUCCESS_ANGLE + info["success"]
        dense -= 1e-5 * abs(info["force_radial"])
        before = info["door_angle"]
        if ended:
            break
    assert info["return"] == pytest.approx(formula(info) - begun, abs=1e-9)
    return earned, dense, info


def eased(share: float) -> float:
    s = min(max(share, 0.0), 1.0)
    return 10.0 * s**3 - 15.0 * s**4 + 6.0 * s**5


def gently(env: Any) -> Callable:
    """Turn the handle in 1.5 s if it turns, open in 6 s, let it back meanwhile."""
    door = env.unwrapped.door_geometry
    begin = 1.5 if door.travel else 0.0

    def decide(step: int, hand: np.ndarray) -> np.ndarray:
        time = step * CONTROL_PERIOD
        turn = door.travel * eased(time / 1.5) * (1.0 - eased((time - 3.5) / 1.5))
        angle = math.radians(66.0) * eased((time - begin) / 6.0)
        return action_of(door.hand_poses(angle, turn), hand)

    return decide


def slamming(step: int, hand: np.ndarray) -> np.ndarray:
    """Pull as far as actions go, turning with the hand."""
    return np.array([math.cos(hand[4]), 0.0, -math.sin(hand[4]), 0.0, 0.5, 0.0])


@pytest.mark.parametrize("door", ["small", "medium", "large", "heavy"])
def test_a_slam_earns_less_than_a_gentle_opening(door: str, make_rl: Callable) -> None:
    env = make_rl(door=door)
    gentle, _, calm = play(env, gently(env))
    slammed, _, info = play(env, slamming)
    assert calm["success"]
    assert calm["peak_force"] < 3.0
    assert gentle > 1.8
    assert info["peak_force"] > 20.0
    assert (
        slammed < gentle - (info["peak_force"] - calm["peak_force"]) / FORCE_SCALE + 0.1
    )


def test_the_dense_reward_says_otherwise(make_rl: Callable) -> None:
    """The defect that this reward is for: a slam opens farther, and that paid."""
    env = make_rl(door="medium")
    _, gentle, _ = play(env, gently(env))
    _, slammed, info = play(env, slamming)
    assert info["success"]
    assert slammed > gentle + 0.1


@pytest.mark.parametrize("base", ["fixed", "mobile"])
def test_a_lever_can_be_opened_within_the_limits(base: str, make_rl: Callable) -> None:
    env = make_rl(door={**LEVER, "radius": 0.53}, base=base)
    earned, _, info = play(env, gently(env))
    assert info["success"]
    assert earned > 0.3


def formula(info: dict[str, Any]) -> float:
    """What the page says."""
    progress = min(info["door_angle"], SUCCESS_ANGLE) / SUCCESS_ANGLE
    costs = info["peak_force"] / FORCE_SCALE + info["peak_slip"] / SLIP_SCALE
    return progress - costs + info["success"]


def test_the_info_tells_the_return_the_force_and_the_terms(make_rl: Callable) -> None:
    env = make_rl(door="large")
    _, info = env.reset(seed=0)
    total = peak = 0.0
    assert info["return"] == 0.0
    for action in np.random.default_rng(3).uniform(-1.0, 1.0, (40, 6)):
        *_, info = env.step(action)
        reward = sum(info["reward_terms"].values())
        total += reward
        peak = max(peak, abs(info["force_radial"]))
        assert list(info["reward_terms"]) == ["progress", "force", "slip", "success"]
        assert info["return"] == pytest.approx(total, abs=1e-12)
        assert info["peak_force"] == peak
        for name in ("return", "peak_force", "peak_slip"):
            assert type(info[name]) is float
