"""The vector environment: registration, what stands still, wrappers, wrong uses."""

from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_array_equal

import gplfd_env
from gplfd_env.envs.vector import DoorOpeningImpedanceVectorEnv, DoorOpeningVectorEnv

pytestmark = pytest.mark.slow

IDS = {
    gplfd_env.ENVIRONMENT_ID: DoorOpeningVectorEnv,
    gplfd_env.IMPEDANCE_ENVIRONMENT_ID: DoorOpeningImpedanceVectorEnv,
}
PULL = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])


@pytest.mark.parametrize("prefix", ["", "gplfd_env:"])
@pytest.mark.parametrize("id", IDS)
def test_make_vec_makes_it_by_both_ids(id: str, prefix: str) -> None:
    envs = gym.make_vec(prefix + id, num_envs=3)
    assert type(envs) is IDS[id]
    assert envs.spec is not None
    assert envs.spec.id == id
    assert envs.num_envs == 3
    assert envs.metadata["autoreset_mode"] is AutoresetMode.NEXT_STEP
    single = gym.make(id)
    assert envs.single_action_space == single.action_space
    assert envs.single_observation_space == single.observation_space
    observations, _ = envs.reset(seed=0)
    assert observations in envs.observation_space
    observations, rewards, *_ = envs.step(envs.action_space.sample())
    assert observations in envs.observation_space
    assert (rewards.dtype, rewards.shape) == (np.float64, (3,))
    envs.close()
    single.close()


@pytest.mark.parametrize("mode", list(AutoresetMode))
def test_metadata_tells_the_autoreset_mode(mode: AutoresetMode) -> None:
    by_name = gym.make_vec("gplfd/DoorOpening-v1", 1, autoreset_mode=mode.value)
    by_member = gym.make_vec("gplfd/DoorOpening-v1", 1, autoreset_mode=mode)
    assert by_name.metadata["autoreset_mode"] is mode
    assert by_member.metadata["autoreset_mode"] is mode
    assert DoorOpeningVectorEnv.metadata.get("autoreset_mode") is None, "its own copy"


def test_time_limit_is_the_id_s_and_can_be_changed(make_vec: Callable) -> None:
    for limit, expected in (
        ({}, [1500]),
        ({"max_episode_steps": 4}, [4, 9, 14]),
        ({"max_episode_steps": -1}, []),
    ):
        envs = make_vec(1, **limit)
        envs.reset(seed=0)
        late = [step for step in range(1, 1503) if envs.step(np.zeros((1, 6)))[3][0]]
        assert late[:3] == expected


def test_ended_simulations_stand_still_until_reset(make_vec: Callable) -> None:
    """Disabled autoreset: the others go on as if alone."""
    envs, alone = (make_vec(n, autoreset_mode="Disabled") for n in (3, 1))
    envs.reset(seed=0)
    alone.reset(seed=2)
    actions = np.stack([PULL, 0.1 * PULL, np.zeros(6)])
    ended_at = None
    for step in range(120):
        result = envs.step(actions)
        expected = alone.step(actions[2:])
        assert_array_equal(result[0]["ee_pose"][2:], expected[0]["ee_pose"])
        if ended_at is None and result[2][0]:
            ended_at, kept, place = step, result, envs.qpos[0]
        elif ended_at is not None:
            for key, value in result[0].items():
                assert_array_equal(value[0], kept[0][key][0])
            assert_array_equal(envs.qpos[0], place)
            assert (result[1][0], result[2][0]) == (0.0, True)
            assert result[4]["failure"][0] == "grasp_lost"
    assert ended_at is not None
    assert ended_at < 100
    assert not result[2][1:].any()
    mask = np.array([True, False, False])
    observations, infos = envs.reset(options={"reset_mask": mask})
    assert_array_equal(observations["time"][:, 0], [0.0, 1.2, 1.2])
    assert_array_equal(infos["_door_angle"], mask)
    observations, *_ = envs.step(actions)
    assert observations["time"][:, 0] == pytest.approx([0.01, 1.21, 1.21])


def test_what_is_returned_is_the_caller_s_own(make_vec: Callable) -> None:
    envs, untouched = make_vec(2), make_vec(2)
    kept = [envs.reset(seed=0), untouched.reset(seed=0)]
    for _ in range(5):
        result = envs.step(np.zeros((2, 6)))
        expected = untouched.step(np.zeros((2, 6)))
        assert data_equivalence(result, expected, exact=True)
        for array in (*result[0].values(), *result[1:4], result[4]["handle_pose"]):
            array[:] = 1
        kept.append(expected)
    first = kept[1][0]["time"]
    assert_array_equal(first, [[0.0], [0.0]])


