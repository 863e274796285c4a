"""Commanded stiffness: the servo's law, its gains, its statics, its stability."""

from typing import Any

import numpy as np
import pytest
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

import gplfd_env
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.spatial.se3 import handle_pose_on_arc

pytestmark = pytest.mark.slow

IMPEDANCE = gplfd_env.IMPEDANCE_ENVIRONMENT_ID
SOFTEST = np.repeat([20.0, 1.0], 3)
STIFFEST = np.repeat([2000.0, 100.0], 3)
MASS = np.repeat([4.0, 0.15], 3)
MIDDLE = handle_pose_on_arc(0.5, np.radians(35.0))

stiffnesses = st.lists(st.floats(0.0, 1.0), min_size=6, max_size=6).map(
    lambda shares: SOFTEST * (STIFFEST / SOFTEST) ** np.array(shares)
)
# The fixture only remembers what to close.
many_examples = settings(
    max_examples=8, suppress_health_check=[HealthCheck.function_scoped_fixture]
)


def command(pose: Any, stiffness: Any = STIFFEST) -> np.ndarray:
    return np.concatenate([pose, np.broadcast_to(stiffness, 6)])


@many_examples
@given(stiffness=stiffnesses)
def test_each_servo_has_the_stiffness_commanded_and_keeps_its_damping_ratio(
    stiffness, start_env, release_handle
):
    """The law of each servo, in motion: force_i = k_i (c - x)_i - d_i v_i.

    Critical damping of the arm's apparent mass, d = 2 √(m k), within 1 %.
    """
    env = start_env(id=IMPEDANCE)
    release_handle(env)
    target = 0.2 * MIDDLE
    for _ in range(8):
        observation, *_ = env.step(command(target, stiffness))
    damping = 2.0 * np.sqrt(MASS * stiffness)
    bias = env.model.actuator_biasprm[:6]
    assert_allclose(env.model.actuator_gainprm[:6, 0], stiffness, rtol=1e-12)
    assert_allclose(bias[:, 1], -stiffness, rtol=1e-12)
    assert_allclose(bias[:, 2], -damping, rtol=0.01)
    assert np.abs(observation["ee_twist"][:3]).max() > 0.01
    expected = stiffness * (target - observation["ee_pose"])
    expected -= damping * observation["ee_twist"]
    scale = np.abs(stiffness * target).max() + 0.1
    assert_allclose(env.data.actuator_force[:6], expected, atol=0.01 * scale)


@pytest.mark.parametrize(
    ("axis", "share"),
    [(0, 1.0), (0, 0.1), (1, 0.1), (2, 1.0), (3, 0.1), (4, 1.0), (5, 0.1)],
)
def test_deflection_under_a_known_load_is_load_over_stiffness(
    share, axis, start_env, release_handle, push_hand
):
    """In the middle of the opening, without the springs that settle self-motion."""
    env = start_env(id=IMPEDANCE)
    release_handle(env)
    for name in TIAGO_LIKE.arm:
        env.model.jnt_stiffness[env.model.joint(name).id] = 0.0
    for step in range(200):
        env.step(command(MIDDLE * min(1.0, step / 150)))
    stiffness = share * STIFFEST
    load = np.zeros(6)
    load[axis] = stiffness[axis] * (0.004 if axis < 3 else 0.01)
    for _ in range(500 if share == 1.0 else 800):  # A stiff servo settles sooner.
        push_hand(env, load[:3], load[3:])
        observation, *_ = env.step(command(MIDDLE, stiffness))
    deflection = observation["ee_pose"] - MIDDLE
    assert_allclose(deflection, load / stiffness, atol=1e-4)


def test_greatest_stiffness_follows_the_pose_environment(start_env, arc_commands):
    """To 2 µm and 0.4 mrad along an arc: every axis has a servo of its own."""
    pose_env, env = start_env("medium"), start_env("medium", id=IMPEDANCE)
    for pose in arc_commands(0.5, duration=6.0):
        expected, _, ended, _, expected_info = pose_env.step(pose)
        observation, *_, info = env.step(command(pose))
        assert_allclose(observation["ee_pose"][:3], expected["ee_pose"][:3], atol=2e-6)
        assert_allclose(observation["ee_pose"][3:], expected["ee_pose"][3:], atol=4e-4)
        assert_allclose(observation["wrench"], expected["wrench"], atol=0.15)
        assert info["success"] == expected_info["success"]
        if ended:
            break
    assert info["success"]


@many_examples
@given(stiffness=stiffnesses, seed=st.integers(0, 1000))
def test_any_stiffness_is_stable(stiffness, seed, make_env, release_handle):
    """Steps of the command, and stiffness that jumps, then rest: motion dies out.

    The hand is free: friction of a held door would hide an undamped servo.
    """
    env = make_env("small", id=IMPEDANCE)
    env.reset(seed=seed)
    release_handle(env)
    rng = np.random.default_rng(seed)
    speed = []
    for step in range(400):
        if step % 40 == 0:
            pose = rng.uniform(-0.02, 0.02, 6) if step < 100 else np.zeros(6)
        jump = rng.uniform(size=6) if step < 100 else 0.0
        action = command(pose, SOFTEST * (stiffness / SOFTEST) ** (1.0 - jump))
        observation, *_, truncated, _ = env.step(action)
        assert observation in env.observation_space
        assert not truncated
        speed.append(np.abs(observation["ee_twist"]).max())
    assert max(speed) < 2.0
    assert speed[-1] < 0.05 * max(speed)
