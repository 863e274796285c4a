"""Where the hinge is in the task frame, and how its handle moves."""

import itertools

import mujoco
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env import DoorGeometry
from gplfd_env.doors.config import TURNING, DoorConfig
from gplfd_env.doors.geometry import ROCKERS
from gplfd_env.doors.variation import Placement, Variation
from gplfd_env.robot.placement import door_geometry
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.scene.build import build_scene
from gplfd_env.spatial.se3 import handle_pose_on_arc

ANGLES = np.linspace(0.0, 1.2, 7)
everywhere = pytest.mark.parametrize(
    ("swing", "side"), list(itertools.product(("pull", "push"), ("right", "left")))
)
HANDLES = ("bar", *TURNING)
three = st.tuples(*[st.floats(-1.0, 1.0)] * 3)


@given(st.floats(0.3, 0.65), st.floats(-0.1, 0.1))
def test_a_wrong_heading_turns_the_arc_as_documented(radius, psi):
    door = DoorConfig(radius=radius)
    placed = Variation(door=door, placement=Placement(base_yaw=psi))
    poses = door_geometry(placed, TIAGO_LIKE).hand_poses(ANGLES)
    sine, rest = np.sin(ANGLES), 1.0 - np.cos(ANGLES)
    x = radius * (np.cos(psi) * sine + np.sin(psi) * rest)
    z = radius * (np.sin(psi) * sine - np.cos(psi) * rest)
    zero = np.zeros_like(x)
    expected = np.stack([x, zero, z, zero, ANGLES, zero], axis=1)
    assert_allclose(poses, expected, atol=1e-12)


@pytest.mark.parametrize("radius", [0.3, 0.45, 0.65])
@everywhere
def test_the_nominal_arc_of_every_way_and_side(swing, side, radius):
    """x and z of the right-hinged door that is pulled, mirrored; it begins along pull.

    A bar does not turn.
    """
    geometry = DoorGeometry.of(DoorConfig(radius=radius, swing=swing, hinge_side=side))
    way, right = (1 if swing == "pull" else -1), (1 if side == "right" else -1)
    mirror = np.array([way, 1, right, 1, way * right, 1])
    expected = handle_pose_on_arc(radius, ANGLES) * mirror
    assert_allclose(geometry.hand_poses(ANGLES), expected, atol=1e-12)
    begin = geometry.hand_poses(1e-6)[:3] / 1e-6
    assert_allclose(begin, radius * geometry.pull, atol=1e-6)
    assert geometry.pull[0] == way
    with pytest.raises(ValueError, match="does not turn"):
        geometry.hand_poses(0.1, 0.2)


@pytest.mark.parametrize("handle", ["bar", "lever", "knob"])
@pytest.mark.parametrize("swing", ["pull", "push"])
def test_a_hand_turns_by_half_where_it_pushes_something_round(handle, swing):
    latch = "none" if handle == "bar" else "spring"
    door = DoorGeometry.of(
        DoorConfig(radius=0.65, handle=handle, latch=latch, swing=swing)
    )
    turns = 0.0 * ANGLES if handle == "bar" else np.linspace(0.7, 0.1, 7)
    rigid, easy = door.hand_poses(ANGLES, turns), door.easy_hand_poses(ANGLES, turns)
    assert_array_equal(easy[:, :3], rigid[:, :3])
    if swing == "push" and handle != "lever":
        rigid = door.hand_poses(0.5 * ANGLES, turns)
    assert_array_equal(easy[:, 3:], rigid[:, 3:])


@given(three, three)
def test_angles_and_directions_are_those_of_the_poses(hinge, axis):
    assume(np.linalg.norm(np.cross(hinge, axis)) > 1e-2)
    door = DoorGeometry(hinge=np.array(hinge), axis=np.array(axis))
    poses = door.hand_poses(ANGLES)
    assert_allclose(door.angle(poses[:, :3]), ANGLES, atol=1e-9)
    ahead = door.hand_poses(ANGLES + 1e-6)[:, :3] - poses[:, :3]
    for angle, step in zip(ANGLES, ahead, strict=True):
        direction = step / np.linalg.norm(step)
        assert_allclose(door.direction(angle), direction, atol=1e-4)


@pytest.mark.parametrize(
    ("hinge", "axis", "message"),
    [
        ((0.0, 1.0, 0.0), (0.0, 1.0, 0.0), "not pass through the handle"),
        ((0.0, 0.0, -0.5), (0.0, 0.0, 0.0), "must have a direction"),
        ((0.0, 0.0, -0.5), (0.0, np.nan, 0.0), r"DoorGeometry\.axis needs three"),
    ],
)
def test_impossible_doors_are_refused(hinge, axis, message):
    with pytest.raises(ValueError, match=message):
        DoorGeometry(hinge=np.array(hinge), axis=np.array(axis))


@pytest.mark.parametrize(
    ("base", "handle", "swing", "side"),
    [
        (base, handle, swing, side)
        for base, handle, swing, side in itertools.product(
            ("fixed", "mobile"), HANDLES, ("pull", "push"), ("right", "left")
        )
        if (handle, swing) != ("touch-bar", "pull")
        and (base == "mobile" or handle not in ROCKERS)
    ],
)
def test_a_handle_is_where_the_simulator_has_it(swing, side, handle, base):
    """Poses of a hand that is fixed to the handle, for hinge and handle turned."""
    door = DoorConfig(radius=0.5, handle=handle, swing=swing, hinge_side=side)
    placement = Placement(base_yaw=0.03, base_x=0.01, grasp_depth=0.004)
    geometry = door_geometry(
        Variation(door=door, placement=placement), TIAGO_LIKE.on(base)
    )
    model = build_scene(door, placement=placement, robot=TIAGO_LIKE.on(base))
    data = mujoco.MjData(model)
    frame, site = data.site("task_frame"), data.site("handle")
    mujoco.mj_kinematics(model, data)
    hand = site.xmat.reshape(3, 3).T @ (frame.xpos - site.xpos)
    # A wrong heading turns the door in the task frame, not the hand's zero.
    psi = Rotation.from_rotvec([0.0, -0.03, 0.0])
    turns = (0.0,) if handle == "bar" else (0.0, 0.3, 0.8)
    for turn, angle in itertools.product(turns, (0.0, 0.2, 1.0)):
        data.joint("hinge").qpos = angle
        if handle != "bar":
            data.joint("handle").qpos = turn
        mujoco.mj_kinematics(model, data)
        axes, turned = frame.xmat.reshape(3, 3), site.xmat.reshape(3, 3)
        pose = geometry.hand_poses(angle, turn)
        position = axes.T @ (site.xpos + turned @ hand - frame.xpos)
        assert_allclose(pose[:3], position, atol=1e-9)
        rotation = Rotation.from_rotvec(pose[3:]) * psi
        assert_allclose(rotation.as_matrix(), axes.T @ turned, atol=1e-9)
