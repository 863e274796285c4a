"""The vector environment: registration, what stands still, pictures, seeds."""

import copy
from typing import Any

import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from gymnasium.vector import AutoresetMode
from numpy.testing import assert_array_equal

import gplfd_env

pytestmark = pytest.mark.slow

IMPEDANCE = gplfd_env.IMPEDANCE_ENVIRONMENT_ID
PULL = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])


def test_ended_simulations_stand_still_until_reset(make_vec):
    """Disabled autoreset: the others go on as if alone."""
    envs, alone = (make_vec(n, autoreset_mode="Disabled") for n in (3, 1))
    envs.reset(seed=0)
    alone.reset(seed=2)
    actions = np.stack([PULL, 0.1 * PULL, np.zeros(6)])
    kept: Any = None
    for step in range(120):
        result = envs.step(actions)
        expected = alone.step(actions[2:])
        assert_array_equal(result[0]["ee_pose"][2:], expected[0]["ee_pose"])
        if kept is not None:
            for key, value in result[0].items():
                assert_array_equal(value[0], kept[0][key][0])
            assert_array_equal(envs.qpos[0], kept[1])
            assert (result[1][0], result[2][0]) == (0.0, True)
            assert result[4]["failure"][0] == "grasp_lost"
        elif result[2][0]:
            assert step < 100
            kept = result[0], envs.qpos[0]
    assert result[2].tolist() == [True, False, False]
    mask = np.array([True, False, False])
    observations, infos = envs.reset(options={"reset_mask": mask})
    assert_array_equal(observations["time"][:, 0], [0.0, 1.2, 1.2])
    assert_array_equal(infos["_door_angle"], mask)
    observations, *_ = envs.step(actions)
    assert observations["time"][:, 0] == pytest.approx([0.01, 1.21, 1.21])


@pytest.mark.needs("opengl")
def test_render_returns_a_picture_of_each(make_vec, start_env):
    """The same as of single environments; drawing does not reach the simulations."""
    look = {"render_mode": "rgb_array", "width": 64, "height": 48}
    doors = ["small", "large"]
    envs, unseen = make_vec(2, door=doors, **look), make_vec(2, door=doors)
    pulls = np.outer((0.05, 0.02), PULL)
    for each in (envs, unseen):
        each.reset(seed=0)
        for _ in range(60):
            each.step(pulls)
    for row, (picture, door) in enumerate(zip(envs.render(), doors, strict=True)):
        single = start_env(door, **look)
        closed = single.render()
        for _ in range(60):
            single.step(pulls[row])
        # Drawn 2 ms apart: a single environment draws what its sensors saw.
        apart = np.abs(picture.astype(int) - single.render()).mean()
        assert apart < 0.1 * np.abs(picture.astype(int) - closed).mean()
    results = (each.step(np.zeros((2, 6))) for each in (envs, unseen))
    assert data_equivalence(*results, exact=True)


def test_an_edited_model_counts_from_then_on(make_vec):
    """Also in a copy and with another door; the other simulation goes on as before."""
    envs, twin = make_vec(2), make_vec(2)
    for each in (envs, twin):
        each.reset(seed=0)
        each.step(np.stack(2 * [PULL]))
    envs.models[0].actuator_gainprm[0, 0] = envs.models[0].dof_damping[0] = 0.0
    envs = copy.deepcopy(envs)
    for _ in range(10):
        hands, others = (x.step(np.stack(2 * [PULL]))[0] for x in (envs, twin))
    assert hands["ee_pose"][0, 0] < 0.7 * others["ee_pose"][0, 0]
    assert_array_equal(hands["ee_pose"][1], others["ee_pose"][1])
    envs.reset(options={"door": "large"})
    assert envs.models[0].dof_damping[0] == 0.0


@pytest.mark.parametrize("mode", [AutoresetMode.DISABLED, AutoresetMode.NEXT_STEP])
def test_actions_of_ended_simulations_are_ignored(mode, make_vec):
    """Also if they are not numbers, as of a policy that divides by what is left."""
    given = {"id": IMPEDANCE, "autoreset_mode": mode, "max_episode_steps": 3}
    envs, twin = (make_vec(2, **given) for _ in range(2))
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
