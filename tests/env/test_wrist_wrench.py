"""The wrist wrench: known loads read right, nothing touched reads zero."""

from collections.abc import Callable

import mujoco
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env.envs.door_opening import DoorOpeningEnv
from gplfd_env.robot.placement import ARM_JOINTS, task_rotation_w
from gplfd_env.spatial.arc import handle_pose_on_arc

RADIUS = 0.5
TURNED = {
    "as on the arc": np.zeros(6),
    "rolled": np.array([0.0, 0.0, 0.0, 0.3, 0.0, 0.0]),
    "turned every way": np.array([0.0, 0.05, 0.0, -0.2, 0.1, 0.3]),
}


def calm(env: DoorOpeningEnv) -> None:
    """Let the arm's self-motion die out quickly; statics do not depend on it."""
    for name in ARM_JOINTS:
        env.model.joint(name).damping = 2.0


def move_slowly(env: DoorOpeningEnv, pose: np.ndarray, steps: int = 500) -> dict:
    start = env.data.ctrl[:6].copy()
    for step in range(steps):
        share = min(1.0, 2 * (step + 1) / steps)
        observation, *_ = env.step(start + (pose - start) * share)
    return observation


@pytest.mark.parametrize("degrees", [0.0, 30.0, 60.0])
@pytest.mark.parametrize("turn", TURNED)
def test_free_hand_reads_zero_and_a_known_load_reads_right(
    turn: str, degrees: float, make_env: Callable, release_handle: Callable
) -> None:
    """Load: 1.5 kg hung at the gripper's centre of mass, plus a pure moment."""
    env = make_env(RADIUS)
    env.reset(seed=0)
    release_handle(env)
    calm(env)
    pose = handle_pose_on_arc(RADIUS, np.radians(degrees)) + TURNED[turn]
    observation = move_slowly(env, pose)
    assert_allclose(observation["ee_pose"], pose, atol=0.05)
    assert_allclose(observation["wrench"], 0.0, atol=2e-3)

    weight_w, moment_w = np.array([0.0, 0.0, -1.5 * 9.81]), np.array([0.2, 0.3, -0.1])
    gripper = env.data.body("gripper_link")
    gripper.xfrc_applied[:] = [*weight_w, *moment_w]
    observation = move_slowly(env, env.data.ctrl[:6].copy())
    lever_w = gripper.xipos - env.data.site("hand").xpos
    to_task = task_rotation_w().T
    force = to_task @ weight_w
    moment = to_task @ (np.cross(lever_w, weight_w) + moment_w)
    assert force[1] == pytest.approx(-14.715), "the weight points down: -y"
    assert np.linalg.norm(np.cross(lever_w, weight_w)) > 1.0
    assert_allclose(observation["wrench"], [*force, *moment], atol=5e-3)


@pytest.mark.parametrize("axis", range(3))
def test_pushing_the_hand_reads_positive_along_the_push(
    axis: int, make_env: Callable, release_handle: Callable
) -> None:
    env = make_env(RADIUS)
    env.reset(seed=0)
    release_handle(env)
    calm(env)
    direction = np.eye(3)[axis]
    force_w = task_rotation_w() @ (8.0 * direction)
    gripper = env.data.body("gripper_link")
    for _ in range(300):
        lever = env.data.site("hand").xpos - gripper.xipos
        gripper.xfrc_applied[:] = [*force_w, *np.cross(lever, force_w)]
        observation, *_ = env.step(np.zeros(6))
    assert_allclose(observation["wrench"][:3], 8.0 * direction, atol=0.01)
    assert_allclose(observation["wrench"][3:], 0.0, atol=0.02)
    # ... and the servo gives way by force over stiffness.
    assert observation["ee_pose"][axis] == pytest.approx(8.0 / 2000.0, rel=0.1)


def test_force_on_the_hand_is_minus_the_force_on_the_handle(make_env: Callable) -> None:
    """Third law between two separate sensors: wrist and bar contact."""
    env = make_env({"closer_preload": 6.0, "radius": RADIUS, "hinge_friction": 1.0})
    env.reset(seed=0)
    calm(env)
    target = handle_pose_on_arc(RADIUS, np.radians(35.0))
    target[1] += 0.003
    observation = move_slowly(env, target, steps=800)
    info = env.step(target)[-1]
    angle = info["door_angle"]
    tangent = np.array([np.cos(angle), 0.0, -np.sin(angle)])
    outward = np.array([np.sin(angle), 0.0, np.cos(angle)])
    on_handle = (
        info["force_tangential"] * tangent
        + info["force_radial"] * outward
        + info["force_vertical"] * np.array([0.0, 1.0, 0.0])
    )
    assert info["force_tangential"] * RADIUS == pytest.approx(6.0, abs=1.2)
    assert info["force_vertical"] > 1.0
    assert_allclose(observation["wrench"][:3], -on_handle, atol=0.03)


def test_sensor_saturates_at_its_range(
    make_env: Callable, release_handle: Callable
) -> None:
    env = make_env(RADIUS)
    env.reset(seed=0)
    release_handle(env)
    env.data.body("gripper_link").xfrc_applied[:3] = [0.0, 0.0, -5000.0]
    observation, *_ = env.step(np.zeros(6))
    assert observation in env.observation_space
    readings = env.data.sensor("wrist_force").data
    assert np.abs(readings).max() == pytest.approx(500.0)


def test_gravity_compensation_carries_the_arm(
    make_env: Callable, release_handle: Callable
) -> None:
    """At rest and untouched the motors exert exactly the arm's weight torques."""
    env = make_env(RADIUS)
    env.reset(seed=0)
    release_handle(env)
    calm(env)
    move_slowly(env, np.zeros(6))
    joints = [int(env.model.joint(name).dofadr[0]) for name in ARM_JOINTS]
    mujoco.mj_forward(env.model, env.data)
    assert_allclose(
        env.data.qfrc_actuator[joints], env.data.qfrc_bias[joints], atol=5e-3
    )
    assert np.abs(env.data.qfrc_bias[joints]).max() > 5.0
