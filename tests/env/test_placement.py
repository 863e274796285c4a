"""Where the robot stands and grasps: what it sees of the door, and what it does not."""

import math
from typing import Any

import mujoco
import numpy as np
import pytest
from gymnasium.utils.env_checker import data_equivalence
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.motion import LeafPath
from gplfd_env.doors.variation import Placement
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import GRASP_KEY, build_scene
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_env.task.observation import Sensors

READER = Sensors.of("contact", "pose", TIAGO_LIKE)

# Within these the medium door can be held.
placements = st.builds(
    Placement,
    base_x=st.floats(-0.02, 0.02),
    base_y=st.floats(-0.02, 0.02),
    base_yaw=st.floats(-0.06, 0.06),
    grasp_height=st.floats(-0.05, 0.05),
    grasp_depth=st.floats(-0.006, 0.006),
)


def at_rest(placement: Placement, radius: float = 0.5) -> Any:
    model = build_scene(DoorConfig(radius=radius), placement=placement)
    data = mujoco.MjData(model)
    mujoco.mj_resetDataKeyframe(model, data, GRASP_KEY)
    mujoco.mj_forward(model, data)
    return model, data


def turned(positions: np.ndarray, yaw: float) -> np.ndarray:
    """Turn positions (..., 3) by -yaw about y, written out."""
    x, y, z = np.moveaxis(positions, -1, 0)
    c, s = math.cos(yaw), math.sin(yaw)
    return np.stack([c * x - s * z, y, s * x + c * z], axis=-1)


@settings(max_examples=12)
@given(placement=placements, angle=st.floats(0.0, 1.7), radius=st.floats(0.3, 0.65))
def test_the_arc_is_turned_by_minus_the_yaw(placement, angle, radius):
    """The robot is turned to the left, so to it the door is turned to the right.

    The arc begins where the bar really is at the closed grasp.
    """
    model, data = at_rest(placement, radius)
    closed = READER.door_reading(data.sensordata.tolist(), LeafPath()).handle_position
    data.joint("hinge").qpos = angle
    mujoco.mj_forward(model, data)
    reading = READER.door_reading(data.sensordata.tolist(), LeafPath())
    arc = handle_pose_on_arc(radius, angle)[:3]
    expected = turned(arc, placement.base_yaw)
    assert_allclose(np.subtract(reading.handle_position, closed), expected, atol=1e-6)
    # Only the depth of the grasp separates bar and hand: horizontally, along the palm.
    offset = np.linalg.norm(closed)
    assert offset == pytest.approx(abs(placement.grasp_depth), abs=1e-6)
    assert closed[1] == pytest.approx(0.0, abs=1e-9)


@settings(max_examples=12)
@given(placement=placements)
def test_the_hand_begins_at_the_origin_wherever_it_takes_hold(placement):
    """An error of the base moves the door the other way.

    Base frame = world: base_x ahead, base_y to the left, base_yaw to the left.
    """
    _, data = at_rest(placement)
    assert_allclose(data.sensordata[READER.ee_pose], 0.0, atol=2e-4)
    for side in ("right", "left"):
        assert data.sensor(f"{side}_pad_contact").data > 0
    # The hand is above the middle of the bar by the height of the grasp.
    bar = data.geom("handle_bar").xpos
    above = data.site("hand").xpos[2] - bar[2]
    assert above == pytest.approx(placement.grasp_height, abs=1e-4)
    assert bar[2] == pytest.approx(0.85)
    lift = min(0.85 + placement.grasp_height - 0.5, 0.35)
    assert data.joint("torso_lift_joint").qpos[0] == pytest.approx(lift, abs=1e-3)

    stance, yaw = TIAGO_LIKE.stance(DoorConfig()), placement.base_yaw
    base = np.array([placement.base_x, placement.base_y])
    turn = np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])
    assert_allclose(base + turn @ bar[:2], stance.handle_xy_w, atol=1e-12)
    into_door = -turn @ data.body("door_frame").xmat.reshape(3, 3)[:2, 0]
    assert math.atan2(into_door[1], into_door[0]) == pytest.approx(stance.door_yaw)


def test_an_unreachable_placement_is_told_and_the_next_reset_draws_anew(make_env):
    env, fresh = (make_env(door={"handle_height": 0.5}) for _ in range(2))
    first = env.reset(seed=3)
    wide = {"base_position": 0.05, "base_yaw": 0.1, "grasp_height": 0.05}
    action = np.full(6, 0.001)
    messages = []
    for seed in range(20):
        try:
            env.reset(seed=seed, options={"randomization": wide})
        except ValueError as error:
            messages.append(str(error))
    assert 0 < len(messages) < 20
    assert all("move the base towards its nominal" in text for text in messages)
    again = env.reset(seed=3, options={"randomization": "none"})
    assert data_equivalence(again, first, exact=True)
    fresh.reset(seed=3)
    assert data_equivalence(env.step(action), fresh.step(action), exact=True)
