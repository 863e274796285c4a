"""Every wrong use, of one and of many, is refused with what was given and allowed."""

import math
import re
from collections.abc import Callable
from functools import partial
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

import gplfd_env

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID

DOORS: list[tuple[Any, type[Exception], str]] = [
    ("smal", ValueError, r"unknown door 'smal' \(did you mean 'small'\?\)"),
    (1.2, ValueError, r"radius = 1\.2 is outside \[0\.3, 1\.05\] m"),
    (0.9, ValueError, r'radius = 0\.9 is out of reach .* 0\.65 m; give base="mob'),
    ({"radius": "wide"}, TypeError, r"radius must be a number, got 'wide' \(str\)"),
    ({"colour": 1}, ValueError, r"unknown door field 'colour'.*fields: radius, h"),
]
ARGUMENTS: list[tuple[dict[str, Any], type[Exception], str]] = [
    *[({"door": door}, kind, message) for door, kind, message in DOORS],
    ({"door": None}, TypeError, "door must be a preset's name"),
    ({"grasp": "glue"}, ValueError, "grasp = 'glue' is not one of 'contact', 'we"),
    ({"camera_name": "side"}, ValueError, "camera_name = 'side' is not one of 'ov"),
    ({"reward": "dens"}, ValueError, "reward = 'dens' is not one of 'dense', 'sp"),
    ({"base": "wheels"}, ValueError, "base = 'wheels' is not one of 'fixed', 'mob"),
    (
        {"randomization": "easy"},
        ValueError,
        "unknown randomization 'easy'; presets: no",
    ),
    *[
        ({"height": size}, ValueError, r"height = .* whole number of pixels from 1")
        for size in (0, -1, 2.5, True, "a", 10**5)
    ],
]
MANY_S_OWN: list[tuple[dict[str, Any], str]] = [
    ({"door": ["small"]}, "door must be one for all .* sequence of 2, got 1"),
    ({"door": ["small", "smal"]}, "unknown door 'smal'"),
    ({"render_mode": "human"}, "render_mode = 'human' is not one of None, 'rgb_a"),
    ({"autoreset_mode": "Now"}, "'Now' is not one of 'NextStep', 'SameStep', 'Dis"),
    ({"num_threads": -1}, "num_threads = -1 must be a whole number from 0"),
]
DISTURBANCES: list[tuple[Any, type[Exception], str]] = [
    ("persn", ValueError, r"unknown disturbance 'persn' \(did you mean 'person'\?\)"),
    ({"pusch": {}}, ValueError, r"disturbance field 'pusch' \(did you mean 'push'"),
    ({"push": {"alogn": 1}}, ValueError, r"push field 'alogn' \(did you mean 'along'"),
    ({"push": {"along": 101}}, ValueError, r"Push.along = 101.0 .* \[-100, 100\] N"),
    ({"push": {"along": [5, 1]}}, ValueError, r"number or \(low, high\), low first"),
    ({"push": {"along": [1, 2, 3]}}, ValueError, r"must be a number or \(low, high\)"),
    ({"push": {"along": [1, math.nan]}}, ValueError, "Push.along = nan is outside"),
    ({"push": {"duration": 0}}, ValueError, r"duration = 0.0 is outside \(0, 1000\] s"),
    ({"push": {"on": "elbow"}}, ValueError, "'hand', 'forearm', 'door'"),
    ({"person": {"one_sided": 3}}, ValueError, "sided = 3 is not one of False, True"),
    (3, TypeError, "must be a preset's name, a mapping"),
    (["push"], TypeError, "must be a preset's name, a mapping"),
    ({"push": "hard"}, TypeError, "must be a mapping of Push fields"),
    ({"push": {"along": "ten"}}, TypeError, r"a number or \(low, high\), got 't"),
    ({"push": {"along": (1, "ten")}}, TypeError, "Push.along must be a number, got 't"),
]


@pytest.fixture
def makers(make_env: Callable, make_vec: Callable) -> list[Callable[..., Any]]:
    return [make_env, partial(make_vec, 2)]


@pytest.mark.parametrize(("arguments", "kind", "message"), ARGUMENTS)
def test_wrong_arguments(arguments, kind, message, makers):
    for make in makers:
        with pytest.raises(kind, match=message):
            make(**arguments)


@pytest.mark.parametrize(("arguments", "message"), MANY_S_OWN)
def test_wrong_arguments_of_many(arguments, message, make_vec):
    with pytest.raises(ValueError, match=message):
        make_vec(2, **arguments)


@pytest.mark.parametrize(("disturbance", "kind", "message"), DISTURBANCES)
def test_wrong_disturbances(disturbance, kind, message, make_env):
    with pytest.raises(kind, match=message):
        make_env(disturbance=disturbance)


