"""Doors on MuJoCo Warp's CPU backend; needs the extra warp, run by .ci/learners.

Warp compiles its kernels at their first use, which takes half a minute.
"""

import dataclasses
import importlib
import itertools
import os
import sys
from collections.abc import Iterator
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.vector import AutoresetMode

if os.environ.get("GPLFD_REQUIRE_ALL") != "1":
    pytest.importorskip("mujoco_warp", reason="needs pip install '.[warp]'")

import mujoco_warp
import warp

from gplfd_env import RL_ENVIRONMENT_ID
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import door_config
from gplfd_env.doors.disturbance import (
    Breakaway,
    Disturbance,
    Person,
    Push,
    Stop,
    disturbance_named,
)
from gplfd_env.doors.randomization import door_randomization
from gplfd_env.envs.reinforcement import for_learners
from gplfd_env.envs.vector import DoorOpeningImpedanceVectorEnv
from gplfd_env.envs.warp import make_warp
from gplfd_env.scene.build import build_scene
from gplfd_env.scene.door import structure_of
from gplfd_env.simulation.command import COMMANDS
from gplfd_env.simulation.warp import WORLD_FIELDS
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_env.task.draw import draw_episode
from gplfd_env.wrappers import action_of

EIGHT: Final = (
    *("small", "medium", "large", "heavy", "cabinet", "wardrobe"),
    {"radius": 0.45, "swing": "push"},
    {"radius": 0.45, "hinge_side": "left"},
)
"""Doors that are compared."""
_POSE, _WRENCH = slice(0, 6), slice(27, 33)


@pytest.fixture(autouse=True)
def on_the_processor() -> Iterator[None]:
    with warp.ScopedDevice("cpu"):
        yield


class StiffestImpedance(DoorOpeningImpedanceVectorEnv):
    """MuJoCo simulations of the model for Warp: commands without stiffness."""

    def __init__(self, num_envs: int = 1, *args: Any, **arguments: Any) -> None:
        super().__init__(num_envs, *args, **arguments)
        self.single_action_space = COMMANDS["pose"].space

    def step(self, poses: Any) -> Any:
        """Command every hand for one control period."""
        stiffest = np.tile(self.command.rest[6:], (self.num_envs, 1))
        return super().step(np.hstack([poses, stiffest]))


def arcs(envs: Any, rng: np.random.Generator) -> Any:
    """Follow the true arcs of the doors to random angles within 3 s."""
    doors = [variation.door for variation in envs.unwrapped.variations]
    angles = np.radians(rng.uniform(20.0, 66.0, len(doors)))
    signs = [(door.swing_sign, door.hinge_sign) for door in doors]
    mirrored = np.array([(pull, 1, side, 1, pull * side, 1) for pull, side in signs])
    radii = np.array([door.radius for door in doors])

    def script(step: int, hands: Any) -> Any:
        s = min(step * CONTROL_PERIOD / 3.0, 1.0)
        progress = 10 * s**3 - 15 * s**4 + 6 * s**5
        poses = mirrored * handle_pose_on_arc(radii, progress * angles)
        return np.clip(action_of(poses, hands), -1.0, 1.0).astype(np.float32)

    return script


