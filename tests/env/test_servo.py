"""The Cartesian servo and the wrist: axes, effort limits, what a known load reads."""

from collections.abc import Callable
from typing import Any

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.robot.placement import task_rotation_w
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.spatial.se3 import handle_pose_on_arc

pytestmark = pytest.mark.slow

EFFORT_LIMITS = np.array([43.0, 43.0, 26.0, 26.0, 3.0, 6.6, 6.6])
RADIUS = 0.5


@pytest.fixture
def free(start_env: Callable, release_handle: Callable) -> DoorOpeningEnv:
    """An environment, just reset, whose hand is free."""
    env = start_env(RADIUS)
    release_handle(env)
    return env


def calm(env: DoorOpeningEnv) -> None:
    """Let the arm's self-motion die out quickly; statics do not depend on it."""
    for name in TIAGO_LIKE.arm:
        env.model.joint(name).damping = 2.0


def move_slowly(env: DoorOpeningEnv, pose: np.ndarray, steps: int = 500) -> Any:
    start = env.data.ctrl[:6].copy()
    for step in range(steps):
        share = min(1.0, 2 * (step + 1) / steps)
        observation, *_ = env.step(start + (pose - start) * share)
    return observation


# --- The servo -----------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(2))
def test_efforts_stay_within_limits_under_violent_commands(seed, start_env):
    """Every physics step; the efforts include carrying the arm's weight."""
    env = start_env("medium")
    joints = [int(env.model.joint(name).dofadr[0]) for name in TIAGO_LIKE.arm]
    rng, share = np.random.default_rng(seed), np.zeros(7)
    for step in range(1000):
        if step % 50 == 0:
            env.data.ctrl[:6] = env.action_space.high * rng.choice([-1.0, 1.0], 6)
        mujoco.mj_step(env.model, env.data)
        effort = np.abs(env.data.qfrc_actuator[joints])
        share = np.maximum(share, effort / EFFORT_LIMITS)
    assert np.all(share <= 1.0 + 1e-9)
    assert share.max() == pytest.approx(1.0), "the commands must reach a limit"
    grip = env.data.joint("gripper_right_finger_joint").qfrc_actuator
    assert abs(grip) <= 16.0 + 1e-9
    assert np.isfinite(env.data.qpos).all()


@pytest.mark.parametrize("axis", range(6))
def test_hand_follows_each_axis_of_the_command(axis, free):
    """From the middle of the opening, where the arm is far from singular."""
    middle = handle_pose_on_arc(RADIUS, np.radians(35.0))
    step = np.zeros(6)
    step[axis] = 0.03 if axis < 3 else 0.1
    for k in range(500):
        blend = min(1.0, k / 200)
        shift = min(1.0, max(0.0, (k - 250) / 100))
        observation, *_ = free.step(blend * middle + shift * step)
    assert_allclose(observation["ee_pose"][:3], (middle + step)[:3], atol=2e-3)
    # Rotation vectors are compared as rotations.
    reached = Rotation.from_rotvec(observation["ee_pose"][3:])
    wanted = Rotation.from_rotvec((middle + step)[3:])
    assert (reached.inv() * wanted).magnitude() < 0.02


def test_observed_pose_and_twist_belong_together(free):
    """The twist is the pose's derivative, both in the task frame."""
    pose, twist = np.empty((150, 6)), np.empty((150, 6))
    for step in range(150):
        command = min(1.0, step / 120) * np.array([0.2, 0.05, -0.1, 0.2, 0.4, -0.1])
        observation, *_ = free.step(command)
        pose[step], twist[step] = observation["ee_pose"], observation["ee_twist"]
    velocity = (pose[2:, :3] - pose[:-2, :3]) / (2 * CONTROL_PERIOD)
    turns = Rotation.from_rotvec(pose[:, 3:])
    spin = (turns[2:] * turns[:-2].inv()).as_rotvec() / (2 * CONTROL_PERIOD)
    assert np.abs(velocity).max() > 0.1
    assert np.abs(spin).max() > 0.2
    assert_allclose(twist[40:-1, :3], velocity[39:], atol=5e-3)
    assert_allclose(twist[40:-1, 3:], spin[39:], atol=2e-2)


