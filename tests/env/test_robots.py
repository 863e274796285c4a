"""Robots besides the default one: from their URDF to an open door."""

import contextlib
import dataclasses
import json
import math
import zipfile

import gymnasium as gym
import numpy as np
import pytest
import trimesh
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env import ENVIRONMENT_ID, IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.conventions.assets import asset_path
from gplfd_env.doors.config import BAR_RADIUS, DOORS, DoorConfig
from gplfd_env.robot.config import StanceGroup
from gplfd_env.robot.description import described_robot
from gplfd_env.robot.placement import gripper_rotation_w
from gplfd_env.robot.robots import robot_named
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.robot.urdf import chosen, robot_of_urdf

ARMS = ("panda-like", "ur5e-like")
UR5E = asset_path("ur5e_like.urdf")
PANDA = asset_path("panda_like.urdf")
HAND = {
    "tool": "panda_hand",
    "grasp_point": (0.0, 0.0, 0.1034),
    "fingers": ("panda_finger_joint1", "panda_finger_joint2"),
}


@pytest.mark.parametrize(
    ("robot", "door", "base", "id"),
    [
        ("panda-like", "medium", "fixed", ENVIRONMENT_ID),
        ("panda-like", "room-834", "mobile", ENVIRONMENT_ID),
        ("ur5e-like", "medium", "mobile", ENVIRONMENT_ID),
        ("ur5e-like", "medium", "fixed", IMPEDANCE_ENVIRONMENT_ID),
    ],
)
def test_an_arm_opens_a_door_within_its_limits(
    robot, door, base, id, start_env, opening_poses
):
    env = start_env(door, id=id, robot=robot, base=base)
    rest = env.command.rest[6:]
    for pose in opening_poses(env.door_geometry, 66.0, 6.0):
        *_, ended, _, info = env.step(np.append(pose, rest))
        assert info["slip"] < 3e-3
        if ended:
            break
    assert info["success"]
    efforts = env.model.jnt_actfrcrange[
        [env.model.joint(name).id for name in robot_named(robot).arm], 1
    ]
    assert np.all(efforts > 0.0), "joint efforts are limited as in the URDF"


@pytest.mark.slow
@pytest.mark.parametrize("door", ["small", "large"])
def test_a_searched_stance_serves_the_whole_opening(door, start_env, opening_poses):
    env = start_env(door, id=ENVIRONMENT_ID, robot=UR5E)
    low, high = env.model.jnt_range[
        [env.model.joint(name).id for name in robot_named(UR5E).arm]
    ].T
    for pose in opening_poses(env.door_geometry, 70.0, 6.0):
        observation, _, ended, _, info = env.step(pose)
        assert abs(info["force_radial"]) < 5.0
        margin = np.minimum(
            observation["joint_pos"] - low, high - observation["joint_pos"]
        )
        assert margin.min() > 0.05
        if ended:
            break
    assert info["success"]


@pytest.mark.parametrize("robot", ARMS)
def test_the_hand_holds_the_handle_at_rest_and_weighs_nothing(robot):
    env = gym.make(ENVIRONMENT_ID, robot=robot, door="medium")
    observation, _ = env.reset(seed=0)
    assert observation["joint_pos"].shape == (len(robot_named(robot).arm),)
    assert env.observation_space.contains(observation)
    for _ in range(50):
        observation, *_, info = env.step(np.zeros(6))
    assert np.abs(observation["ee_pose"]).max() < 1e-4
    assert np.abs(observation["wrench"]).max() < 0.05
    assert info["grasped"]
    # The grasp frame is where the stance says: its closing axis across the bar.
    data, config = env.unwrapped.data, robot_named(robot)
    # The pads' inner faces meet where the fingers are at zero.
    for finger in config.fingers:
        assert data.joint(finger).qpos[0] == pytest.approx(BAR_RADIUS, abs=5e-4)
    axes = data.body(config.tool).xmat.reshape(3, 3) @ config.grasp_axes
    assert_allclose(axes, gripper_rotation_w(DOORS["medium"], config), atol=1e-4)


