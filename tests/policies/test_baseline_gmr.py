"""Gaussian mixture regression against the gmr package, and what it promises."""

import warnings
from dataclasses import replace

import gmr
import numpy as np
import pytest

from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.movements.baselines.gmr import (
    GaussianMixtureRegression,
    GMRConfig,
    fit_gmr,
)

TIMES = np.linspace(0.0, 1.0, 60)


def scattered(count: int = 8, seed: int = 0) -> AlignedDemonstrations:
    """Demonstrations that scatter independently around a curve, more and more."""
    rng = np.random.default_rng(seed)
    curve = np.stack([np.sin(2.0 * TIMES + k) for k in range(6)], axis=1)
    noise = rng.normal(size=(count, len(TIMES), 6))
    poses = curve + (0.02 + 0.08 * TIMES)[:, None] * noise
    return AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)


@pytest.fixture(scope="module")
def regression(demonstrations) -> GaussianMixtureRegression:
    return fit_gmr(align(demonstrations))


@pytest.mark.parametrize("phase", [-0.3, 0.0, 0.37, 0.5, 1.0, 1.4])
def test_moments_equal_the_gmr_package(regression, phase):
    oracle = gmr.GMM(
        len(regression.weights),
        regression.weights,
        regression.means,
        regression.covariances,
    )
    expected = oracle.condition(np.array([0]), np.array([phase])).to_mvn()
    mean, covariance = regression.standardised_moments(np.array([phase]))
    np.testing.assert_allclose(mean[0], expected.mean, rtol=1e-9, atol=1e-11)
    np.testing.assert_allclose(covariance[0], expected.covariance, atol=1e-10)


def test_poses_are_the_standardised_moments_scaled_back(regression):
    grid = np.linspace(0.0, 1.0, 21)
    mean, covariance = regression.standardised_moments(grid)
    poses, in_units = regression.moments(grid)
    samples = regression.aligned.poses.reshape(-1, 6)
    scale = samples.std(axis=0)
    np.testing.assert_allclose(poses, samples.mean(axis=0) + scale * mean)
    np.testing.assert_allclose(in_units, np.outer(scale, scale) * covariance)


def test_one_component_is_linear_regression_on_phase():
    aligned = scattered()
    single = fit_gmr(aligned, GMRConfig(components=1, regularisation=1e-12))
    predicted = single.predict(TIMES)
    phases = np.tile(TIMES, len(aligned.poses))
    samples = aligned.poses.reshape(-1, 6)
    line = np.polynomial.polynomial.polyfit(phases, samples, 1)
    expected = line[0] + TIMES[:, None] * line[1]
    np.testing.assert_allclose(predicted.mean, expected, atol=1e-9)
    residual = (samples - line[0] - phases[:, None] * line[1]).std(axis=0)
    np.testing.assert_allclose(predicted.std, np.tile(residual, (60, 1)), rtol=1e-6)


def test_mean_and_spread_follow_the_demonstrations():
    aligned = scattered(count=40)
    predicted = fit_gmr(aligned).predict(TIMES)
    spread = (0.02 + 0.08 * TIMES)[:, None]
    assert np.abs((predicted.mean - aligned.poses.mean(axis=0)) / spread).max() < 0.8
    ratio = (predicted.std / spread)[5:-5]
    assert 0.75 < ratio.min() <= ratio.max() < 1.35


def test_covariance_over_time_is_diagonal(regression):
    predicted = regression.predict(np.linspace(0.0, 1.0, 7))
    for output in range(6):
        np.testing.assert_allclose(
            predicted.covariance[output], np.diag(predicted.std[:, output] ** 2)
        )


def test_result_does_not_depend_on_units(regression):
    aligned = regression.aligned
    factor = np.array([1e3, 1e2, 1.0, 57.3, 1e-3, 10.0])
    shift = np.array([5.0, -2.0, 0.0, 1.0, 0.1, 100.0])
    other = fit_gmr(replace(aligned, poses=factor * aligned.poses + shift))
    grid = np.linspace(-0.1, 1.1, 33)
    ours, theirs = regression.predict(grid), other.predict(grid)
    np.testing.assert_allclose(theirs.mean, factor * ours.mean + shift, rtol=1e-6)
    np.testing.assert_allclose(theirs.std, factor * ours.std, rtol=1e-6)


@pytest.mark.parametrize("phase", [-60.0, 60.0])
def test_far_outside_one_component_goes_on(regression, phase):
    """Every density underflows there; their ratio does not."""
    far = np.array([phase, phase + 1.0])
    shares = regression.responsibilities(far)
    np.testing.assert_allclose(shares.sum(axis=1), 1.0)
    widest = np.argmax(regression.covariances[:, 0, 0])
    assert (shares[:, widest] > 0.999).all()
    mean, covariance = regression.standardised_moments(far)
    np.testing.assert_allclose(mean[1] - mean[0], regression.slopes[widest])
    np.testing.assert_allclose(
        covariance[0], regression.conditional_covariances[widest], rtol=1e-6
    )


def test_one_demonstration_and_outputs_that_rest_are_learned():
    poses = np.zeros((1, len(TIMES), 6))
    poses[0, :, 0] = TIMES
    predicted = fit_gmr(AlignedDemonstrations(times=TIMES, poses=poses)).predict(TIMES)
    np.testing.assert_allclose(predicted.mean, poses[0], atol=0.01)
    assert (predicted.std > 0.0).all()


def test_stopping_too_early_is_told_in_our_words():
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        fit_gmr(scattered(), GMRConfig(max_iterations=1))
    (warning,) = caught
    assert "did not converge in 1 iterations; raise max_iter" in str(warning.message)
