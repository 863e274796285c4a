import numpy as np
import pytest

from gplfd_experiments.recording.tube import (
    N_SIDES,
    QUANTILE,
    tube_triangles,
    tube_vertices,
)


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


@pytest.mark.parametrize("axis", [None, 1])
def test_tube_of_a_path_without_a_direction_is_finite(axis):
    """One that stands still, and one straight upwards."""
    mean = np.zeros((5, 3))
    if axis is not None:
        mean[:, axis] = np.linspace(0.0, 1.0, 5)
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
