"""Randomisation through the environment: seeds, options, corners, and that it opens."""

import dataclasses
import itertools
import math
import pickle
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
import pytest
from gymnasium.envs.registration import EnvSpec
from gymnasium.utils.env_checker import data_equivalence
from numpy.testing import assert_allclose

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.randomization import RANDOMIZATIONS
from gplfd_env.doors.variation import Placement, Variation
from gplfd_env.scene.build import GRASP_KEY, build_scene, load_scene
from gplfd_env.spatial.arc import handle_pose_on_arc

pytestmark = pytest.mark.slow

IDS = (gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID)


def variations(env: Any, seed: int, episodes: int = 4) -> list[Variation]:
    drawn = []
    for episode in range(episodes):
        env.reset(seed=seed if episode == 0 else None)
        drawn.append(env.variation)
    return drawn


@pytest.mark.parametrize("id", IDS)
def test_seed_decides_all_that_is_drawn(id: str, make_env: Callable) -> None:
    first, second = (make_env(id=id, randomization="hard") for _ in range(2))
    drawn = variations(first, 11)
    assert variations(second, 11) == drawn
    assert len({one.door.radius for one in drawn}) == 4, "each episode draws anew"
    assert variations(second, 12) != drawn
    for one in drawn:
        assert one.noise.position == RANDOMIZATIONS["hard"].pose_noise[0]


def test_the_length_of_an_episode_does_not_change_the_next(make_env: Callable) -> None:
    """Nor does the noise in it: both come from generators of their own."""
    first, second = (make_env(randomization="hard") for _ in range(2))
    first.reset(seed=5)
    second.reset(seed=5)
    for _ in range(150):
        second.step(np.zeros(6))
    assert data_equivalence(first.reset(), second.reset(), exact=True)
    assert first.variation == second.variation


def test_randomization_shows_in_model_info_and_observation(make_env: Callable) -> None:
    env = make_env("medium", randomization="hard")
    _, info = env.reset(seed=2)
    door = env.variation.door
    assert env.door == door
    assert info["door_radius"] == door.radius != 0.5
    assert env.model.body("door").mass[0] == pytest.approx(door.panel_mass + 0.4)
    assert env.model.joint("hinge").damping[0] == door.hinge_damping
    assert env.model.joint("hinge").frictionloss[0] == door.hinge_friction
    assert door.handle_standoff == 0.07, "what is not varied is the door's own"


@pytest.mark.parametrize("id", IDS)
def test_none_is_the_same_as_no_randomization(id: str, make_env: Callable) -> None:
    """Bit for bit, and it draws nothing: the generator is left to wrappers."""
    plain, none = make_env("heavy", id=id), make_env("heavy", id=id, randomization={})
    assert data_equivalence(plain.reset(seed=3), none.reset(seed=3), exact=True)
    plain.action_space.seed(0)
    for _ in range(15):
        action = plain.action_space.sample()
        assert data_equivalence(plain.step(action), none.step(action), exact=True)
    untouched = np.random.Generator(np.random.PCG64(3)).random()
    assert plain.np_random.random() == none.np_random.random() == untouched
    assert none.variation == Variation(door=DOORS["heavy"])


def test_reset_option_changes_it_from_this_episode_on(make_env: Callable) -> None:
    env, fresh = make_env("small"), make_env("small", randomization="mild")
    env.reset(seed=0)
    changed = env.reset(seed=4, options={"randomization": "mild"})
    assert data_equivalence(changed, fresh.reset(seed=4), exact=True)
    assert data_equivalence(env.reset(), fresh.reset(), exact=True)
    env.reset(options={"randomization": "none", "door": "large"})
    assert env.variation == Variation(door=DoorConfig(radius=0.65))
    with pytest.raises(ValueError, match="did you mean 'hard'"):
        env.reset(options={"randomization": "hrad", "door": "small"})
    env.reset()
    assert env.door.radius == 0.65, "a refused option changes nothing"


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize(
    "randomization",
    ["hard", {"preset": "mild", "radius": [0.35, 0.6]}, {"longest_delay": 2}],
)
def test_spec_survives_json_and_pickle(id: str, randomization: Any) -> None:
    env = gym.make(id, door="large", randomization=randomization, reward="sparse")
    assert env.spec is not None
    env.reset(seed=9)
    for spec in (
        EnvSpec.from_json(env.spec.to_json()),
        pickle.loads(pickle.dumps(env.spec)),
    ):
        assert spec.kwargs == env.spec.kwargs
        twin = gym.make(spec)
        twin.reset(seed=9)
        assert twin.unwrapped.variation == env.unwrapped.variation  # type: ignore[attr-defined]
        twin.close()
    env.close()


@pytest.mark.parametrize("name", ["mild", "hard"])
def test_every_corner_of_a_preset_can_be_held(name: str) -> None:
    """All extremes of what moves the arm: no reset may fail in an odd draw."""
    preset = RANDOMIZATIONS[name]
    model = build_scene(DoorConfig())
    data = mujoco.MjData(model)
    fields = ("base_x", "base_y", "base_yaw", "grasp_height", "grasp_depth")
    widths = [preset.base_position, preset.base_position, preset.base_yaw]
    widths += [preset.grasp_height, preset.grasp_depth]
    for height, signs in itertools.product(
        preset.handle_height or (), itertools.product((-1.0, 1.0), repeat=5)
    ):
        errors = dict(zip(fields, np.multiply(signs, widths), strict=True))
        door = DoorConfig(handle_height=height)
        load_scene(model, data, door, placement=Placement(**errors))
        mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
        mujoco.mj_forward(model, data)
        assert_allclose(data.site("hand").xpos, data.site("task_frame").xpos, atol=1e-4)
        for side in ("right", "left"):
            assert data.sensor(f"{side}_pad_contact").data > 0


def follow_arc(envs: Any, duration: float = 6.0) -> np.ndarray:
    """Open doors along their true arcs; return which succeed, (n,) bool.

    Each arc is turned as the heading error turns it. Nothing is corrected: noise and
    delay do not matter to it, friction, closer and depth of the grasp do.
    """
    pose = np.empty((envs.num_envs, 6))
    success = np.zeros(envs.num_envs, dtype=bool)
    for step in range(1, round((duration + 2.0) / CONTROL_PERIOD) + 1):
        s = min(step * CONTROL_PERIOD / duration, 1.0)
        angle = math.radians(66.0) * (10 * s**3 - 15 * s**4 + 6 * s**5)
        for row, variation in enumerate(envs.variations):
            x, y, z, *turn = handle_pose_on_arc(variation.door.radius, angle)
            yaw = variation.placement.base_yaw
            c, q = math.cos(yaw), math.sin(yaw)
            pose[row] = [c * x - q * z, y, q * x + c * z, *turn]
        *_, infos = envs.step(pose)
        success |= infos["success"]
        if success.all():
            break
    return success


@pytest.mark.parametrize(("name", "n"), [("mild", 4), ("hard", 12)])
def test_the_true_arc_opens_randomized_doors(
    name: str, n: int, make_vec: Callable
) -> None:
    envs = make_vec(n, randomization=name, autoreset_mode="Disabled")
    envs.reset(seed=100)
    assert follow_arc(envs).mean() >= 0.95


def test_presets_are_records_of_plain_numbers() -> None:
    for preset in RANDOMIZATIONS.values():
        values = dataclasses.asdict(preset)
        assert type(values.pop("doors")) is str
        for value in values.values():
            entries = value if isinstance(value, tuple) else [value]
            assert all(
                entry is None or type(entry) in (float, int) for entry in entries
            )
