"""The URDF: published chain and limits, physical inertias, one file for two readers."""

import math
import xml.etree.ElementTree as ElementTree

import mujoco
import numpy as np
import pytest
import yourdfpy
from numpy.testing import assert_allclose

from gplfd_env.conventions.assets import asset_path

URDF = asset_path("tiago_like.urdf")
ROOT = ElementTree.parse(URDF).getroot()
LINKS = [link.attrib["name"] for link in ROOT.iter("link")]

# joint: origin [m], rpy [deg], limits [deg or m], velocity, effort. Typed in by hand
# from the published description, independently of the file under test.
PUBLISHED_CHAIN = {
    "torso_lift": ((0, 0, 0.597), (0, 0, 0), (0, 0.35), 0.07, 2000),
    "arm_1": ((0.15505, 0.014, -0.151), (0, 0, -90), (0, 157.5), 1.95, 43),
    "arm_2": ((0.125, 0.0195, -0.031), (90, 0, 0), (-90, 62.5), 1.95, 43),
    "arm_3": ((0.0895, 0, -0.0015), (-90, 0, 90), (-202.5, 90), 2.35, 26),
    "arm_4": ((-0.02, -0.027, -0.222), (-90, -90, 0), (-22.5, 135), 2.35, 26),
    "arm_5": ((-0.162, 0.02, 0.027), (0, -90, 0), (-120, 120), 1.95, 3),
    "arm_6": ((0, 0, 0.15), (0, -90, -90), (-81, 81), 1.76, 6.6),
    "arm_7": ((0, 0, 0), (90, 0, 90), (-120, 120), 1.76, 6.6),
}
PUBLISHED_MASSES = {
    "torso_lift_link": 6.93198,
    "arm_1_link": 1.563428,
    "arm_2_link": 1.800397,
    "arm_3_link": 1.8,
    "arm_4_link": 1.432697,
    "arm_5_link": 0.935914,
    "arm_6_link": 0.302758,
    "arm_7_link": 0.1,
    "gripper_link": 0.60266,
    "gripper_right_finger_link": 0.10998,
    "gripper_left_finger_link": 0.10998,
}


def numbers(element: ElementTree.Element | None, *attributes: str) -> np.ndarray:
    assert element is not None
    words = " ".join(element.attrib[name] for name in attributes).split()
    return np.array([float(word) for word in words])


def inertial(link: str) -> tuple[float, np.ndarray]:
    """Read mass and inertia straight from the text, without any URDF library."""
    found = ROOT.find(f"link[@name='{link}']/inertial")
    assert found is not None, f"{link} has no inertial"
    xx, yy, zz, xy, xz, yz = numbers(
        found.find("inertia"), *("ixx", "iyy", "izz", "ixy", "ixz", "iyz")
    )
    matrix = np.array([[xx, xy, xz], [xy, yy, yz], [xz, yz, zz]])
    return numbers(found.find("mass"), "value").item(), matrix


@pytest.mark.parametrize("name", PUBLISHED_CHAIN)
def test_chain_and_limits_are_the_published_ones(name):
    origin, rpy, limits, velocity, effort = PUBLISHED_CHAIN[name]
    joint = ROOT.find(f"joint[@name='{name}_joint']")
    assert joint is not None
    assert_allclose(numbers(joint.find("origin"), "xyz"), origin, atol=1e-12)
    assert_allclose(numbers(joint.find("origin"), "rpy"), np.radians(rpy), atol=1e-9)
    assert_allclose(numbers(joint.find("axis"), "xyz"), (0, 0, 1))
    limit, scale = joint.find("limit"), math.radians(1.0) if "arm" in name else 1.0
    ends = numbers(limit, "lower", "upper")
    assert_allclose(ends, np.multiply(limits, scale), atol=1e-9)
    assert_allclose(numbers(limit, "velocity", "effort"), (velocity, effort))


def test_masses_are_the_published_ones():
    masses = {link: inertial(link)[0] for link in PUBLISHED_MASSES}
    assert masses == pytest.approx(PUBLISHED_MASSES, rel=1e-5)


def test_mujoco_accepts_the_file_without_help_and_agrees_with_yourdfpy():
    """MuJoCo refuses inertias that no distribution of a mass can have."""
    text = URDF.read_text()
    for crutch in ("balanceinertia", "boundmass", "boundinertia", "package://"):
        assert crutch not in text
    model = mujoco.MjModel.from_xml_path(str(URDF))
    for link in set(LINKS) - {"base_footprint"}:
        mass, matrix = inertial(link)
        assert_allclose(model.body(link).mass, mass)
        assert mass > 0
        principal = np.linalg.eigvalsh(matrix)
        assert_allclose(sorted(model.body(link).inertia), principal, rtol=1e-6)

    robot = yourdfpy.URDF.load(str(URDF), load_meshes=False)
    assert robot.validate()
    assert robot.link_map.keys() == set(LINKS)
    # Along arm_7's z, beyond its origin.
    for link, distance in (("wrist_ft_link", 0.05385), ("gripper_link", 0.076575)):
        offset = robot.get_transform(link, "arm_7_link")[:3, 3]
        assert_allclose(offset, (0, 0, distance), atol=1e-9)
    data = mujoco.MjData(model)
    rng = np.random.default_rng(7)
    low, high = model.jnt_range.T
    left, right = (f"gripper_{side}_finger_joint" for side in ("left", "right"))
    for _ in range(20):
        data.qpos[:] = rng.uniform(low, high)
        data.joint(left).qpos = data.joint(right).qpos
        mujoco.mj_kinematics(model, data)
        robot.update_cfg([data.joint(j).qpos[0] for j in robot.actuated_joint_names])
        for link in LINKS:
            transform = robot.get_transform(link, "base_footprint")[:3]
            body = data.body(link)
            pose = np.column_stack([body.xmat.reshape(3, 3), body.xpos])
            assert_allclose(pose, transform, atol=1e-9, err_msg=link)
