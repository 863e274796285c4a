"""Episodes that begin before the handle, and a gripper that is commanded."""

from typing import Any

import numpy as np
import pytest

import gplfd_env
from gplfd_env.conventions.constants import GRIPPER_WIDTH
from gplfd_env.doors.config import BAR_RADIUS
from gplfd_env.doors.variation import Standoff
from gplfd_env.robot.gripper import AT_HANDLE
from gplfd_env.robot.placement import standoff_pose
from gplfd_env.robot.tiago import TIAGO_LIKE

pytestmark = pytest.mark.slow

POSE, GRIPPER = gplfd_env.ENVIRONMENT_ID, gplfd_env.GRIPPER_ENVIRONMENT_ID
REACH, CLOSE = 120, 90
"""Control periods to the handle, and until the fingers are closed."""


def command(env: Any, pose: np.ndarray, width: float = 0.0) -> np.ndarray:
    return np.append(pose, width) if env.action_space.shape == (7,) else pose


def hold(env: Any, action: np.ndarray, n: int) -> Any:
    """Return the last of n equal steps, none of which ends the episode."""
    for _ in range(n):
        result = env.step(action)
        assert not result[2]
    return result


def take_hold(env: Any, seed: int = 0) -> dict[str, Any]:
    """Reach in a minimum-jerk motion, close the gripper; return the last info."""
    start = env.reset(seed=seed)[0]["ee_pose"]
    for step in range(REACH + CLOSE):
        width, s = GRIPPER_WIDTH if step < REACH else 0.0, min(step / REACH, 1.0)
        pose = start * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2))
        action = command(env, pose, width)
        _, _, terminated, _, info = env.step(action)
        assert not terminated
        # A finger that has just touched may bounce; a stage is kept.
        if info["capability"] == 0:
            assert (info["grasped"], info["slip"]) == (False, 0.0)
    return dict(info)


def test_it_begins_with_the_open_hand_before_the_handle(make_env):
    env = make_env(id=GRIPPER, start="approach")
    observation, info = env.reset(seed=0)
    pose = observation["ee_pose"]
    assert env.variation.standoff == Standoff()
    assert np.linalg.norm(pose[:3]) == pytest.approx(0.15, abs=1e-9)
    assert pose[3:] == pytest.approx(np.zeros(3), abs=1e-9)
    assert pose[0] > 0.1, "on the robot's side of the door"
    assert observation["gripper_width"] == pytest.approx(GRIPPER_WIDTH)
    assert observation["grasped"] == 0.0
    assert np.abs(observation["wrench"]).max() < 0.1
    assert (info["capability"], info["stage"]) == (0, "not grasped")
    assert (info["grasped"], info["slip"], info["failure"]) == (False, 0.0, "")


def test_where_it_begins_is_drawn_and_nothing_else_changes(make_env):
    arguments = {"randomization": "mild", "disturbance": "push"}
    env, other = make_env(start="approach", **arguments), make_env(**arguments)
    drawn = []
    for seed in (*range(8), 3):
        observation, _ = env.reset(seed=seed)
        other.reset(seed=seed)
        variation, standoff = env.variation, env.variation.standoff
        for name in ("door", "placement", "noise", "delay", "disturbance"):
            assert getattr(variation, name) == getattr(other.variation, name)
        assert 0.10 <= standoff.distance <= 0.20
        pose = standoff_pose(env.door, standoff, TIAGO_LIKE)
        assert np.linalg.norm(pose[:3]) == pytest.approx(standoff.distance)
        assert observation["ee_pose"] == pytest.approx(pose, abs=0.01)
        drawn.append((standoff.distance, standoff.aside, standoff.above))
    assert np.ptp(drawn, axis=0) == pytest.approx([0.1, 0.5, 0.5], rel=0.5)
    assert drawn[-1] == drawn[3]


@pytest.mark.parametrize(
    ("id", "door", "base"),
    [
        (POSE, "medium", "fixed"),
        (GRIPPER, "room-834", "mobile"),
        (POSE, {"handle": "knob", "latch": "spring"}, "mobile"),
    ],
)
def test_the_handle_can_be_reached_and_taken(id, door, base, make_env):
    env = make_env(door, id=id, base=base, start="approach", randomization="mild")
    info = take_hold(env, seed=1)
    assert (info["grasped"], info["failure"]) == (True, "")
    assert info["slip"] < 0.003
    assert info["base_pose"] == pytest.approx(np.zeros(3), abs=0.002)


@pytest.mark.parametrize("id", [POSE, GRIPPER])
def test_taken_it_is_opened_as_ever_and_released(id, make_env, arc_commands):
    env = make_env("small", id=id, start="approach")
    take_hold(env)
    for pose in arc_commands(0.35, duration=4.0):
        _, _, terminated, _, info = env.step(command(env, pose))
        if terminated:
            break
    assert (info["success"], info["stage"]) == (True, "held")
    assert info["slip"] < 0.002
    if id == GRIPPER:
        for _ in range(80):
            *_, info = env.step(command(env, pose, GRIPPER_WIDTH))
        assert info["stage"] == "released"


def test_a_gripper_that_nobody_commands_closes_at_the_handle(make_env):
    """Neither before it, nor turned away from it."""
    env = make_env(start="approach")
    pose = env.reset(seed=0)[0]["ee_pose"]
    fingers = [f"gripper_{side}_finger_joint" for side in ("left", "right")]
    places = [int(env.model.joint(name).qposadr[0]) for name in fingers]
    away = 1.5 * AT_HANDLE[0] * pose / np.linalg.norm(pose)
    turned = np.array([0.0, 0.0, 0.0, 1.5 * AT_HANDLE[1], 0.0, 0.0])
    for target, width in (
        (away, GRIPPER_WIDTH),
        (turned, GRIPPER_WIDTH),
        (np.zeros(6), 2.0 * BAR_RADIUS),
    ):
        *_, info = hold(env, target, 150)
        assert env.data.qpos[places].sum() == pytest.approx(width, abs=1e-3)
        assert info["grasped"] == (width < GRIPPER_WIDTH)


def test_an_opened_gripper_lets_the_handle_go_and_takes_it_again(start_env):
    env = start_env(id=GRIPPER)
    for width, grasped in ((0.0, True), (GRIPPER_WIDTH, False), (0.0, True)):
        observation, *_, info = hold(env, np.append(np.zeros(6), width), 120)
        assert info["grasped"] == grasped == bool(observation["grasped"][0])
        held = 2.0 * BAR_RADIUS if grasped else GRIPPER_WIDTH
        assert observation["gripper_width"] == pytest.approx(held, abs=1e-3)
    assert info["failure"] == ""


def test_what_does_not_go_together_is_refused(make_env):
    weld = '"weld" does not go with start="approach"'
    with pytest.raises(ValueError, match=weld):
        make_env(start="approach", grasp="weld")
    env, pushed = make_env(start="approach"), {"door": {"swing": "push"}}
    with pytest.raises(ValueError, match=r'pushed .*; give base="mobile"'):
        env.reset(options=pushed)
    make_env(**pushed, start="approach", base="mobile").reset(seed=0)