@pytest.mark.parametrize("roll", [0.0, math.pi / 2, -math.pi / 2, math.pi])
def test_a_roll_turns_the_fingers_about_the_approach(roll):
    stance = TIAGO_LIKE.stance(DoorConfig())
    rolled = dataclasses.replace(stance, roll=roll)
    robot = dataclasses.replace(
        TIAGO_LIKE, stances=((StanceGroup.of(DoorConfig(), "fixed"), rolled),)
    )
    axes, rolled_axes = (
        gripper_rotation_w(DoorConfig(), one) for one in (TIAGO_LIKE, robot)
    )
    turn = Rotation.from_rotvec(roll * -axes[:, 2]).as_matrix()
    assert_allclose(rolled_axes, turn @ axes, atol=1e-12)


def described(tmp_path, text):
    path = tmp_path / "arm.urdf"
    path.write_text(text)
    return path


def drawn_by(visuals):
    """Return the URDF of the UR5e whose first part looks another way."""
    text = UR5E.read_text()
    geometry = text[text.index("<geometry>") : text.index("</geometry>") + 11]
    return text.replace(geometry, visuals, 1)


def test_meshes_are_drawn_and_missing_ones_are_told_once(tmp_path, caplog):
    mesh = '<geometry><mesh filename="part.stl" scale="2 2 2"/></geometry>'
    path = described(tmp_path, drawn_by(mesh))
    trimesh.creation.box([0.1, 0.2, 0.3]).export(tmp_path / "part.stl")
    model = described_robot(robot_of_urdf(path)).compile()
    assert model.nmesh == 1
    assert_allclose(np.ptp(model.mesh_vert, axis=0).sum(), 1.2, rtol=1e-6)
    # Of a link that is above the arm's base nothing is drawn.
    trunk = f'<link name="trunk"><visual>{mesh}</visual></link><joint name="raised" '
    trunk += 'type="fixed"><parent link="trunk"/><child link="base_link"/><origin '
    trunk += 'xyz="0 0 0.8"/></joint></robot>'
    path.write_text(UR5E.read_text().replace("</robot>", trunk))
    assert described_robot(robot_of_urdf(path)).compile().nmesh == 0
    (tmp_path / "other").mkdir()
    mesh = mesh.replace("part", "no")
    another = mesh.replace("no", "none")
    two = drawn_by(f"{mesh}</visual><visual>{another}")
    other = described(tmp_path / "other", two)
    with pytest.warns(UserWarning, match=r"drawn without no\.stl: .*; likewise 1 more"):
        robot_of_urdf(other)
    assert not caplog.records


def test_a_file_describes_a_robot(tmp_path):
    text = PANDA.read_text().replace('"panda_link0"', '"world"')
    described(tmp_path, text)
    file = tmp_path / "robot.json"
    described_arm = {"path": "arm.urdf", "base": "mobile", **HAND}
    file.write_text(json.dumps(described_arm))
    robot = robot_named(str(file))
    assert (robot.base, robot.tool) == ("mobile", "panda_hand")
    env = gym.make(ENVIRONMENT_ID, robot=file, door="medium").unwrapped
    assert env.model.joint("base_yaw_joint").id >= 0, "its base is the file's"
    other = tmp_path / "other.json"
    for text in (json.dumps(described_arm | {"hand": 1}), '{"base": 1, "base": 2}'):
        other.write_text(text)
        said = r"other\.json does not describe a robot: .*(hand|it gives base twice)"
        with pytest.raises(ValueError, match=said):
            robot_named(str(other))


@pytest.mark.parametrize(
    ("path", "arguments", "message"),
    [
        (PANDA, {"fingers": ("panda_joint1", "x")}, "prismatic joints .*'panda_jo"),
        (PANDA, {"fingers": HAND["fingers"]}, "give grasp_point, where"),
        (PANDA, HAND | {"closing": (0, 1, 1)}, "not perpendicular"),
        (PANDA, {"grasp_point": (0, 0, 0.1)}, "is between fingers; give them"),
        (UR5E, {"tool": "hand"}, "has no link 'hand'; it has base_link"),
        (UR5E, {"tool": "forearm_link"}, "3 turning joints lead to 'forearm_link'"),
    ],
)
def test_what_does_not_fit_a_urdf_is_told(path, arguments, message):
    with pytest.raises(ValueError, match=message):
        robot_of_urdf(path, **arguments)


