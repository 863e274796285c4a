"""Task-parameterised mixtures: products in closed form, moving frames, known hinges."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import AlignedDemonstrations, ViaPoint
from gplfd_policies.movements.baselines.gmr import GMRConfig, fit_gmr
from gplfd_policies.movements.baselines.tp_gmm import (
    CircleDistribution,
    TaskParameterisedMixture,
    fit_kasa_circle,
    fit_mixture_of_views,
    fit_tp_gmm,
    hinge_frame,
    hinge_uncertainty,
    product_over_frames,
)

pytestmark = pytest.mark.slow

GRID = np.linspace(0.0, 1.0, 60)


@pytest.fixture(scope="module")
def mixture(aligned):
    return fit_tp_gmm(aligned)


def at_hinge(mixture, radius):
    """The movement for a door whose hinge is known."""
    circle = CircleDistribution(
        mean=np.array([0.0, -radius, 0.0]), covariance=np.zeros((3, 3))
    )
    return replace(mixture, circle=circle)


def arc(radius, angles, std=1e-3):
    poses = handle_pose_on_arc(radius, angles)
    return [
        ViaPoint(phase=0.5 * angle, pose=pose, std=std)
        for angle, pose in zip(angles, poses, strict=True)
    ]


def radial_error(path, radius):
    """Largest distance from the handle's circle, where the door is well open [m]."""
    return float(np.abs(np.hypot(path[30:, 0], path[30:, 2] + radius) - radius).max())


def test_product_is_proportional_to_the_densities_multiplied():
    rng = np.random.default_rng(0)
    roots = rng.normal(size=(2, 1, 3, 3))
    means, covariances = rng.normal(size=(2, 1, 3)), roots @ roots.mT + np.eye(3)
    mean, covariance = product_over_frames(means, covariances)

    def log_density(x, centre, spread):
        return -0.5 * (x - centre) @ np.linalg.solve(spread, x - centre)

    differences = [
        sum(log_density(x, means[j, 0], covariances[j, 0]) for j in range(2))
        - log_density(x, mean[0], covariance[0])
        for x in rng.normal(size=(5, 3))
    ]
    assert_allclose(differences, differences[0], atol=1e-10)


def test_one_frame_is_gaussian_mixture_regression(aligned):
    weights, means, covariances = fit_mixture_of_views(
        aligned.times, [aligned.poses], GMRConfig(components=6)
    )
    single = TaskParameterisedMixture(
        aligned=aligned,
        weights=weights,
        means=means,
        covariances=covariances,
        circle=None,
    )
    ours = single.predict(GRID)
    gmr = fit_gmr(aligned, GMRConfig(components=6)).predict(GRID)
    assert_allclose(ours.mean, gmr.mean, atol=1e-9)
    assert_allclose(ours.std, gmr.std, rtol=1e-6)


def test_demonstrated_hinges_are_where_the_doors_have_them(mixture):
    fitted = [fit_kasa_circle(poses[:, [0, 2]]) for poses in mixture.aligned.poses]
    radii = -np.array(fitted)[:, 1]
    assert_allclose(radii, np.repeat([0.35, 0.5, 0.65], 2), atol=0.01)
    assert_allclose(mixture.circle.mean[1], -radii.mean())
    assert_allclose(mixture.circle.covariance[1, 1], radii.var(ddof=1))


@pytest.mark.parametrize("radius", [0.3, 0.42, 0.58])
def test_a_known_hinge_gives_the_arc_of_a_new_door(mixture, radius):
    ours = radial_error(at_hinge(mixture, radius).predict(GRID).mean, radius)
    theirs = radial_error(fit_gmr(mixture.aligned).predict(GRID).mean, radius)
    assert ours < 0.012
    assert ours < 0.25 * theirs


@pytest.mark.parametrize("radius", [0.3, 0.42, 0.58])
def test_via_points_tell_the_hinge(mixture, radius):
    seen = mixture.adapt(arc(radius, np.linspace(0.02, 0.6, 40)))
    assert -seen.circle.mean[1] == pytest.approx(radius, abs=0.02)
    assert radial_error(seen.predict(GRID).mean, radius) < 0.02
    before, after = mixture.predict(GRID).std, seen.predict(GRID).std
    assert (after[-1, [0, 2]] < 0.6 * before[-1, [0, 2]]).all()


def test_conditioning_a_circle_is_bayesian_regression():
    rng = np.random.default_rng(3)
    root = rng.normal(size=(3, 3)) * [[0.01], [0.1], [0.002]]
    prior = CircleDistribution(mean=np.array([0, -0.5, 0]), covariance=root @ root.T)
    via_points = arc(0.42, np.linspace(0.1, 0.5, 7), std=2e-3)
    points = np.array([point.pose[[0, 2]] for point in via_points])
    rows = np.column_stack([2.0 * points, np.ones(7)])
    lever = points - prior.mean[:2]
    weight = 1.0 / (4.0 * 2e-3**2 * np.sum(lever**2, axis=1))
    information = np.linalg.inv(prior.covariance)
    precision = information + rows.T @ (weight[:, None] * rows)
    told = rows.T @ (weight * np.sum(points**2, axis=1))
    expected = np.linalg.solve(precision, information @ prior.mean + told)
    posterior = prior
    for via_point in via_points:
        posterior = posterior.through(via_point, prior.mean[:2])
    assert_allclose(posterior.mean, expected, rtol=1e-6)
    assert_allclose(posterior.covariance, np.linalg.inv(precision), rtol=1e-5)


def test_an_uncertain_hinge_spreads_the_path_as_sampled_hinges_do(mixture):
    """To first order, on top of the spread of one hinge."""
    middle, std = at_hinge(mixture, 0.5), 0.01
    covariance = np.diag([std**2, std**2, 0.0])
    uncertain = replace(middle, circle=replace(middle.circle, covariance=covariance))
    added = hinge_uncertainty(uncertain.means[1], uncertain.circle)
    frames = [
        hinge_frame(np.array([0.0, -0.5]) + step)
        for step in std * np.vstack([np.eye(2), -np.eye(2)])
    ]
    places = np.array([frame.pose(mixture.means[1][:, 1:]) for frame in frames])
    expected = (places[:2] - places[2:]) / 2.0
    assert_allclose(added, np.einsum("sci,scj->cij", expected, expected), atol=1e-12)


@pytest.mark.parametrize("path", ["straight", "resting", "wound"])
def test_without_a_circle_it_is_gaussian_mixture_regression(path):
    poses = np.zeros((2, 60, 6))
    poses[..., 4] = GRID
    if path != "resting":
        poses[..., 0] = GRID
    if path == "wound":
        poses[..., 2] = 0.1 * np.sin(30.0 * GRID)
    poses += 1e-3 * np.random.default_rng(4).normal(size=poses.shape)
    poses[..., [0, 2]] *= path != "resting"
    straight = fit_tp_gmm(AlignedDemonstrations(times=GRID, poses=poses))
    assert straight.circle is None
    gmr = fit_gmr(straight.aligned).predict(GRID)
    assert_allclose(straight.predict(GRID).mean, gmr.mean, atol=1e-3)
    via_point = ViaPoint(phase=0.5, pose=np.ones(6))
    assert straight.adapt([via_point]) is straight