def test_wrappers_of_gymnasium_work_on_it(make_vec: Callable) -> None:
    """Statistics, a flat observation and a normalised action, as learners use them."""
    wrappers = gym.wrappers.vector
    envs = wrappers.RecordEpisodeStatistics(
        wrappers.FlattenObservation(make_vec(2, max_episode_steps=6))
    )
    envs = wrappers.RescaleAction(envs, -1.0, 1.0)
    observations, _ = envs.reset(seed=0)
    assert observations.shape == (2, 6 + 6 + 6 + 7 + 7 + 1)
    assert envs.single_action_space == gym.spaces.Box(-1.0, 1.0, (6,), np.float64)
    total = np.zeros(2)
    for _ in range(6):
        _, rewards, _, truncations, infos = envs.step(np.full((2, 6), 0.01))
        total += rewards
    assert truncations.all()
    assert infos["episode"]["r"] == pytest.approx(total)
    assert_array_equal(infos["episode"]["l"], [6, 6])


@pytest.mark.needs("opengl")
def test_render_returns_a_picture_of_each(
    make_vec: Callable, make_env: Callable
) -> None:
    """The same as of single environments; drawing does not reach the simulations."""
    look = {"render_mode": "rgb_array", "width": 64, "height": 48}
    doors = ["small", "large"]
    envs, unseen = make_vec(2, door=doors, **look), make_vec(2, door=doors)
    envs.reset(seed=0)
    unseen.reset(seed=0)
    shares = (0.05, 0.02)
    pulls = np.outer(shares, PULL)
    for _ in range(60):
        envs.step(pulls)
        unseen.step(pulls)
    pictures = envs.render()
    assert isinstance(pictures, tuple)
    for row, (door, share) in enumerate(zip(doors, shares, strict=True)):
        single = make_env(door, **look)
        single.reset(seed=0)
        closed = single.render()
        for _ in range(60):
            single.step(share * PULL)
        # Drawn 2 ms apart: a single environment draws what its sensors saw.
        apart = np.abs(pictures[row].astype(int) - single.render()).mean()
        assert apart < 0.1 * np.abs(pictures[row].astype(int) - closed).mean()
    results = (each.step(np.zeros((2, 6))) for each in (envs, unseen))
    assert data_equivalence(*results, exact=True)
    with pytest.warns(UserWarning, match='make_vec.*render_mode="rgb_array"'):
        assert unseen.render() is None


def test_properties_tell_doors_and_joints(make_vec: Callable) -> None:
    envs = make_vec(2, door=["small", 0.6], randomization={"panel_mass": (5, 50)})
    assert envs.np_random == ()
    _, infos = envs.reset(seed=4)
    assert [one.door.radius for one in envs.variations] == [0.35, 0.6]
    assert_array_equal(infos["door_radius"], [0.35, 0.6])
    for model, variation in zip(envs.models, envs.variations, strict=True):
        mass = variation.door.panel_mass + 0.4
        assert model.body("door").mass[0] == pytest.approx(mass)
    qpos = envs.qpos
    qpos[:] = 9.0
    assert np.abs(envs.qpos).max() < 3.2, "a copy"
    assert envs.np_random_seed == (4, 5)


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"door": ["small"]}, "door must be one for all .* sequence of 2, got 1"),
        ({"door": ["small", "smal"]}, "unknown door 'smal'"),
        ({"grasp": "glue"}, "grasp = 'glue' is not one of"),
        ({"reward": "shaped"}, "reward = 'shaped' is not one of 'dense', 'sparse'"),
        ({"render_mode": "human"}, "render_mode = 'human' is not one of None, 'rgb_a"),
        ({"autoreset_mode": "Now"}, "'Now' is not one of 'NextStep', 'SameStep', 'Dis"),
        ({"num_threads": -1}, "num_threads = -1 must be a whole number from 0"),
        ({"camera_name": "side"}, "camera_name = 'side' is not one of"),
    ],
)
def test_wrong_arguments(arguments: Any, message: str, make_vec: Callable) -> None:
    with pytest.raises(ValueError, match=message):
        make_vec(2, **arguments)


def test_wrong_number_of_environments() -> None:
    for wrong in (0, -1, 1.5, True):
        with pytest.raises(ValueError, match=r"num_envs = .* whole number from 1"):
            DoorOpeningVectorEnv(wrong)  # type: ignore[arg-type]


@pytest.mark.parametrize("id", IDS)
def test_wrong_actions_move_nothing(id: str, make_vec: Callable) -> None:
    envs = make_vec(2, id=id)
    with pytest.raises(gym.error.ResetNeeded, match=r"call reset\(\) before"):
        envs.step(envs.action_space.sample())
    envs.reset(seed=0)
    before = envs.qpos
    size = envs.single_action_space.shape[0]
    for wrong in (np.zeros(size), np.zeros((3, size)), np.zeros((2, size + 1))):
        with pytest.raises(ValueError, match=rf"must have shape \(2, {size}\)"):
            envs.step(wrong)
    actions = np.zeros((2, size))
    actions[1, 3] = np.nan
    with pytest.raises(ValueError, match=r"must be finite, got .*nan"):
        envs.step(actions)
    assert_array_equal(envs.qpos, before)