LINK = (
    '<link name="{}"><inertial><mass value="{}"/><inertia ixx="{}" ixy="0" ixz="0" '
    'iyy="0.001" iyz="0" izz="0.001"/></inertial></link>'
)
JOINT = '<joint name="{}" type="{}"><parent link="{}"/><child link="{}"/>{}</joint>'
JAW = '<axis xyz="0 0 1"/><limit lower="-1" upper="1" effort="5" velocity="1"/>'
LIMIT = '<limit lower="-6.28318530718" upper="6.28318530718"'
LOOP = JOINT.format("loop", "fixed", "tool0", "base_link", "")
APART = JOINT.format("apart", "fixed", "tool0", "far", "")
ELBOW, END = '"elbow_joint" type="revolute">', "</robot>"
JAW_OPENS = JAW.replace('"-1"', '"0"')


def attached(name, kind, link, child, rest="", mass=0.1, inertia=0.001):
    """Return a link behind another one."""
    joint = JOINT.format(name, kind, link, child, rest)
    return LINK.format(child, mass, inertia) + joint


@pytest.mark.parametrize(
    ("added", "tool", "warning"),
    [
        ("", "tool0", None),
        # A gripper: named so, mimicked, sliding, or with two fingers.
        (attached("jaw", "revolute", "tool0", "moves", JAW), "tool0", None),
        (attached("j7", "revolute", "tool0", "klaue", JAW_OPENS), "tool0", None),
        (
            attached("drive", "revolute", "tool0", "near", JAW)
            + attached("m", "revolute", "tool0", "far", JAW + '<mimic joint="drive"/>'),
            "tool0",
            None,
        ),
        (attached("slide", "prismatic", "tool0", "moves", JAW), "tool0", None),
        (
            attached("palm", "fixed", "tool0", "gripper_link")
            + attached("a", "revolute", "gripper_link", "a", JAW)
            + attached("b", "revolute", "gripper_link", "b", JAW),
            "tool0",
            None,
        ),
        # Impossible inertias, off the arm, and beyond the tool.
        (attached("p", "fixed", "base_link", "plate", inertia=1), "tool0", "plate"),
        (attached("q", "fixed", "wrist_3_link", "ft", inertia=1), "ft", "ft; it is"),
        # Wheels and other parts without limits do not matter either.
        (attached("w", "revolute", "base_link", "wheel"), "tool0", None),
        # Names of the door, stand and gripper.
        (attached("hinge", "fixed", "tool0", "handle"), "urdf_handle", None),
    ],
)
def test_the_arm_is_what_lies_before_its_gripper(tmp_path, added, tool, warning):
    text = UR5E.read_text().replace("</robot>", added + "</robot>")
    path = described(tmp_path, text)
    with (
        pytest.warns(UserWarning, match=f"no body has the inertia of {warning}")
        if warning
        else contextlib.nullcontext()
    ):
        robot = robot_of_urdf(path)
    assert robot.arm == robot_named("ur5e-like").arm
    assert robot.flange == tool
    assert f"the generic gripper on {tool}" in chosen(robot)
    described_robot(robot)  # says nothing again


def test_a_last_joint_that_may_be_a_grippers_is_asked_about(tmp_path):
    added = attached("j7", "revolute", "tool0", "klaue", JAW) + "</robot>"
    path = described(tmp_path, UR5E.read_text().replace("</robot>", added))
    with pytest.warns(UserWarning, match="j7, turns by 115°: .* before, 'tool0'"):
        assert robot_of_urdf(path).arm[-1] == "j7"
    assert len(robot_of_urdf(path, tool="klaue").arm) == 7


