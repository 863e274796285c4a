"""Episodes that begin before the handle, and a gripper that is commanded."""

import copy
from collections.abc import Callable
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence

import gplfd_env
from gplfd_env.conventions.constants import CONTROL_PERIOD, GRIPPER_WIDTH
from gplfd_env.doors.config import BAR_RADIUS
from gplfd_env.doors.variation import Standoff
from gplfd_env.robot.gripper import AT_HANDLE, SPEED
from gplfd_env.robot.placement import standoff_pose
from gplfd_env.scene.build import build_scene
from gplfd_env.task.opening import (
    FAILURES,
    GRASP_LOST_TIME,
    STALL_TIME,
    OpeningMonitor,
)

pytestmark = pytest.mark.slow

GRIPPER = gplfd_env.GRIPPER_ENVIRONMENT_ID
REACH = 1.2
CLOSE = 0.9
LEFT_RIGHT = ("left", "right")


def reached(start: np.ndarray, time: float) -> np.ndarray:
    """Return a minimum-jerk command from where the hand began to the handle."""
    s = min(time / REACH, 1.0)
    return start[:6] * (1.0 - s**3 * (10.0 - 15.0 * s + 6.0 * s**2))


def command(env: Any, pose: np.ndarray, width: float) -> np.ndarray:
    return np.append(pose, width) if env.action_space.shape == (7,) else pose


def take_hold(env: Any, seed: int = 0) -> dict[str, Any]:
    """Reach for the handle and close the gripper; return the last info."""
    observation, info = env.reset(seed=seed)
    start = observation["ee_pose"]
    for step in range(round((REACH + CLOSE) / CONTROL_PERIOD)):
        time = step * CONTROL_PERIOD
        width = GRIPPER_WIDTH if time < REACH else 0.0
        _, _, terminated, _, info = env.step(command(env, reached(start, time), width))
        assert not terminated
        # A finger that has just touched may bounce; a stage is kept.
        assert (info["capability"] > 0) or not info["grasped"]
        assert (info["capability"] > 0) or info["slip"] == 0.0
    return dict(info)


def test_it_begins_with_the_open_hand_before_the_handle(make_env: Callable) -> None:
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


def test_where_it_begins_is_drawn_and_nothing_else_changes(make_env: Callable) -> None:
    arguments = {"randomization": "mild", "disturbance": "push"}
    env, other = make_env(start="approach", **arguments), make_env(**arguments)
    drawn = []
    for seed in range(12):
        observation, _ = env.reset(seed=seed)
        other.reset(seed=seed)
        variation, standoff = env.variation, env.variation.standoff
        for name in ("door", "placement", "noise", "delay", "disturbance"):
            assert getattr(variation, name) == getattr(other.variation, name)
        assert 0.10 <= standoff.distance <= 0.20
        pose = standoff_pose(env.door, standoff, "fixed")
        assert np.linalg.norm(pose[:3]) == pytest.approx(standoff.distance)
        assert observation["ee_pose"] == pytest.approx(pose, abs=0.01)
        drawn.append((standoff.distance, standoff.aside, standoff.above))
    assert np.ptp(drawn, axis=0) == pytest.approx([0.1, 0.5, 0.5], rel=0.5)
    env.reset(seed=3)
    first = env.variation
    env.reset(seed=3)
    assert env.variation == first


def test_left_and_above_are_the_robot_s() -> None:
    door = gplfd_env.DoorConfig()
    straight = standoff_pose(door, Standoff(), "fixed")
    left = standoff_pose(door, Standoff(aside=0.2), "fixed") - straight
    above = standoff_pose(door, Standoff(above=0.2), "fixed") - straight
    assert left[2] > 0.02
    assert left[1] == 0.0
    assert above[1] == pytest.approx(0.15 * np.sin(0.2))


