"""Gymnasium's contract: checker, determinism, spaces, info, rewards."""

import warnings

import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD, SUCCESS_ANGLE
from gplfd_env.spatial.se3 import handle_pose_on_arc

POSE, IMPEDANCE = gplfd_env.ENVIRONMENT_ID, gplfd_env.IMPEDANCE_ENVIRONMENT_ID
MOBILE, GRIPPER = gplfd_env.MOBILE_ENVIRONMENT_ID, gplfd_env.GRIPPER_ENVIRONMENT_ID
# The action is a pose in metres and radians: ±1 m and ±π/2 rad. Normalising it to
# ±1 would hide its units, so this one recommendation is declined.
DECLINED = "For Box action spaces, we recommend using a symmetric and normalized space"


SPARSE = {"randomization": "hard", "reward": "sparse", "disturbance": "person"}


@pytest.mark.parametrize(
    ("id", "arguments"),
    [
        (POSE, {"grasp": "weld"}),
        (POSE, SPARSE),
        (POSE, {"door": 0.9, "base": "mobile"}),
        (POSE, {"start": "approach", "randomization": "hard"}),
        (IMPEDANCE, SPARSE),
        (IMPEDANCE, {"door": 0.9, "base": "mobile", "disturbance": "bump"}),
        (MOBILE, SPARSE),
        (GRIPPER, {"start": "approach", "randomization": "hard"}),
    ],
)
def test_checker_has_one_declined_recommendation_and_no_other_warning(
    id, arguments, make_env
):
    """Rendering, human mode included, is checked in test_rendering.py."""
    env = make_env(id=id, **arguments)
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        check_env(env, skip_render_check=True)
    (message,) = (str(warning.message) for warning in caught)
    assert DECLINED in message


def test_model_and_data_are_the_simulation(start_env):
    env = start_env("small")
    model = env.model
    env.step(np.zeros(6))
    assert env.data.time == pytest.approx(CONTROL_PERIOD)
    env.reset(options={"door": "large"})
    assert env.model is model, "views into model and data stay valid across doors"
    assert model.body("door").pos[2] == pytest.approx(-0.65)
    assert env.dt == CONTROL_PERIOD
    assert env.metadata["render_fps"] == 100


def test_an_opened_door_is_what_reward_and_info_tell(make_env, arc_commands):
    """With either reward: the same door, success after half a second beyond 60°."""
    dense, sparse = make_env(0.42), make_env(0.42, reward="sparse")
    observation, info = dense.reset(seed=0)
    assert sparse.reset(seed=0)[1]["reward_terms"] == {"success": 0.0}
    start, sums, open_steps, bonuses = info["door_angle"], np.zeros(3), 0, []
    for command in arc_commands(0.42, duration=5.0):
        before = info["door_angle"]
        observation, reward, terminated, truncated, info = dense.step(command)
        same, bonus, *_, told = sparse.step(command)
        terms = info["reward_terms"]
        assert list(terms) == ["progress", "radial_force", "success"]
        assert reward == sum(terms.values())
        assert terms["radial_force"] == -1e-5 * abs(info["force_radial"])
        gain = (info["door_angle"] - before) / SUCCESS_ANGLE
        assert terms["progress"] == pytest.approx(gain, abs=1e-12)
        assert data_equivalence(observation, same, exact=True)
        assert told["reward_terms"] == {"success": bonus}
        assert type(bonus) is float
        sums += list(terms.values())
        bonuses.append(bonus)
        assert info["success"] is info["is_success"] is terminated
        assert not truncated
        open_steps += info["door_angle"] >= np.radians(60.0)
        arc = handle_pose_on_arc(0.42, info["door_angle"])
        assert info["handle_pose"] == pytest.approx(arc, abs=1e-12)
        # The hand is on it, up to slip and the turn that friction allows about the bar.
        beside = observation["ee_pose"][:3] - arc[:3]
        assert beside == pytest.approx(np.zeros(3), abs=2e-3)
        assert info["slip"] == pytest.approx(np.linalg.norm(beside), abs=1e-4)
        if terminated:
            break
    assert terminated
    assert open_steps * CONTROL_PERIOD == pytest.approx(0.5)
    assert sums[0] == pytest.approx((info["door_angle"] - start) / SUCCESS_ANGLE)
    assert (sums[0] > 1.0, sums[2]) == (True, 1.0)
    assert bonuses == [*(len(bonuses) - 1) * [0.0], 1.0]
