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


def numbers(element: ElementTree.Element | None, attribute: str) -> np.ndarray:
    assert element is not None
    return np.array([float(text) for text in element.attrib[attribute].split()])


def inertia_matrix(link: str) -> tuple[float, np.ndarray]:
    """Read mass and inertia straight from the text, without any URDF library."""
    inertial = ROOT.find(f"link[@name='{link}']/inertial")
    assert inertial is not None, f"{link} has no inertial"
    mass, tensor = inertial.find("mass"), inertial.find("inertia")
    assert mass is not None
    assert tensor is not None
    i = {name: float(value) for name, value in tensor.attrib.items()}
    matrix = [
        [i["ixx"], i["ixy"], i["ixz"]],
        [i["ixy"], i["iyy"], i["iyz"]],
        [i["ixz"], i["iyz"], i["izz"]],
    ]
    return float(mass.attrib["value"]), np.array(matrix)


@pytest.mark.parametrize("name", PUBLISHED_CHAIN)
def test_chain_and_limits_are_the_published_ones(name: str) -> None:
    origin, rpy, limits, velocity, effort = PUBLISHED_CHAIN[name]
    joint = ROOT.find(f"joint[@name='{name}_joint']")
    assert joint is not None
    assert_allclose(numbers(joint.find("origin"), "xyz"), origin, atol=1e-12)
    assert_allclose(numbers(joint.find("origin"), "rpy"), np.radians(rpy), atol=1e-9)
    assert_allclose(numbers(joint.find("axis"), "xyz"), (0, 0, 1))
    limit = joint.find("limit")
    scale = 1.0 if name == "torso_lift" else math.radians(1.0)
    assert_allclose(numbers(limit, "lower"), limits[0] * scale, atol=1e-9)
    assert_allclose(numbers(limit, "upper"), limits[1] * scale, atol=1e-9)
    assert_allclose(numbers(limit, "velocity"), velocity)
    assert_allclose(numbers(limit, "effort"), effort)


def test_masses_are_the_published_ones() -> None:
    masses = {link: inertia_matrix(link)[0] for link in PUBLISHED_MASSES}
    assert masses == pytest.approx(PUBLISHED_MASSES, rel=1e-5)


def test_wrist_to_fingertip_distances() -> None:
    """Along arm_7's z: sensor 0.05385 m, gripper_link 0.076575 m beyond the origin."""
    robot = yourdfpy.URDF.load(str(URDF), load_meshes=False)
    for link, distance in (("wrist_ft_link", 0.05385), ("gripper_link", 0.076575)):
        offset = robot.get_transform(link, "arm_7_link")[:3, 3]
        assert_allclose(offset, (0, 0, distance), atol=1e-9)


@pytest.mark.parametrize("link", [name for name in LINKS if name != "base_footprint"])
def test_inertias_are_physical(link: str) -> None:
    mass, matrix = inertia_matrix(link)
    assert mass > 0
    principal = np.linalg.eigvalsh(matrix)
    assert principal[0] > 0
    # No mass distribution has one principal moment above the sum of the others.
    assert principal[2] <= principal[0] + principal[1]


def test_published_arm_1_inertia_is_why_a_correction_is_needed() -> None:
    _, corrected = inertia_matrix("arm_1_link")
    principal = np.linalg.eigvalsh(corrected - 2.5e-4 * np.eye(3))
    assert principal == pytest.approx([0.00156, 0.00598, 0.00777], abs=5e-6)
    excess = principal[2] - principal[0] - principal[1]
    assert 0 < excess < 2.5e-4, "2.5e-4 on the diagonal must be enough, and needed"


@pytest.mark.parametrize(
    ("link", "axis", "radius", "length"),
    [
        ("arm_tool_link", 0, 0.0225, 0.0157),
        ("wrist_ft_link", 2, 0.0225, 0.0157),
        ("wrist_ft_tool_link", 0, 0.025, 0.00975),
    ],
)
def test_massless_wrist_links_became_solid_cylinders(
    link: str, axis: int, radius: float, length: float
) -> None:
    """Published with 0.1 kg and zero inertia; the cylinder lies along the approach."""
    mass, matrix = inertia_matrix(link)
    across = mass * (3 * radius**2 + length**2) / 12
    expected = np.full(3, across)
    expected[axis] = mass * radius**2 / 2
    assert mass == pytest.approx(0.1)
    assert_allclose(matrix, np.diag(expected), rtol=1e-5)


def test_arm_5_centre_of_mass_lies_inside_the_link() -> None:
    origin = ROOT.find("link[@name='arm_5_link']/inertial/origin")
    z = numbers(origin, "xyz")[2]
    assert 0.009 < z < 0.189, "the forearm's shell spans 9 to 189 mm"


def test_mujoco_accepts_the_file_without_help() -> None:
    text = URDF.read_text()
    for crutch in ("balanceinertia", "boundmass", "boundinertia", "package://"):
        assert crutch not in text
    model = mujoco.MjModel.from_xml_path(str(URDF))
    for link in LINKS:
        assert model.body(link).name == link
        if link != "base_footprint":
            mass, matrix = inertia_matrix(link)
            assert_allclose(model.body(link).mass, mass)
            assert_allclose(
                sorted(model.body(link).inertia), np.linalg.eigvalsh(matrix), rtol=1e-6
            )


def test_forward_kinematics_equals_yourdfpy() -> None:
    robot = yourdfpy.URDF.load(str(URDF), load_meshes=False)
    assert robot.validate()
    model = mujoco.MjModel.from_xml_path(str(URDF))
    data = mujoco.MjData(model)
    rng = np.random.default_rng(7)
    low, high = model.jnt_range.T
    coupled = "gripper_left_finger_joint", "gripper_right_finger_joint"
    assert robot.link_map.keys() == set(LINKS)
    for _ in range(40):
        data.qpos[:] = rng.uniform(low, high)
        data.joint(coupled[0]).qpos = data.joint(coupled[1]).qpos
        mujoco.mj_kinematics(model, data)
        robot.update_cfg([data.joint(j).qpos[0] for j in robot.actuated_joint_names])
        for link in LINKS:
            transform = robot.get_transform(link, "base_footprint")
            body = data.body(link)
            assert_allclose(body.xpos, transform[:3, 3], atol=1e-9, err_msg=link)
            assert_allclose(
                body.xmat.reshape(3, 3), transform[:3, :3], atol=1e-9, err_msg=link
            )
