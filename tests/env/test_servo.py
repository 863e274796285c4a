"""The Cartesian servo: stiffness, straight axes, and effort limits that hold."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.robot.model import COMMAND_LIMITS
from gplfd_env.robot.placement import ARM_JOINTS
from gplfd_env.scene.build import GRASP_KEY
from gplfd_env.spatial.arc import handle_pose_on_arc

EFFORT_LIMITS = np.array([43.0, 43.0, 26.0, 26.0, 3.0, 6.6, 6.6])


@pytest.mark.parametrize("seed", range(4))
def test_efforts_stay_within_limits_under_violent_commands(
    seed: int, make_env: Callable
) -> None:
    """Every physics step; the efforts include carrying the arm's weight."""
    env = make_env("medium")
    env.reset(seed=0)
    rng = np.random.default_rng(seed)
    joints = [int(env.model.joint(name).dofadr[0]) for name in ARM_JOINTS]
    share = np.zeros(7)
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


def test_weight_counts_against_the_effort_limit(
    make_env: Callable, release_handle: Callable
) -> None:
    """With the limits below the weight's torques the arm sinks: no hidden helper."""
    env = make_env("medium")
    env.reset(seed=0)
    release_handle(env)
    for name in ARM_JOINTS:
        env.model.jnt_actfrcrange[env.model.joint(name).id] = (-0.5, 0.5)
    start = env.data.site("hand").xpos[2]
    for _ in range(60):
        env.step(np.zeros(6))
    assert env.data.site("hand").xpos[2] < start - 0.05


def test_commands_beyond_the_action_space_are_clamped(make_env: Callable) -> None:
    env, twin = make_env("medium"), make_env("medium")
    env.reset(seed=0)
    twin.reset(seed=0)
    for _ in range(5):
        observation, *_ = env.step(10.0 * env.action_space.high)
        expected, *_ = twin.step(env.action_space.high)
    for key in expected:
        assert_allclose(observation[key], expected[key], rtol=0, atol=0)
    assert_allclose(
        env.action_space.high, [COMMAND_LIMITS[0]] * 3 + [COMMAND_LIMITS[1]] * 3
    )


@pytest.mark.parametrize("axis", range(6))
def test_hand_follows_each_axis_of_the_command(
    axis: int, make_env: Callable, release_handle: Callable
) -> None:
    """From the middle of the opening, where the arm is far from singular."""
    env = make_env(0.5)
    env.reset(seed=0)
    release_handle(env)
    middle = handle_pose_on_arc(0.5, np.radians(35.0))
    step = np.zeros(6)
    step[axis] = 0.03 if axis < 3 else 0.1
    for k in range(600):
        blend = min(1.0, k / 200)
        shift = min(1.0, max(0.0, (k - 250) / 100))
        observation, *_ = env.step(blend * middle + shift * step)
    assert_allclose(observation["ee_pose"][:3], (middle + step)[:3], atol=2e-3)
    # Rotation vectors are compared as rotations.
    reached = Rotation.from_rotvec(observation["ee_pose"][3:])
    wanted = Rotation.from_rotvec((middle + step)[3:])
    assert (reached.inv() * wanted).magnitude() < 0.02


def test_observed_pose_and_twist_belong_together(
    make_env: Callable, release_handle: Callable
) -> None:
    """The twist is the pose's derivative, both in the task frame."""
    env = make_env(0.5)
    env.reset(seed=0)
    release_handle(env)
    rows = []
    for step in range(150):
        s = min(1.0, step / 120)
        command = [0.2 * s, 0.05 * s, -0.1 * s, 0.2 * s, 0.4 * s, -0.1 * s]
        observation, *_ = env.step(np.array(command))
        rows.append(np.concatenate([observation["ee_pose"], observation["ee_twist"]]))
    log = np.array(rows)
    pose, twist = log[:, :6], log[:, 6:]
    velocity = (pose[2:, :3] - pose[:-2, :3]) / (2 * CONTROL_PERIOD)
    turn = (
        Rotation.from_rotvec(pose[2:, 3:]) * Rotation.from_rotvec(pose[:-2, 3:]).inv()
    )
    spin = turn.as_rotvec() / (2 * CONTROL_PERIOD)
    assert np.abs(velocity).max() > 0.1
    assert np.abs(spin).max() > 0.2
    assert_allclose(twist[40:-1, :3], velocity[39:], atol=5e-3)
    assert_allclose(twist[40:-1, 3:], spin[39:], atol=2e-2)


def test_observation_is_the_state_one_physics_step_ago(make_env: Callable) -> None:
    """A period is five steps of 2 ms; the sensors sample before the last of them."""
    env, twin = make_env("small"), make_env("small")
    env.reset(seed=0)
    twin.reset(seed=0)
    command = handle_pose_on_arc(0.35, 0.02)
    joints = [int(env.model.joint(name).qposadr[0]) for name in ARM_JOINTS]
    for number in range(1, 4):
        twin.data.ctrl[:6] = command
        mujoco.mj_step(twin.model, twin.data, nstep=4)
        observation, *_ = env.step(command)
        assert np.array_equal(observation["joint_pos"], twin.data.qpos[joints])
        assert np.array_equal(observation["joint_vel"], twin.data.qvel[joints])
        mujoco.mj_step(twin.model, twin.data)
        assert np.array_equal(env.data.qpos, twin.data.qpos)
        assert observation["time"] == pytest.approx([number * CONTROL_PERIOD])
        assert env.data.time == pytest.approx(number * CONTROL_PERIOD)


def test_reset_state_is_at_rest(make_env: Callable) -> None:
    env = make_env("large")
    observation, _ = env.reset(seed=0)
    assert_allclose(observation["ee_pose"], 0.0, atol=5e-4)
    assert_allclose(observation["ee_twist"], 0.0, atol=1e-12)
    assert_allclose(observation["wrench"], 0.0, atol=0.05)
    assert observation["time"] == [0.0]
    assert_allclose(env.data.qpos, env.model.key_qpos[GRASP_KEY])
