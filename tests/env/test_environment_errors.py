"""Every wrong use, of one and of many, is refused with what was given and allowed."""

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
    (10**400, ValueError, r"radius = inf is outside \[0\.3, 1\.05\] m"),
    ({"radius": "wide"}, TypeError, r"radius must be a number, got 'wide' \(str\)"),
]
DISTURBANCES: list[tuple[Any, type[Exception], str]] = [
    ("persn", ValueError, r"unknown disturbance 'persn' \(did you mean 'person'\?\)"),
    ({"push": {"alogn": 1}}, ValueError, r"push field 'alogn' \(did you mean 'along'"),
    ({"push": {"along": 101}}, ValueError, r"Push.along = 101.0 .* \[-100, 100\] N"),
    ({"push": {"along": [5, 1]}}, ValueError, r"number or \(low, high\), low first"),
    ({"push": {"on": "elbow"}}, ValueError, "'hand', 'forearm', 'door'"),
    ({"push": "hard"}, TypeError, "must be a Push or its fields"),
]
ARGUMENTS: list[tuple[dict[str, Any], type[Exception], str]] = [
    *[({"door": door}, kind, message) for door, kind, message in DOORS],
    *[({"disturbance": each}, kind, said) for each, kind, said in DISTURBANCES],
    ({"grasp": "glue"}, ValueError, "grasp = 'glue' is not one of 'contact', 'we"),
    ({"height": 2.5}, ValueError, r"height = .* whole number of pixels from 1"),
]
OF_MANY: list[tuple[int, dict[str, Any], str]] = [
    (2, {"door": ["small"]}, "door must be one for all .* sequence of 2, got 1"),
    (2, {"render_mode": "human"}, "render_mode = 'human' is not one of None, 'rgb_a"),
    (2, {"num_threads": -1}, "num_threads = -1 must be a whole number from 0"),
    (2**63, {}, "num_envs = 9.* number from 1 to 100000"),
]


@pytest.fixture
def makers(make_env: Callable, make_vec: Callable) -> list[Callable[..., Any]]:
    return [make_env, partial(make_vec, 2)]


@pytest.mark.parametrize(("arguments", "kind", "message"), ARGUMENTS)
def test_wrong_arguments(arguments, kind, message, makers):
    for make in makers:
        with pytest.raises(kind, match=message):
            make(**arguments)


@pytest.mark.parametrize(("n", "arguments", "message"), OF_MANY)
def test_wrong_arguments_of_many(n, arguments, message, make_vec):
    with pytest.raises(ValueError, match=message):
        make_vec(n, **arguments)


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


RESETS: list[tuple[dict[str, Any], type[Exception], str]] = [
    ({"options": {"door": "smal"}, "seed": 7}, ValueError, "unknown door 'smal'"),
    ({"options": {"radius": 0.4}}, ValueError, r"unknown reset option\(s\) 'radius';"),
    ({"options": "door"}, ValueError, r'must be a mapping as {"door"'),
    ({"options": {"door": "large"}, "seed": -1}, gym.error.Error, "Seed must be"),
]


@pytest.mark.parametrize(("reset", "kind", "message"), RESETS)
def test_wrong_resets_change_nothing(reset, kind, message, makers):
    for make in makers:
        assert_refused(make, kind, message, **reset)


@pytest.mark.parametrize(
    ("reset", "kind", "message"),
    [
        ({"seed": [5, 1.5]}, ValueError, r"seed must be .* of 2, got \[5, 1.5\]"),
        ({"seed": [1, 2, 3]}, ValueError, r"seed must be .* of 2, got \[1, 2, 3\]"),
        ({"options": {"door": ["small"] * 3}}, ValueError, "a sequence of 2, got 3"),
        ({"options": {"reset_mask": [True]}}, ValueError, "must be 2 booleans"),
        ({"options": {"reset_mask": np.zeros(2, bool)}}, ValueError, "not all False"),
    ],
)
def test_wrong_resets_of_many_change_nothing(reset, kind, message, make_vec):
    assert_refused(partial(make_vec, 2), kind, message, **reset)


def test_the_first_reset_must_reset_all(make_vec):
    with pytest.raises(ValueError, match="first reset must reset all simulations"):
        make_vec(2).reset(options={"reset_mask": np.array([True, False])})


@pytest.mark.parametrize("id", [POSE, IMPEDANCE])
@pytest.mark.parametrize("n", [1, 2])
def test_wrong_actions_move_nothing(n, id, makers):
    env = makers[n - 1](id=id)
    shape = env.action_space.shape
    rest = np.zeros(shape) + np.broadcast_to(env.command.rest, shape)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(rest)
    env.reset(seed=0)
    for wrong, message in (
        (rest[..., :5], rf"{re.escape(str(shape))}.*got shape"),
        ("pull", "must be numbers of shape"),
        (rest + 0j, "must be numbers of shape"),
        (rest.astype("datetime64[s]"), "must be numbers of shape"),
        (np.ma.masked_array(rest, mask=rest == 0.0), "must be numbers of shape"),
        (np.array(rest, dtype=object) + 0j, "must be numbers of shape"),
        (np.where(rest == rest.min(), np.nan, rest), "(?s)finite, got .*nan.*policy"),
    ):
        with pytest.raises(ValueError, match=message):
            env.step(wrong)
    observation, *_, truncated, _ = env.step(rest)
    assert observation["time"] == pytest.approx(np.full_like(observation["time"], 0.01))
    assert not np.any(truncated)
    observation, *_ = env.step(np.full(shape, 1e308))
    assert observation in env.observation_space, "clamped, not refused"