def assert_refused(
    make: Callable, kind: type[Exception], message: str, **reset: Any
) -> None:
    """A reset that is refused changes nothing, neither doors nor generators."""
    env, untouched = (make(randomization="mild") for _ in range(2))
    for each in (env, untouched):
        each.reset(seed=0)
    with pytest.raises(kind, match=message):
        env.reset(**reset)
    rest = np.zeros(env.action_space.shape)
    assert data_equivalence(env.step(rest), untouched.step(rest), exact=True)
    assert data_equivalence(env.reset(), untouched.reset(), exact=True)


NO_MAPPING = r'must be a mapping such as {"door"'
RESETS: list[tuple[dict[str, Any], type[Exception], str]] = [
    *[
        ({"options": {"door": door}, "seed": 7}, kind, message)
        for door, kind, message in DOORS
    ],
    (
        {"options": {"radius": 0.4, "dor": "small"}},
        ValueError,
        r"unknown reset option\(s\) 'radius', 'dor'; allowed: .door. \((name|as for)",
    ),
    ({"options": {"randomization": "hrad"}}, ValueError, "did you mean 'hard'"),
    (
        {"options": {"door": "large", "randomization": "hrad"}},
        ValueError,
        "did you mean 'hard'",
    ),
    *[
        ({"options": options}, ValueError, NO_MAPPING)
        for options in ("door", 3, [("door", "small")], [])
    ],
]


@pytest.mark.parametrize(("reset", "kind", "message"), RESETS)
def test_wrong_resets_change_nothing(reset, kind, message, makers):
    for make in makers:
        assert_refused(make, kind, message, **reset)


def test_a_wrong_seed_changes_nothing(makers):
    one, many = makers
    large = {"door": "large"}
    assert_refused(one, gym.error.Error, "Seed must be", seed=-1, options=large)
    for seed in ([5, -1], [5, 1.5], [5, "a"]):
        assert_refused(many, gym.error.Error, "Seed must be", seed=seed, options=large)


NO_MASK = "an array of 2 booleans"


@pytest.mark.parametrize(
    ("reset", "message"),
    [
        ({"seed": [1, 2, 3]}, r"seed must be .* sequence of 2, got \[1, 2, 3\]"),
        ({"seed": 1.5}, "seed must be an integer, None or a sequence of 2, got 1.5"),
        ({"seed": "ab"}, "seed must be an integer, None or a sequence of 2, got 'ab'"),
        ({"options": {"door": ["small"] * 3}}, "a sequence of 2, got 3"),
        (
            {"options": {"randomization": ["hard"]}},
            "randomization must be one for all simul",
        ),
        ({"options": {"reset_mask": [True]}}, NO_MASK),
        ({"options": {"reset_mask": np.array([0, 1])}}, NO_MASK),
        ({"options": {"reset_mask": np.array([False] * 2)}}, "at least one True"),
    ],
)
def test_wrong_resets_of_many_change_nothing(reset, message, make_vec):
    assert_refused(partial(make_vec, 2), ValueError, message, **reset)


def test_the_first_reset_must_reset_all(make_vec):
    with pytest.raises(ValueError, match="first reset must reset all simulations"):
        make_vec(2).reset(options={"reset_mask": np.array([True, False])})


@pytest.mark.parametrize("make", ["one", "impedance", "many", "many impedance"])
def test_wrong_actions_move_nothing(make, makers):
    id = IMPEDANCE if "impedance" in make else POSE
    env = makers["many" in make](id=id)
    rest = np.zeros(env.action_space.shape) + np.broadcast_to(
        env.command.rest, env.action_space.shape
    )
    with pytest.raises(gym.error.ResetNeeded):
        env.step(rest)
    env.reset(seed=0)
    shape = re.escape(str(rest.shape))
    for wrong in (rest[..., :5], rest[None], rest[..., None], 0.0, [], np.zeros(18)):
        given = re.escape(str(np.shape(wrong)))
        asked = rf"shape {shape}.*{'stiffness.*' if id == IMPEDANCE else ''}"
        with pytest.raises(ValueError, match=rf"{asked}got shape {given}"):
            env.step(wrong)
    for wrong in ("pull", {"x": 0.1}, 6 * [10**400], 6 * ["a"]):
        with pytest.raises(ValueError, match=rf"must be numbers of shape {shape}"):
            env.step(wrong)
    for index, value in ((0, np.nan), (5, np.inf), (-1, -np.inf)):
        wrong = rest.copy()
        wrong[..., index] = value
        with pytest.raises(ValueError, match=rf"(?s)be finite, got .*{value}.*policy"):
            env.step(wrong)
    opposite = np.zeros_like(rest)
    opposite[..., :2] = np.inf, -np.inf
    with pytest.raises(ValueError, match="must be finite"):
        env.step(opposite)
    observation, *_, truncated, _ = env.step(rest)
    assert observation["time"] == pytest.approx(np.full_like(observation["time"], 0.01))
    assert not np.any(truncated)
    observation, *_ = env.step(np.full(rest.shape, 1e308))
    assert observation in env.observation_space, "clamped, not refused"
