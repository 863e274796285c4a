"""The circle fit of the model-based policies."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy.spatial.transform import Rotation

from gplfd_env import DoorGeometry
from gplfd_policies.agents.model_based.following import UPRIGHT, Circle, _distances

pytestmark = pytest.mark.slow

CERTAIN = replace(UPRIGHT, noise=1e-6)
RADII = st.floats(0.3, 1.0)
HEADINGS = st.floats(-0.1, 0.1)
TILTS = st.floats(-0.02, 0.02)
X, _, Z = np.eye(3)


def fit_circle(points, prior=UPRIGHT):
    """The most probable circle through the origin and along points."""
    circle = Circle(prior=prior, parameters=prior.mean)
    for _ in range(15):
        circle = circle.updated(points)
    return circle


def door(radius, heading=0.0, tilt=0.0, slope=0.0):
    axes = Rotation.from_rotvec([tilt, heading, slope]).as_matrix()
    return DoorGeometry(hinge=-radius * axes[:, 2], axis=axes[:, 1])


def way(door, length, spacing=0.005):
    """The hand's way along a door's circle, without its start."""
    count = round(length / spacing)
    return door.hand_poses(np.arange(1, count + 1) * spacing / door.radius)[:, :3]


def error(circle, door):
    fitted = circle.door()
    off = np.linalg.norm(fitted.hinge - door.hinge) / door.radius
    return off + np.linalg.norm(fitted.axis - door.axis)


@given(RADII, HEADINGS, TILTS, TILTS, st.floats(0.05, 0.5))
def test_exact_circles_are_recovered(radius, heading, tilt, slope, length):
    true = door(radius, heading, tilt, slope)
    assert error(fit_circle(way(true, length), CERTAIN), true) < 2e-3


def test_short_arcs_are_not_pulled_inwards_by_noise():
    """As Kåsa's algebraic fit is, which takes noise for curvature."""
    true, flat = door(0.9), replace(UPRIGHT, radius=0.9, curvature_std=100.0)
    rng = np.random.default_rng(0)
    curvatures, algebraic = [], []
    for _ in range(100):
        points = way(true, 0.15) + 1e-3 * rng.normal(size=(30, 3))
        curvatures.append(fit_circle(points, flat).curvature)
        plane = points[:, [0, 2]]
        centre = np.linalg.lstsq(plane, (plane**2).sum(axis=1) / 2.0)[0]
        algebraic.append(1.0 / np.linalg.norm(centre))
    bias, kasa = (abs(np.mean(fits) * 0.9 - 1.0) for fits in (curvatures, algebraic))
    assert bias < 0.04 < 0.08 < kasa


@settings(max_examples=15)
@given(st.tuples(*[st.floats(-3.0, 3.0)] * 3), RADII, HEADINGS, st.integers(0, 9))
def test_a_turned_task_turns_the_estimate(turn, radius, heading, seed):
    rotation = Rotation.from_rotvec(turn).as_matrix()
    points = way(door(radius, heading), 0.3)
    points += 1e-3 * np.random.default_rng(seed).normal(size=points.shape)
    turned = replace(UPRIGHT, axes=rotation @ UPRIGHT.axes)
    here = fit_circle(points).door()
    rotated = fit_circle(points @ rotation.T, turned).door()
    assert_allclose(rotated.hinge, rotation @ here.hinge, atol=1e-7)
    assert_allclose(rotated.axis, rotation @ here.axis, atol=1e-7)


@pytest.mark.parametrize(
    "points",
    [
        np.zeros((0, 3)),
        np.zeros((20, 3)),
        *(np.linspace(0.01, 0.5, 50)[:, None] * line for line in (*np.eye(3), -X, -Z)),
        np.tile([0.0, 0.0, -UPRIGHT.radius], (9, 1)),
        1e3 * np.random.default_rng(0).normal(size=(50, 3)),
    ],
)
def test_what_is_no_circle_gives_a_bounded_door(points):
    with np.errstate(all="raise"):
        door = fit_circle(points).door()
    assert np.isfinite([door.hinge, door.axis, door.pull]).all()
    assert 0.1 - 1e-9 <= door.radius <= 5.0 + 1e-9
    assert door.axis[1] > 0.5 < door.pull[0]


@given(st.floats(0.0, 3.0), st.integers(0, 99))
def test_derivatives_are_those_of_the_distances(curvature, seed):
    rng = np.random.default_rng(seed)
    points, step = 0.2 * rng.normal(size=(5, 3)), 1e-6

    def distances(change):
        turned = points @ Rotation.from_rotvec(change[:3]).as_matrix()
        return _distances(turned.T, curvature + change[3])[0]

    for number, analytic in enumerate(_distances(points.T, curvature)[1]):
        change = step * np.eye(4)[number]
        numeric = (distances(change) - distances(-change)) / (2.0 * step)
        assert_allclose(numeric, analytic, atol=1e-8)
