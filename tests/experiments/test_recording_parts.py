"""What a recording is made of: bodies drawn and moved, and tubes."""

import mujoco
import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_experiments.recording.scene import (
    drawn_scene,
    entity_of_body,
    moved_scene,
    task_frame,
    visual_geoms,
)
from gplfd_experiments.recording.tube import (
    N_SIDES,
    QUANTILE,
    tube_triangles,
    tube_vertices,
)

pytestmark = pytest.mark.slow


FIXED = """
<mujoco><worldbody>
  <geom type="box" size="1 1 1" pos="0 0 -1"/>
  <body name="post" pos="1 2 3" quat="0.8 0 0 0.6">
    <geom type="box" size="0.1 0.1 0.1" pos="0.5 0 0"/>
    <site name="task_frame" pos="0.5 0 0" quat="0.6 0.8 0 0"/>
    <body name="slide" pos="0 0 1"><joint type="slide"/>
      <body name="hook" pos="0 1 0" quat="0.6 0 0.8 0">
        <body pos="0 0 1"><geom type="box" size="0.1 0.1 0.1" pos="0 0.5 0"/></body>
      </body>
    </body>
  </body>
</worldbody></mujoco>
"""


def test_geoms_of_fixed_bodies_are_drawn_where_their_carrier_has_them(columns):
    """The pose on the carrier, moved by the carrier's, is MuJoCo's own."""
    model = mujoco.MjModel.from_xml_string(FIXED)
    data = mujoco.MjData(model)
    data.qpos[0] = 0.3
    mujoco.mj_kinematics(model, data)
    slide = model.body("slide").id
    assert visual_geoms(model) == {0: [0, 1], slide: [2]}
    drawn = columns(drawn_scene(model))
    for body, geoms in visual_geoms(model).items():
        entity = entity_of_body(model, body)
        _, (centres,) = drawn[entity, "Boxes3D:centers"]
        _, (quaternions,) = drawn[entity, "Boxes3D:quaternions"]
        turn = data.xmat[body].reshape(3, 3)
        world = data.xpos[body] + np.array(centres) @ turn.T
        np.testing.assert_allclose(world, data.geom_xpos[geoms], atol=1e-6)
        turned = turn @ Rotation.from_quat(quaternions).as_matrix()
        matrices = data.geom_xmat[geoms].reshape(-1, 3, 3)
        np.testing.assert_allclose(turned, matrices, atol=1e-6)
    origin, rotation = task_frame(model)
    site = data.site("task_frame")
    np.testing.assert_allclose(origin, site.xpos)
    np.testing.assert_allclose(rotation.as_matrix().ravel(), site.xmat, atol=1e-12)


SLIDES = """
<mujoco><worldbody>
  <body name="a"><joint type="slide" axis="1 0 0"/><geom size="0.1"/></body>
  <body name="b"><joint type="slide" axis="0 1 0"/><geom size="0.1"/></body>
</worldbody></mujoco>
"""


def test_every_body_moves_by_its_own_joint(make_log, columns):
    """And between frames as in a video."""
    model = mujoco.MjModel.from_xml_string(SLIDES)
    log = make_log(qpos=np.outer(np.linspace(0.0, 1.0, 601), [1.0, 2.0]))
    moved = columns(moved_scene(model, log))
    for name, end in (("a", [1.0, 0.0, 0.0]), ("b", [0.0, 2.0, 0.0])):
        times, places = moved[f"/world/scene/{name}", "Transform3D:translation"]
        np.testing.assert_allclose([places[0][0], places[-1][0]], [[0.0] * 3, end])
        assert np.diff(times).max() <= 1.0 / 30.0


# --- Tubes -------------------------------------------------------------------


def test_tube_touches_the_ellipse_of_the_normal_quantile():
    """On a straight path along x the section has half axes 1.96 σ_z and 1.96 σ_y."""
    mean = np.outer(np.linspace(0.0, 1.0, 30), [1.0, 0.0, 0.0])
    vertices, normals = tube_vertices(mean, np.tile([9.0, 0.01, 0.02], (30, 1)))
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)
    across = vertices / (QUANTILE * np.array([np.inf, 0.01, 0.02]))
    np.testing.assert_allclose(np.linalg.norm(across, axis=1), 1.0, rtol=1e-6)
    triangles = tube_triangles()
    a, b, c = (vertices[triangles[:, corner]] for corner in range(3))
    outward = np.sum(np.cross(b - a, c - a) * normals[triangles[:, 0]], axis=1)
    assert np.all(outward > 0.0) or np.all(outward < 0.0)


@pytest.mark.parametrize("height", [0.0, 1.0])
def test_tube_of_a_path_without_a_direction_is_finite(height):
    """One that stands still, and one straight upwards."""
    mean = np.outer(np.linspace(0.0, height, 5), [0.0, 1.0, 0.0])
    vertices, normals = tube_vertices(mean, np.zeros((5, 3)))
    assert np.isfinite(vertices).all()
    np.testing.assert_allclose(np.linalg.norm(normals, axis=1), 1.0, rtol=1e-6)


def test_tube_of_a_path_that_waits_keeps_its_direction():
    """Noise at the end of a path along x does not turn the last section."""
    mean = np.zeros((40, 3))
    mean[:20, 0], mean[20:, 0] = np.linspace(0.0, 1.0, 20), 1.0
    mean[20:, 2] = 1e-4 * np.random.default_rng(0).normal(size=20)
    vertices, _ = tube_vertices(mean, np.full((40, 3), 0.1))
    last = vertices[-N_SIDES:]
    np.testing.assert_allclose(last[:, 0], 1.0, atol=1e-3)


def test_tubes_of_many_paths_are_those_of_each():
    rng = np.random.default_rng(0)
    means = np.cumsum(rng.normal(size=(3, 40, 3)), axis=1)
    means[1, 10:20] = means[1, 10]  # it waits for a while
    stds = rng.uniform(0.01, 0.02, means.shape)
    together = tube_vertices(means, stds)
    for number, (mean, std) in enumerate(zip(means, stds, strict=True)):
        for all_of_them, alone in zip(together, tube_vertices(mean, std), strict=True):
            np.testing.assert_allclose(all_of_them[number], alone)
