"""PAL's meshes, with a stand-in for the package that has them.

The stand-in is an installed distribution of the same name with a description of the
same structure and two boxes for meshes.
"""

import mujoco
import numpy as np
import pytest
import trimesh

from gplfd_env.conventions.assets import asset_path
from gplfd_experiments.recording import tiago_meshes
from gplfd_experiments.recording.scene import drawn_scene, visual_geoms
from gplfd_experiments.recording.tiago_meshes import tiago_looks

SHARE = "cmeel.prefix/share/example-robot-data/robots/tiago_description"
URDF = """<?xml version="1.0"?>
<robot name="tiago">
  <material name="Orange"><color rgba="1 0.5 0 1"/></material>
  <link name="base_footprint"/>
  <link name="base_link">
    <visual><origin xyz="0 0 0.5"/><geometry><box size="0.2 0.2 0.2"/></geometry>
    </visual>
  </link>
  <joint name="base_footprint_joint" type="fixed">
    <parent link="base_footprint"/><child link="base_link"/><origin xyz="0 0 0.1"/>
  </joint>
  <link name="torso_lift_link"/>
  <joint name="torso_lift_joint" type="prismatic">
    <parent link="base_link"/><child link="torso_lift_link"/><origin xyz="0 0 0.2"/>
    <axis xyz="0 0 1"/><limit lower="0" upper="0.35" effort="1" velocity="1"/>
  </joint>
  <link name="head_1_link">
    <visual><origin xyz="0.02 0 0" rpy="0 0 1.5707963267948966"/><geometry>
      <mesh filename="package://example-robot-data/robots/tiago_description/meshes/a.stl"/>
    </geometry><material name="Orange"/></visual>
  </link>
  <joint name="head_1_joint" type="revolute">
    <parent link="torso_lift_link"/><child link="head_1_link"/>
    <origin xyz="0 0 0.3"/><axis xyz="0 0 1"/>
    <limit lower="-1" upper="1" effort="1" velocity="1"/>
  </joint>
</robot>
"""
MODEL = mujoco.MjModel.from_xml_string("""
<mujoco>
  <worldbody>
    <body name="base_footprint" pos="1 2 0" quat="0.8 0 0 0.6">
      <body name="base_link" pos="0 0 0.1">
        <geom name="base" size="0.1"/>
        <body name="torso_lift_link" pos="0 0 0.2">
          <joint name="torso_lift_joint" type="slide" axis="0 0 1"/>
          <geom name="chest" size="0.1"/>
          <body name="head_link"><geom name="head" size="0.1"/></body>
          <body name="arm_1_link"><geom size="0.01"/></body>
        </body>
      </body>
    </body>
    <body name="door"><geom name="leaf" size="0.1"/></body>
  </worldbody>
</mujoco>
""")


@pytest.fixture
def installed(tmp_path, monkeypatch):
    """Put the stand-in where the import system looks first."""
    monkeypatch.syspath_prepend(tmp_path)
    robots, meshes = tmp_path / SHARE / "robots", tmp_path / SHARE / "meshes"
    robots.mkdir(parents=True)
    meshes.mkdir()
    (robots / "tiago_no_hand.urdf").write_text(URDF)
    trimesh.creation.box([0.2, 0.4, 0.6]).export(meshes / "a.stl")
    info = tmp_path / "example_robot_data-99.dist-info"
    info.mkdir()
    (info / "METADATA").write_text("Name: example-robot-data\nVersion: 99\n")
    (info / "RECORD").write_text(
        f"{SHARE}/robots/tiago_no_hand.urdf,,\n{SHARE}/meshes/a.stl,,\n"
    )
    return robots / "tiago_no_hand.urdf"


def names(model: mujoco.MjModel) -> list[str]:
    return [model.body(body).name for body in range(model.nbody)]


def test_what_is_missing_is_told(installed, monkeypatch):
    (installed.parents[1] / "meshes" / "a.stl").unlink()
    with pytest.raises(
        ValueError, match=r"1 of 2 meshes .* install example-robot-data"
    ):
        tiago_looks(["base_link"])
    installed.write_text('<robot name="other"><link name="trunk"/></robot>')
    with pytest.raises(ValueError, match="is not TIAGo's description"):
        tiago_looks(["base_link"])
    monkeypatch.setattr(tiago_meshes, "DISTRIBUTION", "no-robot-data")
    with pytest.raises(ModuleNotFoundError, match=r"pip install 'gplfd\[tiago\]'"):
        tiago_looks(["base_link"])


def test_a_mesh_goes_to_the_nearest_body_of_ours_in_its_frame(installed):
    assert set(tiago_looks(["torso_lift_link"])) == {"torso_lift_link"}
    ours = mujoco.MjModel.from_xml_path(str(asset_path("tiago_like.urdf")))
    for model in (MODEL, ours):
        looks = tiago_looks(names(model))
        assert set(looks) == {"base_link", "torso_lift_link"}
    (head,) = looks["torso_lift_link"]
    assert (head.name, head.colour) == ("head_1_link_0", (255, 127, 0, 255))
    # Turned by a quarter: x and y of the box change places.
    np.testing.assert_allclose(
        [head.vertices.min(axis=0), head.vertices.max(axis=0)],
        [[0.02 - 0.2, -0.1, 0.3 - 0.3], [0.02 + 0.2, 0.1, 0.3 + 0.3]],
        atol=1e-7,
    )


def test_meshes_are_drawn_where_their_bodies_are_in_place_of_geoms(installed, columns):
    looks = tiago_looks(names(MODEL))
    # Bodies without meshes keep their geoms.
    geoms = [geom for geoms in visual_geoms(MODEL, looks).values() for geom in geoms]
    bodies = {MODEL.body(MODEL.geom_bodyid[geom]).name for geom in geoms}
    assert bodies == {"arm_1_link", "door"}
    chunks = columns(drawn_scene(MODEL, looks))
    base = "/world/scene/world/tiago_base_link_0"
    head = "/world/scene/torso_lift_link/tiago_head_1_link_0"
    assert {entity for entity in chunks.entities if "tiago" in entity} == {base, head}
    # The base never moves and lies in the world: from (1, 2, 0.1), turned by 73.7
    # degrees (cos 0.28, sin 0.96), a cube of 0.2 that is 0.5 up.
    fixed = np.array(chunks[base, "Mesh3D:vertex_positions"][1][0])
    reach = 0.1 * (0.28 + 0.96)
    np.testing.assert_allclose(
        [fixed.min(axis=0), fixed.max(axis=0)],
        [[1 - reach, 2 - reach, 0.5], [1 + reach, 2 + reach, 0.7]],
        atol=1e-6,
    )
    _, (normals,) = chunks[base, "Mesh3D:vertex_normals"]
    outwards = np.einsum("ij,ij->i", normals, fixed - [1.0, 2.0, 0.6])
    np.testing.assert_allclose(outwards, 0.1, atol=1e-6)
    # The torso moves, and what it carries is in its frame.
    carried = np.array(chunks[head, "Mesh3D:vertex_positions"][1][0])
    np.testing.assert_allclose(carried.max(axis=0), [0.22, 0.1, 0.6], atol=1e-6)