@pytest.mark.parametrize(
    ("id", "door", "base"),
    [
        (gplfd_env.ENVIRONMENT_ID, "medium", "fixed"),
        (GRIPPER, "room-834", "mobile"),
        (gplfd_env.ENVIRONMENT_ID, {"handle": "knob", "latch": "spring"}, "mobile"),
    ],
)
def test_the_handle_can_be_reached_and_taken(
    id: str, door: Any, base: str, make_env: Callable
) -> None:
    env = make_env(door, id=id, base=base, start="approach", randomization="mild")
    for seed in range(2):
        info = take_hold(env, seed)
        assert info["grasped"]
        assert info["failure"] == ""
        assert info["slip"] < 0.003
        assert info["base_pose"] == pytest.approx(np.zeros(3), abs=0.002)


@pytest.mark.parametrize("id", [gplfd_env.ENVIRONMENT_ID, GRIPPER])
def test_taken_it_is_opened_as_ever(
    id: str, make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env("small", id=id, start="approach")
    take_hold(env)
    for pose in arc_commands(0.35, duration=5.0):
        _, _, terminated, _, info = env.step(command(env, pose, 0.0))
        if terminated:
            break
    assert info["success"]
    assert info["slip"] < 0.002


def test_a_gripper_that_nobody_commands_closes_at_the_handle(
    make_env: Callable,
) -> None:
    env = make_env(start="approach")
    observation, _ = env.reset(seed=0)
    direction = observation["ee_pose"] / np.linalg.norm(observation["ee_pose"])
    fingers = [env.model.joint(f"gripper_{side}_finger_joint") for side in LEFT_RIGHT]
    places = [int(finger.qposadr[0]) for finger in fingers]
    for distance, width in (
        (1.5 * AT_HANDLE[0], GRIPPER_WIDTH),
        (0.0, 2.0 * BAR_RADIUS),
    ):
        for _ in range(150):
            _, _, _, _, info = env.step(distance * direction)
        assert env.data.qpos[places].sum() == pytest.approx(width, abs=1e-3)
        assert info["grasped"] == (distance == 0.0)


def test_a_turned_hand_is_not_at_the_handle(make_env: Callable) -> None:
    env = make_env(start="approach")
    start = env.reset(seed=0)[0]["ee_pose"]
    turned = np.array([0.0, 0.0, 0.0, 1.5 * AT_HANDLE[1], 0.0, 0.0])
    for step in range(200):
        *_, info = env.step(reached(start, step * CONTROL_PERIOD) + turned)
    assert not info["grasped"]


def test_who_does_not_take_hold_is_told_so_and_may_go_on(make_env: Callable) -> None:
    env = make_env(start="approach")
    pose = env.reset(seed=0)[0]["ee_pose"]
    periods = round(STALL_TIME / CONTROL_PERIOD)
    for step in range(1, periods + 2):
        _, _, terminated, _, info = env.step(pose)
        assert not terminated
        assert (info["failure"] == "not_grasped") == (step >= periods + 1)
    assert info["reason"] == "not_grasped"
    assert info["capability"] == 0
    for step in range(round((REACH + CLOSE) / CONTROL_PERIOD)):
        *_, info = env.step(reached(pose, step * CONTROL_PERIOD))
    assert (info["failure"], info["stage"]) == ("", "unlatched")


def test_a_handle_that_was_taken_can_be_lost(make_env: Callable) -> None:
    env = make_env({"closer_preload": 30.0}, start="approach")
    take_hold(env)
    away = np.array([0.3, 0.0, 0.0, 0.0, 0.0, 0.0])
    for _ in range(300):
        _, _, terminated, _, info = env.step(away)
        if terminated:
            break
    assert terminated
    assert info["failure"] == "grasp_lost"


def test_letting_go_on_purpose_is_no_loss() -> None:
    monitor, lost = OpeningMonitor(), OpeningMonitor()
    for _ in range(round(GRASP_LOST_TIME / 0.01)):
        monitor.update(0.1, False, opened=True)
        lost.update(0.1, False, opened=False)
    assert (FAILURES[monitor.failure], monitor.taken) == ("", False)
    assert FAILURES[lost.failure] == "grasp_lost"
    monitor.update(0.1, True, opened=False)
    assert monitor.taken
    for _ in range(round(GRASP_LOST_TIME / 0.01)):
        monitor.update(0.1, False, opened=False)
    assert FAILURES[monitor.failure] == "grasp_lost"


def test_an_opened_gripper_lets_the_handle_go_and_takes_it_again(
    make_env: Callable,
) -> None:
    env = make_env(id=GRIPPER)
    env.reset(seed=0)
    for width, grasped in ((0.0, True), (GRIPPER_WIDTH, False), (0.0, True)):
        for _ in range(120):
            observation, _, terminated, _, info = env.step(
                np.append(np.zeros(6), width)
            )
            assert not terminated
        assert info["grasped"] == grasped == bool(observation["grasped"][0])
        held = 2.0 * BAR_RADIUS if grasped else GRIPPER_WIDTH
        assert observation["gripper_width"] == pytest.approx(held, abs=1e-3)
    assert info["failure"] == ""


def test_a_door_that_was_held_open_is_released(
    make_env: Callable, arc_commands: Callable
) -> None:
    env = make_env("small", id=GRIPPER)
    env.reset(seed=0)
    for pose in arc_commands(0.35, duration=4.0):
        _, _, terminated, _, info = env.step(np.append(pose, 0.0))
        if terminated:
            break
    assert info["stage"] == "held"
    for _ in range(80):
        *_, info = env.step(np.append(pose, GRIPPER_WIDTH))
    assert info["stage"] == "released"


def test_one_finger_is_no_grasp(make_env: Callable) -> None:
    env = make_env(id=GRIPPER)
    env.reset(seed=0)
    aside, said = np.array([0.0, 0.0, 0.02, 0.0, 0.0, 0.0]), []
    for step in range(300):
        width = GRIPPER_WIDTH if step < 150 else 0.0
        observation, *_, info = env.step(np.append(aside, width))
        touching = np.linalg.norm(observation["wrench"][:3]) > 1.0
        assert bool(observation["grasped"][0]) == info["grasped"]
        said.append((touching and step > 150, info["grasped"]))
    assert (True, False) in said


def test_fingers_close_no_faster_than_the_gripper_s(make_env: Callable) -> None:
    env = make_env(id=GRIPPER, start="approach")
    pose = env.reset(seed=0)[0]["ee_pose"]
    widths = [env.step(np.append(pose, 0.0))[0]["gripper_width"][0] for _ in range(120)]
    rates = -np.diff(widths) / CONTROL_PERIOD
    assert rates.max() == pytest.approx(SPEED, rel=0.02)
    assert widths[-1] == pytest.approx(0.0, abs=1e-3)


@pytest.mark.bits
def test_closed_it_is_the_environment_without_a_gripper(
    make_env: Callable, arc_commands: Callable
) -> None:
    env, plain = (
        make_env(id=GRIPPER, randomization="hard"),
        make_env(randomization="hard"),
    )
    first, second = env.reset(seed=2), plain.reset(seed=2)
    for pose in arc_commands(0.4, duration=1.0):
        for key, value in second[0].items():
            assert np.array_equal(first[0][key], value)
        assert data_equivalence(first[-1], second[-1], exact=True)
        first, second = env.step(np.append(pose, 0.0)), plain.step(pose)


@pytest.mark.bits
@pytest.mark.parametrize(
    ("id", "arrays_from"), [(gplfd_env.ENVIRONMENT_ID, 2), (GRIPPER, 2), (GRIPPER, 100)]
)
def test_many_are_as_one(
    id: str, arrays_from: int, make_vec: Callable, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("gplfd_env.task.episodes.MANY", arrays_from)
    doors = ["room-834", "medium", "small"]
    arguments = {"randomization": "mild", "base": "mobile", "start": "approach"}
    ours = make_vec(3, id=id, door=doors, **arguments)
    singles = [gym.make(id, door=door, **arguments) for door in doors]
    together, infos = ours.reset(seed=4)
    alone = [one.reset(seed=4 + row) for row, one in enumerate(singles)]
    start = together["ee_pose"].copy()
    for step in range(220):
        for row, (observation, *_, info) in enumerate(alone):
            for key, value in observation.items():
                assert np.array_equal(together[key][row], value), key
            for key in ("grasped", "slip", "capability", "door_angle"):
                assert infos[key][row] == info[key]
        actions = np.repeat(ours.single_action_space.high[None], 3, axis=0)
        for row in range(3):
            actions[row, :6] = reached(start[row], step * CONTROL_PERIOD)
        if id == GRIPPER:
            actions[:, 6] = GRIPPER_WIDTH if step < 110 else 0.0
        together, *_, infos = ours.step(actions)
        alone = [one.step(row) for one, row in zip(singles, actions, strict=True)]
    assert infos["grasped"].all()
    for one in singles:
        one.close()


@pytest.mark.bits
def test_copies_close_alike(make_env: Callable) -> None:
    env = make_env(id=GRIPPER, start="approach", randomization="mild")
    pose = env.reset(seed=0)[0]["ee_pose"]
    for _ in range(20):
        env.step(np.append(pose, 0.0))
    other = copy.deepcopy(env)
    for _ in range(20):
        action = np.append(pose, 0.0)
        assert data_equivalence(env.step(action), other.step(action), exact=True)


def test_a_late_command_finds_the_hand_where_it_began(make_env: Callable) -> None:
    late = {"shortest_delay": 10, "longest_delay": 10}
    env = make_env(id=GRIPPER, start="approach", randomization=late)
    pose = env.reset(seed=0)[0]["ee_pose"]
    for _ in range(10):
        observation, *_ = env.step(np.zeros(7))
    assert observation["ee_pose"] == pytest.approx(pose, abs=2e-3)
    assert observation["gripper_width"] == pytest.approx(GRIPPER_WIDTH, abs=1e-4)


def test_another_standoff_is_another_keyframe(make_env: Callable) -> None:
    env = make_env(start="approach")
    fixed = env.reset(seed=0)[0]
    env.reset(seed=1, options={"randomization": "mild"})
    again = env.reset(seed=0, options={"randomization": "none"})[0]
    assert data_equivalence(fixed, again, exact=True)


def test_what_does_not_go_together_is_refused(make_env: Callable) -> None:
    with pytest.raises(ValueError, match=r'"weld" does not go with start="approach"'):
        make_env(start="approach", grasp="weld")
    with pytest.raises(ValueError, match=r'"weld" does not go with a commanded grip'):
        make_env(id=GRIPPER, grasp="weld")
    with pytest.raises(ValueError, match="start = 'away' is not one of 'grasped', 'ap"):
        make_env(start="away")
    pushed = {"swing": "push"}
    with pytest.raises(ValueError, match=r'pushed .*; give base="mobile"'):
        make_env(pushed, start="approach")
    with pytest.raises(ValueError, match=r'pushed .*; give base="mobile"'):
        make_env(start="approach").reset(options={"door": pushed})
    make_env(pushed, start="approach", base="mobile").reset(seed=0)


def test_a_hand_that_cannot_be_drawn_back_is_refused() -> None:
    low = gplfd_env.DoorConfig(handle="lever", handle_height=0.6)
    far = Standoff(distance=0.2, aside=0.25)
    build_scene(low, "gripper", standoff=Standoff(distance=0.1), base="mobile")
    with pytest.raises(ValueError, match=r"cannot draw the hand back .* by 0\.20 m"):
        build_scene(low, "gripper", standoff=far, base="mobile")


@pytest.mark.parametrize("id", [gplfd_env.ENVIRONMENT_ID, GRIPPER])
def test_gymnasium_s_checker_has_its_one_remark(id: str, make_env: Callable) -> None:
    env = make_env(id=id, start="approach", randomization="hard")
    with pytest.warns(UserWarning, match="normalized") as caught:
        check_env(env, skip_render_check=True)
    assert len(caught) == 1


def test_learners_may_begin_there_too(make_rl: Callable) -> None:
    env = make_rl(start="approach")
    observation, info = env.reset(seed=0)
    assert env.observation_space.contains(observation)
    assert info["stage"] == "not grasped"
