"""Every wrong use of the environment is refused with what was given and allowed."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence

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
    from gplfd_env.envs.door_opening import DoorOpeningEnv

    with pytest.raises(ValueError, match="'human', 'rgb_array', 'depth_array'"):
        DoorOpeningEnv(render_mode="ansi")


@pytest.mark.parametrize(
    ("door", "kind", "message"),
    [
        ("smal", ValueError, r"unknown door 'smal' \(did you mean 'small'\?\)"),
        (1.2, ValueError, r"radius = 1\.2 is outside \[0\.3, 0\.95\] m"),
        (0.9, ValueError, r'radius = 0\.9 is out of reach .* 0\.65 m; give base="mob'),
        ({"radius": "wide"}, TypeError, r"radius must be a number, got 'wide' \(str\)"),
        ({"colour": 1}, ValueError, r"unknown door field 'colour'.*fields: radius, h"),
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


@pytest.mark.parametrize("options", ["door", 3, [("door", "small")], []])
def test_options_that_are_no_mapping(
    options: Any, make_env: Callable, make_vec: Callable
) -> None:
    for env in (make_env(), make_vec(2)):
        with pytest.raises(ValueError, match=r'must be a mapping such as {"door"'):
            env.reset(options=options)


def test_a_refused_reset_changes_nothing(make_env: Callable) -> None:
    """Neither by its seed, if the options are wrong, nor the other way round."""
    env, untouched = (make_env("small", randomization="mild") for _ in range(2))
    for each in (env, untouched):
        each.reset(seed=0)
    with pytest.raises(ValueError, match="unknown door"):
        env.reset(seed=7, options={"door": "smal"})
    with pytest.raises(gym.error.Error, match="Seed must be"):
        env.reset(seed=-1, options={"door": "large"})
    assert data_equivalence(env.reset(), untouched.reset(), exact=True)


@pytest.mark.parametrize("size", [0, -1, 2.5, True, "a", 10**5])
def test_impossible_sizes_of_pictures(size: Any, make_env: Callable) -> None:
    with pytest.raises(ValueError, match=r"height = .* whole number of pixels from 1"):
        make_env(height=size)


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


@pytest.mark.parametrize("action", ["pull", {"x": 0.1}, 6 * [10**400], 6 * ["a"]])
def test_action_that_is_no_numbers(action: Any, make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"must be numbers of shape \(6,\), commanded"):
        env.step(action)


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
    for each in (env, env.unwrapped):
        with pytest.raises(gym.error.ResetNeeded):
            each.step(np.zeros(6))
    env.close()


def test_a_closed_environment_goes_on(make_env: Callable, make_vec: Callable) -> None:
    """Only the renderer is freed; closing twice is as good as once."""
    for env in (make_env("small"), make_vec(2)):
        env.reset(seed=0)
        env.close()
        env.close()
        env.step(np.zeros(env.action_space.shape))
        env.reset()


def test_rendering_without_a_mode_warns(make_env: Callable) -> None:
    env = make_env("small")
    env.reset(seed=0)
    with pytest.warns(UserWarning, match='render_mode="rgb_array"'):
        assert env.render() is None


def test_missing_asset_is_named() -> None:
    from gplfd_env.conventions.assets import asset_path

    with pytest.raises(FileNotFoundError, match=r"'nothing.urdf' was not found.*reins"):
        asset_path("nothing.urdf")
