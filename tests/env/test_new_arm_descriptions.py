"""The URDFs of two more arms: published tables and DH chains, read by two readers."""

import xml.etree.ElementTree as ElementTree
from typing import NamedTuple

import mujoco
import numpy as np
import pytest
import yourdfpy
from numpy.testing import assert_allclose

from gplfd_env.conventions.assets import asset_path


class Published(NamedTuple):
    """Typed in by hand, independently of the files under test."""

    joints: str
    limits: str  # Lower, upper [rad], effort [N m], velocity [rad/s].
    dh: str  # a [m], d [m], alpha [quarter turns]: of the link before the joint
    craig: bool  # (Craig's convention), or of the link after it.
    inertials: str  # Mass [kg], centre of mass in the frame of the DH chain [m].
    base_turn: float  # The chain's base in the root link [rad].
    tool: str
    tool_screw: tuple[float, float]  # Beyond the chain's last frame [rad, m].


ARMS = {
    "panda_like": Published(
        " ".join(f"panda_joint{i}" for i in range(1, 8)),
        "-2.8973 2.8973 87 2.175; -1.7628 1.7628 87 2.175; -2.8973 2.8973 87 2.175;"
        "-3.0718 -0.0698 87 2.175; -2.8973 2.8973 12 2.61; -0.0175 3.7525 12 2.61;"
        "-2.8973 2.8973 12 2.61",
        "0 .333 0; 0 0 -1; 0 .316 1; .0825 0 1; -.0825 .384 -1; 0 0 1; .088 0 1",
        True,
        "4.970684 .003875 .002081 -.04762; .646926 -.003141 -.02872 .003495;"
        "3.228604 .027518 .039252 -.066502; 3.587895 -.05317 .104419 .027454;"
        "1.225946 -.011953 .041065 -.038437; 1.666555 .060149 -.014117 -.010517;"
        "0.735522 .010517 -.004252 .061597",
        0.0,
        "panda_hand_tcp",
        (-np.pi / 4, 0.107 + 0.1034),
    ),
    "ur5e_like": Published(
        "shoulder_pan_joint shoulder_lift_joint elbow_joint "
        "wrist_1_joint wrist_2_joint wrist_3_joint",
        "-360 360 150 180; -360 360 150 180; -180 180 150 180;"  # Here in degrees.
        "-360 360 28 180; -360 360 28 180; -360 360 28 180",
        "0 .1625 1; -.425 0 0; -.3922 0 0; 0 .1333 1; 0 .0997 -1; 0 .0996 0",
        False,
        "3.761 0 -.02561 .00193; 8.058 .2125 0 .11336; 2.846 .15 0 .0265;"
        "1.37 0 -.0018 .01634; 1.3 0 .0018 .01634; .365 0 0 -.001159",
        np.pi,
        "tool0",
        (0.0, 0.0),
    ),
}


def table(text: str) -> np.ndarray:
    return np.array([row.split() for row in text.split(";")], float)


def screw(axis: int, angle: float, distance: float) -> np.ndarray:
    """Turn about an axis (0 or 2) and move along it."""
    i, j = [k for k in range(3) if k != axis]
    motion = np.eye(4)
    motion[i, i] = motion[j, j] = np.cos(angle)
    motion[j, i] = np.sin(angle)
    motion[i, j] = -motion[j, i]
    motion[axis, 3] = distance
    return motion


def dh_frames(arm: Published, angles: np.ndarray) -> list[np.ndarray]:
    """Return the frames of the links, (4, 4) each, in the root link."""
    frame, frames = screw(2, arm.base_turn, 0.0), []
    for (a, d, quarters), angle in zip(table(arm.dh), angles, strict=True):
        along = screw(0, quarters * np.pi / 2, a), screw(2, angle, d)
        first, second = along if arm.craig else along[::-1]
        frame = frame @ first @ second
        frames.append(frame)
    return frames


@pytest.mark.parametrize("name", ARMS)
def test_limits_are_the_published_ones(name):
    arm, root = ARMS[name], ElementTree.parse(asset_path(f"{name}.urdf")).getroot()
    limits = table(arm.limits)
    if name == "ur5e_like":
        limits[:, [0, 1, 3]] *= np.pi / 180
    for joint, expected in zip(arm.joints.split(), limits, strict=True):
        limit = root.find(f"joint[@name='{joint}']/limit")
        found = [limit.attrib[key] for key in ("lower", "upper", "effort", "velocity")]
        assert_allclose(np.array(found, float), expected, rtol=1e-9)


@pytest.mark.parametrize("name", ARMS)
def test_both_readers_follow_the_published_chain(name):
    """And MuJoCo refuses inertias that no distribution of a mass can have."""
    arm, path = ARMS[name], asset_path(f"{name}.urdf")
    model = mujoco.MjSpec.from_file(str(path)).compile()
    robot = yourdfpy.URDF.load(str(path), load_meshes=False)
    assert robot.validate()
    data, rng = mujoco.MjData(model), np.random.default_rng(3)
    joints, inertials = arm.joints.split(), table(arm.inertials)
    bodies = [model.joint(joint).bodyid[0] for joint in joints]
    assert_allclose(model.body_mass[bodies], inertials[:, 0])
    for _ in range(20):
        angles = rng.uniform(*model.jnt_range[: len(bodies)].T)
        data.qpos[: len(bodies)] = angles
        mujoco.mj_kinematics(model, data)
        robot.update_cfg(dict(zip(joints, angles, strict=True)))
        frames = dh_frames(arm, angles)
        for body, frame, centre in zip(bodies, frames, inertials[:, 1:], strict=True):
            assert_allclose(data.xipos[body], (frame @ [*centre, 1])[:3], atol=1e-9)
        expected = frames[-1] @ screw(2, *arm.tool_screw)
        tool = data.body(arm.tool)
        pose = np.column_stack([tool.xmat.reshape(3, 3), tool.xpos])
        assert_allclose(pose, expected[:3], atol=1e-9)
        assert_allclose(robot.get_transform(arm.tool), expected, atol=1e-9)
