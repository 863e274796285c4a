"""Every wrong use of the environment is refused with what was given and allowed."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest

import gplfd_env


def test_unknown_arguments_name_the_choices(make_env: Callable) -> None:
    with pytest.raises(ValueError, match="grasp = 'glue' is not one of 'contact', 'we"):
        make_env(grasp="glue")
    with pytest.raises(ValueError, match="camera_name = 'side' is not one of 'overvi"):
        make_env(camera_name="side")
    with pytest.raises(ValueError, match="reward = 'dens' is not one of 'dense', 'sp"):
        make_env(reward="dens")
    with pytest.raises(ValueError, match="unknown randomization 'easy'; presets: none"):
        make_env(randomization="easy")


def test_unknown_render_mode_names_the_choices() -> None:
    from gplfd_env.door_opening import DoorOpeningEnv

    with pytest.raises(ValueError, match="'human', 'rgb_array', 'depth_array'"):
        DoorOpeningEnv(render_mode="ansi")


@pytest.mark.parametrize(
    ("door", "kind", "message"),
    [
        ("smal", ValueError, r"unknown door 'smal' \(did you mean 'small'\?\)"),
        (0.9, ValueError, r"radius = 0\.9 is outside \[0\.3, 0\.65\] m"),
        ({"radius": "wide"}, TypeError, r"radius must be a number, got 'wide' \(str\)"),
        ({"colour": 1}, ValueError, r"unknown door field 'colour'.*fields: closer_pre"),
        (None, TypeError, "door must be a preset's name"),
    ],
)
def test_wrong_doors_are_refused_at_make_and_at_reset(
    door: Any, kind: type[Exception], message: str, make_env: Callable
) -> None:
    with pytest.raises(kind, match=message):
        make_env(door)
    if door is None:
        return
    env = make_env("small")
    with pytest.raises(kind, match=message):
        env.reset(options={"door": door})
    # A refused door leaves the present one in place.
    _, info = env.reset(seed=0)
    assert info["door_radius"] == 0.35
    assert env.model.body("door").pos[2] == pytest.approx(-0.35)


def test_unknown_reset_options_are_named(make_env: Callable) -> None:
    env = make_env("small")
    with pytest.raises(ValueError, match=r"unknown reset option\(s\) 'radius', 'dor'"):
        env.reset(options={"radius": 0.4, "dor": "small"})
    with pytest.raises(ValueError, match=r'allowed: "door" \(name, radius, mapping'):
        env.reset(options={"radius": 0.4})


def test_reset_does_not_change_the_caller_s_options(make_env: Callable) -> None:
    options = {"door": "large"}
    make_env("small").reset(options=options)
    assert options == {"door": "large"}


@pytest.mark.parametrize(
    "action", [np.zeros(5), np.zeros((1, 6)), np.zeros((6, 1)), 0.0, [], np.zeros(12)]
)
def test_action_of_another_shape(action: Any, make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    shape = str(np.shape(action)).replace("(", r"\(").replace(")", r"\)")
    with pytest.raises(ValueError, match=rf"must have shape \(6,\).*got shape {shape}"):
        env.step(action)


@pytest.mark.parametrize("value", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 5])
def test_action_that_is_not_finite(axis: int, value: float, make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    action = np.zeros(6)
    action[axis] = value
    with pytest.raises(ValueError, match=rf"must be finite, got \[.*{value}.*policy"):
        env.step(action)
    assert env.data.time == 0.0, "a refused action must not move the simulation"
    _, _, _, truncated, info = env.step(np.zeros(6))
    assert not truncated
    assert not info["simulation_error"]


def test_opposite_infinities_are_not_finite(make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    with pytest.raises(ValueError, match="must be finite"):
        env.step(np.array([np.inf, -np.inf, 0, 0, 0, 0]))


def test_huge_finite_action_is_clamped_not_refused(make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    observation, *_ = env.step(np.full(6, 1e308))
    assert observation in env.observation_space


def test_step_before_reset_is_refused() -> None:
    env = gym.make(gplfd_env.ENVIRONMENT_ID)
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(6))
    env.close()


def test_rendering_without_a_mode_warns(make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='render_mode="rgb_array"'):
        assert env.render() is None


def test_missing_asset_is_named() -> None:
    from gplfd_env._paths import asset_path

    with pytest.raises(FileNotFoundError, match=r"'nothing.urdf' was not found.*reins"):
        asset_path("nothing.urdf")