def shoves(envs: Any, rng: np.random.Generator) -> Any:
    """Move hands in a new random direction every 0.1 s, by up to 12 mm and 0.04 rad."""
    drawn = rng.uniform(-0.4, 0.4, (1000, envs.num_envs, 6)).astype(np.float32)
    return lambda step, hands: drawn[step // 10]


def differences(first: Any, second: Any, script: Any, periods: int) -> dict[str, Any]:
    """Return absolute differences, per period and simulation until an episode ends.

    The actions of the script depend on the observations of the second environment.
    """
    first.reset(seed=0)
    observations, _ = second.reset(seed=0)
    acting = np.ones(first.num_envs, dtype=bool)
    play = script(second, np.random.default_rng(0))
    rows: dict[str, list[Any]] = {}
    for step in range(1, periods + 1):
        actions = play(step, observations[:, _POSE])
        seen, _, *ended, infos = first.step(actions)
        observations, _, *over, expected = second.step(actions)
        acting = acting & ~np.any([*ended, *over], axis=0)
        apart = np.abs(seen - observations)
        row = {
            "hand": apart[:, _POSE].max(axis=1),
            "wrench": apart[:, _WRENCH].max(axis=1),
            "door": np.abs(infos["door_angle"] - expected["door_angle"]),
            "return": np.abs(infos["return"] - expected["return"]),
        }
        for name, values in row.items():
            rows.setdefault(name, []).append(values[acting])
    return {name: np.concatenate(values) for name, values in rows.items()}


def pair(n: int = len(EIGHT), **arguments: Any) -> tuple[Any, Any]:
    """Doors on Warp, and MuJoCo's of the same model, stepped the same way."""
    given = {"door": EIGHT[:n], **arguments}
    twin = StiffestImpedance(n, **{"max_episode_steps": 1500, **given})
    return make_warp(n, **given), for_learners(twin)


# --- Agreement with MuJoCo ---------------------------------------------------


@pytest.mark.parametrize("randomization", ["none", "hard"])
@pytest.mark.parametrize("played", [arcs, shoves])
def test_physics_are_mujoco_s_within_float32(played, randomization):
    """Which a grip by friction enlarges where it slips; see docs/notes/warp.md."""
    envs = pair(randomization=randomization)
    apart = differences(*envs, played, 300)
    assert apart["door"].size > 0.7 * 8 * 300
    for name, share, bound in (
        ("door", 0.5, 1e-5),
        ("hand", 0.5, 1e-4),
        ("wrench", 0.5, 0.02),
        ("return", 0.5, 1e-3),
        ("door", 0.95, 5e-4),
        ("wrench", 0.95, 0.5),
        ("wrench", 0.9, 0.015 if played is arcs else np.inf),
    ):
        assert np.quantile(apart[name], share) < bound, (name, share)
    assert apart["door"].max() < 5e-3


def test_handles_that_turn_agree_too():
    turning = {"radius": 0.5, "leaf": {"backset": 0.06}}
    handles = [{"handle": "lever"}, {"handle": "knob", "hinge_side": "left"}]
    envs = pair(2, door=[{**turning, **one} for one in handles])
    apart = differences(*envs, shoves, 300)
    assert apart["door"].size > 300
    assert np.quantile(apart["door"], 0.95) < 5e-4
    assert np.quantile(apart["wrench"], 0.95) < 0.5


@pytest.mark.parametrize(
    "disturbance",
    [
        Disturbance(stop=Stop(angle=0.05, duration=0.2)),
        Disturbance(push=Push(profile="constant", along=10.0, duration=100.0)),
        Disturbance(person=Person(start_angle=0.2, duration=0.5)),
        Disturbance(breakaway=Breakaway(stiction=2.0)),
    ],
    ids=["stop", "push", "person", "breakaway"],
)
def test_what_happens_from_outside_happens_there(disturbance):
    """It begins, it ends, and the next episodes are free of it."""
    ours, twin = pair(2, disturbance=disturbance)
    apart = differences(ours, twin, arcs, 200)
    assert apart["door"].max() < 5e-4
    assert apart["door"].size == 400
    _, undisturbed = pair(2)
    apart = differences(ours, undisturbed, arcs, 200)
    assert apart["door"].max() > 5e-3
    for following in (["none", disturbance], "none"):
        for envs in (ours, twin):
            envs.reset(options={"disturbance": following})
        apart = differences(ours, twin, arcs, 50)
        assert apart["door"].max() < 5e-4


def test_every_field_in_which_doors_differ_is_each_simulation_s_own():
    """But for what is only seen, and what MuJoCo Warp does not read in a step."""
    rng = np.random.default_rng(0)
    scenes: dict[Any, list[mujoco.MjModel]] = {}
    turning = {"radius": 0.5, "leaf": {"backset": 0.06}}
    doors = [
        *("small", "medium", "large", "heavy", "cabinet", "wardrobe"),
        {"radius": 0.45, "swing": "push", "stop_angle": 1.8},
        {"radius": 0.45, "hinge_side": "left"},
        {**turning, "handle": "lever"},
        {**turning, "handle": "lever", "hinge_side": "left", "swing": "push"},
        {**turning, "handle": "lever", "lockset": {"handle_stiffness": 0.5}},
        {**turning, "handle": "knob", "stiction": 2.0},
        {"closer": {"backcheck_damping": 20.0, "backcheck_angle": 1.0}},
        {"seal": 2.0, "seal_angle": 0.1},
        *({"motion": "rising-butt", "mechanism": {"rise": x}} for x in (0.01, 0.02)),
        {
            **turning,
            "handle": "knob",
            "hinge_side": "left",
            "closer": {"closing_damping": 5.0},
        },
    ]
    calm = disturbance_named("none")
    for door, name in itertools.product(doors, ("none", *4 * ["hard"])):
        config, ranges = door_config(door), door_randomization(name)
        drawn = draw_episode(config, ranges, calm, rng).variation
        scene = build_scene(drawn.door, placement=drawn.placement, control="impedance")
        scenes.setdefault(structure_of(drawn.door), []).append(scene)
    warp_has = {field.name for field in dataclasses.fields(mujoco_warp.Model)}
    differ = {
        name
        for name in warp_has & set(dir(scene))
        for alike in scenes.values()
        for one in alike[1:]
        if not np.array_equal(getattr(one, name), getattr(alike[0], name))
    }
    cameras = {"cam_pos", "cam_quat", "cam_pos0", "cam_mat0", "cam_poscom0"}
    seen = cameras | {"light_poscom0", "geom_rgba"}
    unread = {"dof_length", "key_ctrl", "key_qpos"}
    assert differ - seen - unread == set(WORLD_FIELDS)


# --- The environment of the id -----------------------------------------------


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_episodes_begin_and_end_as_mujoco_s(mode):
    """Resets are MuJoCo's own, and so is what is decided about episodes."""
    envs = pair(3, autoreset_mode=mode, max_episode_steps=7, randomization="hard")
    observations, infos = zip(*(each.reset(seed=3) for each in envs), strict=True)
    assert np.array_equal(*observations)
    assert np.array_equal(infos[0]["door_radius"], infos[1]["door_radius"])
    assert envs[0].single_observation_space == envs[1].single_observation_space
    assert envs[0].metadata["autoreset_mode"] is mode
    actions = np.random.default_rng(0).uniform(-0.2, 0.2, (20, 3, 6))
    cut = []
    for step, action in enumerate(actions):
        if mode is AutoresetMode.DISABLED and step == 10:
            options = {"reset_mask": np.array([False, True, False])}
            observations = [each.reset(options=options)[0] for each in envs]
            assert np.array_equal(observations[0][1], observations[1][1])
        ours, model = (each.step(action.astype(np.float32)) for each in envs)
        assert ours[0].dtype == np.float32
        np.testing.assert_allclose(ours[0], model[0], atol=0.5)
        np.testing.assert_allclose(ours[0][:, :6], model[0][:, :6], atol=1e-4)
        np.testing.assert_allclose(ours[1], model[1], atol=0.02)
        assert np.array_equal(ours[2:4], model[2:4])
        assert ours[4].keys() == model[4].keys()
        cut.append(ours[3].any())
    assert any(cut)
    poses = [each.unwrapped.qpos for each in envs]
    np.testing.assert_allclose(*poses, atol=1e-4)


def test_it_is_as_far_from_the_id_as_the_other_servo():
    """Of the id itself: the same spaces and resets, and nearly the same episode."""
    ours = make_warp(3, door=EIGHT[:3])
    model = gym.make_vec(RL_ENVIRONMENT_ID, 3, door=EIGHT[:3])
    assert ours.observation_space == model.observation_space
    assert ours.action_space == model.action_space
    apart = differences(ours, model, arcs, 200)
    assert 1e-4 < apart["door"].max() < 0.02


def test_a_diverged_simulation_is_truncated_alone_and_begins_anew():
    envs = make_warp(3, door=EIGHT[:3])
    fresh, _ = envs.reset(seed=0)
    (physics,) = envs.unwrapped._batch._batches.values()
    speeds = physics._data.qvel.numpy()
    speeds[1] = np.nan
    physics._data.qvel.assign(speeds)
    *_, terminations, truncations, infos = envs.step(np.zeros((3, 6)))
    assert truncations.tolist() == [False, True, False]
    assert not terminations.any()
    assert infos["failure"].tolist() == ["", "simulation_error", ""]
    assert np.isfinite(envs.unwrapped.qpos).all()
    begun, *_ = envs.step(np.zeros((3, 6)))
    assert np.array_equal(begun[1], fresh[1])
    assert np.isfinite(envs.step(np.zeros((3, 6)))[0]).all()


# --- What is refused ---------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"base": "mobile"}, "base on MuJoCo Warp = 'mobile' is not one of 'fixed'"),
        ({"grasp": "weld"}, "grasp on MuJoCo Warp = 'weld' is not one of 'contact'"),
        ({"door": "room-709"}, "no latch on MuJoCo Warp: .*; got latch='spring'"),
        ({"reward": "sparse"}, "its own reward"),
    ],
)
def test_what_cannot_be_had_is_said(arguments, message):
    with pytest.raises(ValueError, match=message):
        make_warp(2, **arguments)


def test_without_mujoco_warp_the_extra_is_named(monkeypatch):
    monkeypatch.setitem(sys.modules, "mujoco_warp", None)
    monkeypatch.delitem(sys.modules, "gplfd_env.envs.warp")
    monkeypatch.delitem(sys.modules, "gplfd_env.simulation.warp")
    with pytest.raises(ImportError, match=r"pip install 'gplfd\[warp\]'"):
        importlib.import_module("gplfd_env.envs.warp")