def test_observation_is_the_state_one_physics_step_ago(start_env):
    """A period is five steps of 2 ms; the sensors sample before the last of them."""
    env, twin = start_env("small"), start_env("small")
    command = handle_pose_on_arc(0.35, 0.02)
    joints = [int(env.model.joint(name).qposadr[0]) for name in TIAGO_LIKE.arm]
    for number in range(1, 4):
        twin.data.ctrl[:6] = command
        mujoco.mj_step(twin.model, twin.data, nstep=4)
        observation, *_ = env.step(command)
        assert_array_equal(observation["joint_pos"], twin.data.qpos[joints])
        assert_array_equal(observation["joint_vel"], twin.data.qvel[joints])
        mujoco.mj_step(twin.model, twin.data)
        assert_array_equal(env.data.qpos, twin.data.qpos)
        assert observation["time"] == pytest.approx([number * CONTROL_PERIOD])
        assert env.data.time == pytest.approx(number * CONTROL_PERIOD)


# --- The wrist -----------------------------------------------------------------------


@pytest.mark.parametrize(
    ("degrees", "turn"),
    [
        (0.0, np.zeros(6)),
        (0.0, np.array([0.0, 0.05, 0.0, -0.2, 0.1, 0.3])),
        (30.0, np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0])),
        (60.0, np.zeros(6)),
        (60.0, np.array([0.0, 0.05, 0.0, -0.2, 0.1, 0.3])),
    ],
)
def test_free_hand_reads_zero_and_a_known_load_reads_right(degrees, turn, free):
    """Load: 1.5 kg hung at the gripper's centre of mass, plus a pure moment."""
    calm(free)
    pose = handle_pose_on_arc(RADIUS, np.radians(degrees)) + turn
    observation = move_slowly(free, pose)
    assert_allclose(observation["ee_pose"], pose, atol=0.05)
    assert_allclose(observation["wrench"], 0.0, atol=2e-3)

    weight_w, moment_w = np.array([0.0, 0.0, -1.5 * 9.81]), np.array([0.2, 0.3, -0.1])
    gripper = free.data.body("gripper_link")
    gripper.xfrc_applied[:] = [*weight_w, *moment_w]
    observation = move_slowly(free, free.data.ctrl[:6].copy())
    lever_w = gripper.xipos - free.data.site("hand").xpos
    to_task = task_rotation_w(free.door, TIAGO_LIKE).T
    force = to_task @ weight_w
    moment = to_task @ (np.cross(lever_w, weight_w) + moment_w)
    assert force[1] == pytest.approx(-14.715), "the weight points down: -y"
    assert np.linalg.norm(np.cross(lever_w, weight_w)) > 1.0
    assert_allclose(observation["wrench"], [*force, *moment], atol=5e-3)


def test_force_on_the_hand_is_minus_the_force_on_the_handle(start_env):
    """Third law between two separate sensors: wrist and bar contact."""
    env = start_env({"closer": {"preload": 6}, "radius": RADIUS, "hinge_friction": 1})
    calm(env)
    target = handle_pose_on_arc(RADIUS, np.radians(35.0))
    target[1] += 0.003
    observation = move_slowly(env, target, steps=800)
    info = env.step(target)[-1]
    sine, cosine = np.sin(info["door_angle"]), np.cos(info["door_angle"])
    on_handle = (
        info["force_tangential"] * np.array([cosine, 0.0, -sine])
        + info["force_radial"] * np.array([sine, 0.0, cosine])
        + info["force_vertical"] * np.array([0.0, 1.0, 0.0])
    )
    assert info["force_tangential"] * RADIUS == pytest.approx(6.0, abs=1.2)
    assert info["force_vertical"] > 1.0
    assert_allclose(observation["wrench"][:3], -on_handle, atol=0.03)
