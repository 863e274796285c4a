"""Gaussian mixture regression against the gmr package, and what it promises."""

import gmr
import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies import AlignedDemonstrations, align
from gplfd_policies.movements.baselines.gmr import GMRConfig, fit_gmr

TIMES = np.linspace(0.0, 1.0, 60)


@pytest.fixture(scope="module")
def regression(demonstrations):
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
    assert_allclose(mean[0], expected.mean, rtol=1e-9, atol=1e-11)
    assert_allclose(covariance[0], expected.covariance, atol=1e-10)


def test_one_component_is_linear_regression_on_phase():
    """Of demonstrations that scatter independently around a curve, more and more."""
    curve = np.stack([np.sin(2.0 * TIMES + k) for k in range(6)], axis=1)
    noise = np.random.default_rng(0).normal(size=(8, len(TIMES), 6))
    poses = curve + (0.02 + 0.08 * TIMES)[:, None] * noise
    aligned = AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)
    single = fit_gmr(aligned, GMRConfig(components=1, regularisation=1e-12))
    predicted = single.predict(TIMES)
    phases = np.tile(TIMES, len(aligned.poses))
    samples = aligned.poses.reshape(-1, 6)
    line = np.polynomial.polynomial.polyfit(phases, samples, 1)
    expected = line[0] + TIMES[:, None] * line[1]
    assert_allclose(predicted.mean, expected, atol=1e-9)
    residual = (samples - line[0] - phases[:, None] * line[1]).std(axis=0)
    assert_allclose(predicted.std, np.tile(residual, (60, 1)), rtol=1e-6)