def test_a_refused_seed_changes_nothing(make_vec: Callable) -> None:
    envs, untouched = (make_vec(2, randomization="mild") for _ in range(2))
    for each in (envs, untouched):
        each.reset(seed=0)
    for wrong in ([5, -1], [5, 1.5], [5, "a"]):
        with pytest.raises(gym.error.Error, match="Seed must be"):
            envs.reset(seed=wrong, options={"door": "large"})
    assert envs.np_random_seed == (0, 1)
    assert data_equivalence(envs.reset(), untouched.reset(), exact=True)


def test_seeds_may_be_numbers_of_numpy(make_vec: Callable) -> None:
    envs = make_vec(2)
    for seeds, expected in (
        (np.array([3, 2**40]), (3, 2**40)),
        ([np.int64(7), 2**70], (7, 2**70)),
        (np.uint8(255), (255, 256)),
    ):
        envs.reset(seed=seeds)
        assert envs.np_random_seed == expected


@pytest.mark.parametrize("id", IDS)
@pytest.mark.parametrize("mode", [AutoresetMode.DISABLED, AutoresetMode.NEXT_STEP])
def test_actions_of_ended_simulations_are_ignored(
    mode: AutoresetMode, id: str, make_vec: Callable
) -> None:
    """Also if they are not numbers, as of a policy that divides by what is left."""
    envs, twin = (
        make_vec(2, id=id, autoreset_mode=mode, max_episode_steps=3) for _ in range(2)
    )
    for each in (envs, twin):
        each.reset(seed=0)
    rest = np.stack(2 * [envs.command.rest])
    ended = np.zeros(2, dtype=bool)
    for _ in range(8):
        actions = np.where(ended[:, None], np.nan, rest)
        results = envs.step(actions), twin.step(rest)
        assert data_equivalence(*results, exact=True)
        ended = results[0][2] | results[0][3]
    assert np.isfinite(envs.models[0].actuator_gainprm).all()


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        ({"seed": [1, 2, 3]}, r"seed must be .* sequence of 2, got \[1, 2, 3\]"),
        (
            {"options": {"dor": 1}},
            r"unknown reset option\(s\) 'dor'; allowed: \"door\"",
        ),
        ({"options": {"door": ["small"] * 3}}, "a sequence of 2, got 3"),
        ({"options": {"reset_mask": [True]}}, "an array of 2 booleans"),
        ({"options": {"reset_mask": np.array([0, 1])}}, "an array of 2 booleans"),
        ({"options": {"reset_mask": np.array([False] * 2)}}, "at least one True"),
        ({"options": {"randomization": "hrad"}}, "did you mean 'hard'"),
        (
            {"options": {"door": "large", "randomization": "hrad"}},
            "did you mean 'hard'",
        ),
        ({"seed": 1.5}, "seed must be an integer, None or a sequence of 2, got 1.5"),
        ({"seed": "ab"}, "seed must be an integer, None or a sequence of 2, got 'ab'"),
    ],
)
def test_wrong_resets_change_nothing(
    arguments: Any, message: str, make_vec: Callable
) -> None:
    envs, untouched = make_vec(2), make_vec(2)
    for each in (envs, untouched):
        each.reset(seed=0)
    with pytest.raises(ValueError, match=message):
        envs.reset(**arguments)
    results = (each.step(np.full((2, 6), 0.001)) for each in (envs, untouched))
    assert data_equivalence(*results, exact=True)
    assert data_equivalence(envs.reset(), untouched.reset(), exact=True)


def test_the_first_reset_must_reset_all(make_vec: Callable) -> None:
    with pytest.raises(ValueError, match="first reset must reset all simulations"):
        make_vec(2).reset(options={"reset_mask": np.array([True, False])})


def test_an_unreachable_draw_leaves_it_usable(make_vec: Callable) -> None:
    envs, fresh = (make_vec(3, door={"handle_height": 0.5}) for _ in range(2))
    wide = {"base_position": 0.05, "base_yaw": 0.1, "grasp_height": 0.05}
    draw_until_unreachable = (
        envs.reset(seed=seed, options={"randomization": wide}) for seed in range(30)
    )
    with pytest.raises(ValueError, match="cannot hold the closed handle"):
        list(draw_until_unreachable)
    again = envs.reset(seed=1, options={"randomization": "none"})
    assert data_equivalence(again, fresh.reset(seed=1), exact=True)
    results = (each.step(np.full((3, 6), 0.001)) for each in (envs, fresh))
    assert data_equivalence(*results, exact=True)
