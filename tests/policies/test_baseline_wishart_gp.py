"""The movement with Wishart variability."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import AlignedDemonstrations
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("unchecked_types")]

TIMES = np.linspace(0.0, 1.0, 40)
STD = 0.02 * np.exp(1.2 * np.sin(5.0 * TIMES))
QUICK = WishartGPConfig(steps=200, discarded=60)


def curves():
    return np.stack([np.sin(3.0 * TIMES + k) for k in range(6)], axis=1)


def demonstrations(count=6, seed=0):
    noise = np.random.default_rng(seed).normal(size=(count, len(TIMES), 6))
    poses = curves() + STD[:, None] * noise
    return AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)


@pytest.fixture(scope="module")
def movement():
    return fit_wishart_gp(demonstrations(), QUICK, 0)


def test_variance_is_that_of_the_mean_and_of_repetitions(movement):
    grid = np.linspace(0.0, 1.0, 21)
    moments = movement.processes.moments(grid)
    aleatoric = movement.aleatoric(grid)
    spread = np.diagonal(aleatoric, axis1=1, axis2=2)
    predicted = movement.predict(grid)
    assert_array_equal(predicted.mean, moments.mean)
    assert_allclose(predicted.std**2, moments.latent + spread)
    assert (np.linalg.eigvalsh(aleatoric)[:, 0] > 0.0).all()
    for output, covariance in enumerate(predicted.covariance):
        assert_allclose(np.diag(covariance), predicted.std[:, output] ** 2, rtol=1e-9)
        white = covariance - np.diag(spread[:, output])
        latent = movement.processes.latent_covariance(grid)[output]
        assert_allclose(white, latent, atol=1e-12)


def test_prior_mean_is_the_pooled_covariance(movement):
    deviations = movement.aligned.poses - movement.aligned.poses.mean(axis=0)
    pooled = np.mean(
        [np.cov(deviations[:, t].T) for t in range(len(TIMES))],
        axis=0,
    )
    lower = movement.variability.prior.lower
    assert_allclose(QUICK.degrees * lower @ lower.T, pooled, rtol=1e-5, atol=1e-9)


@pytest.mark.bits
def test_mean_and_spread_are_the_demonstrated_ones():
    # So many that the prior, twenty times as wide at the end, hardly counts there.
    many = fit_wishart_gp(demonstrations(200), QUICK, 0)
    predicted = many.predict(TIMES)
    assert_allclose(predicted.mean, curves(), atol=0.02)
    ratio = predicted.std.mean(axis=1) / STD
    assert_allclose(ratio[2:-2], 1.0, atol=0.15)
    assert_allclose(ratio, 1.0, atol=0.3)


def test_outputs_that_vary_together_are_seen_to():
    poses = demonstrations(20).poses.copy()
    deviation = poses - curves()
    poses[:, :, 1] = curves()[:, 1] - 2.0 * deviation[:, :, 0]
    movement = fit_wishart_gp(AlignedDemonstrations(times=TIMES, poses=poses), QUICK, 0)
    covariance = movement.aleatoric(TIMES)
    std = np.sqrt(np.diagonal(covariance, axis1=1, axis2=2))
    correlation = covariance / (std[:, :, None] * std[:, None, :])
    assert (correlation[:, 0, 1] < -0.95).all()
    assert abs(correlation[:, 2, 3].mean()) < 0.2