@pytest.mark.parametrize(
    ("old", "new", "message"),
    [
        (UR5E.read_text(), "", "is not a URDF of an arm"),
        ('effort="150"', 'effort="0"', r"in <limit>.*effort of should.*\.json: .eff"),
        ('effort="150"', 'effort="inf"', "more than 100000 N m would mean no limit"),
        ('effort="150"', 'effort="nan"', "would mean no limit"),
        ('rpy="0 0 0"', 'rpy="0 nan 0"', "origin has rpy='0 nan 0'"),
        ('velocity="3.1415926536"', "", "velocity of shoulder_pan_joint.*rad/s"),
        ('velocity="3.', 'velocity="9999993.', "more than 1000 rad/s would mean no"),
        (LIMIT, '<limit lower="-360" upper="360"', "-360 to 360; give .* not deg"),
        (LIMIT, "<limit", "the limits 0 to 0; give .* or type=.continuous."),
        (END, '<link name="tool0"/></robot>', "several links are called tool"),
        (END, APART + END, "apart joins 'far', no link"),
        (END, LOOP + END, "form a loop thr"),
        (END, attached("x", "fixed", "tool0", "x", mass=1e30) + END, "1e"),
        (ELBOW, f'{ELBOW}<mimic joint="wrist_1_joint"/>', "elbow_joint of the arm mim"),
        ("<robot ", '<robot xmlns:xacro="http://ros.org/wiki/xacro" ', None),
    ],
)
def test_a_description_that_cannot_be_meant_is_refused(tmp_path, old, new, message):
    text = UR5E.read_text()
    assert old in text
    path = described(tmp_path, text.replace(old, new))
    if message is None:  # A name space alone is no xacro; a tag of it is.
        robot_of_urdf(path)
        path.write_text(path.read_text().replace("</robot>", "<xacro:if/></robot>"))
        message = "it is a xacro file"
    with pytest.raises(ValueError, match=message):
        robot_of_urdf(path)


def test_limits_of_a_json_replace_those_of_the_urdf(tmp_path):
    described(tmp_path, UR5E.read_text().replace('effort="150"', 'effort="0"'))
    file = tmp_path / "arm.json"
    arm = {"path": "arm.urdf"}
    file.write_text(json.dumps(arm | {"effort": 40.0}))
    model = described_robot(robot_named(file)).compile()
    assert model.jnt_actfrcrange[model.joint("wrist_3_joint").id, 1] == 40.0
    file.write_text(json.dumps(arm | {"effort": {"elbow": 40.0}}))
    with pytest.raises(ValueError, match="elbow, no joint of the arm"):
        robot_named(file)


def test_a_changed_file_is_another_robot(tmp_path):
    path = described(tmp_path, UR5E.read_text())
    file = tmp_path / "arm.json"
    file.write_text(json.dumps({"path": "arm.urdf"}))
    before = described_robot(robot_named(file))
    path.write_text(UR5E.read_text().replace("wrist_3_joint", "roll"))
    after = robot_named(file)
    assert after.arm[-1] == "roll"
    assert described_robot(after).joint("roll") is not None
    assert before.joint("wrist_3_joint") is not None
    file.write_text(json.dumps({"path": "arm.urdf", "base": "mobile"}))
    assert robot_named(file).base == "mobile"
    # So is one of which a mesh alone changed.
    mesh = '<geometry><mesh filename="part.stl"/></geometry>'
    path.write_text(drawn_by(mesh))
    spans = []
    for size in (0.1, 0.25):
        trimesh.creation.box([size] * 3).export(tmp_path / "part.stl")
        model = described_robot(robot_named(path)).compile()
        spans.append(np.ptp(model.mesh_vert, axis=0))
    assert_allclose(spans, [[0.1] * 3, [0.25] * 3], rtol=1e-6)


def test_an_archive_is_no_mesh(tmp_path):
    mesh = '<geometry><mesh filename="part.zip"/></geometry>'
    path = described(tmp_path, drawn_by(mesh))
    trimesh.creation.box([0.1, 0.2, 0.3]).export(tmp_path / "part.stl")
    with zipfile.ZipFile(tmp_path / "part.zip", "w") as archive:
        archive.write(tmp_path / "part.stl", "part.stl")
    with pytest.warns(UserWarning, match=r"without part\.zip: a mesh is a \.stl"):
        robot_of_urdf(path)
