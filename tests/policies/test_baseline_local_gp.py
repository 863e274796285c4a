"""Local Gaussian processes and their product, against scikit-learn and by hand."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import norm
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF as SklearnRBF
from sklearn.gaussian_process.kernels import ConstantKernel, WhiteKernel

from gplfd_policies import AlignedDemonstrations
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig, fit_local_gp

pytestmark = pytest.mark.slow

TIMES = np.linspace(0.0, 1.0, 80)
STEP_STD = np.where(TIMES < 0.5, 0.01, 0.05)


CURVES = np.stack([np.sin(3.0 * TIMES + k) for k in range(6)], axis=1)


def demonstrations(std, count=6, seed=0):
    noise = np.random.default_rng(seed).normal(size=(count, len(TIMES), 6))
    poses = CURVES + std[:, None] * noise
    return AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)


def experts(movement, times):
    """Mean and variance of every local prediction, (C, M, 6) each."""
    means = [
        [p.offset + p.scale * p.latent.mean(times) for p in outputs]
        for outputs in movement.processes
    ]
    variances = [
        [
            p.scale**2 * (p.latent.variance(times) + p.noise.variance(times))
            for p in outputs
        ]
        for outputs in movement.processes
    ]
    return np.swapaxes(means, 1, 2), np.swapaxes(variances, 1, 2)


@pytest.fixture(scope="module")
def movement():
    return fit_local_gp(demonstrations(STEP_STD), LocalGPConfig(clusters=4))


def test_one_cluster_is_a_plain_gaussian_process():
    aligned = demonstrations(np.full(80, 0.1), count=3)
    movement = fit_local_gp(aligned, LocalGPConfig(clusters=1))
    grid, output = np.linspace(-0.1, 1.1, 31), 2
    kernel = movement.processes[0][output].kernel
    noise = float(movement.processes[0][output].noise.variance(TIMES)[0])
    observed = aligned.poses[:, :, output].ravel()
    start = (
        ConstantKernel(kernel.signal_std**2) * SklearnRBF(kernel.length_scale)
    ) + WhiteKernel(noise)
    inputs = np.tile(TIMES, 3)[:, None]
    plain = GaussianProcessRegressor(start, optimizer=None, normalize_y=True)
    plain.fit(inputs, observed)
    mean, covariance = plain.predict(grid[:, None], return_cov=True)
    predicted = movement.predict(grid)
    assert_allclose(predicted.mean[:, output], mean, atol=1e-9)
    assert_allclose(predicted.covariance[output], covariance, atol=1e-9)
    assert_allclose(predicted.std[:, output], np.sqrt(np.diag(covariance)), rtol=1e-8)
    # The hyper-parameters are those of a free search over all observations.
    free = GaussianProcessRegressor(start, normalize_y=True).fit(inputs, observed)
    assert_allclose(free.kernel_.theta, start.theta, atol=0.02)


def test_prediction_is_the_product_of_powers_of_the_local_densities(movement):
    """The product of densities, multiplied on a fine grid of poses and normalised."""
    times = np.array([0.1, 0.24, 0.26, 0.5, 0.55, 0.9])
    means, variances = experts(movement, times)
    centres = np.array([TIMES[i : i + 20].mean() for i in range(0, 80, 20)])
    width = 0.35 * (centres[1] - centres[0])
    weights = np.exp(-0.5 * ((centres[:, None] - times) / width) ** 2)
    weights /= weights.sum(axis=0)
    predicted = movement.predict(times)
    for i, output in [(0, 0), (1, 1), (2, 2), (3, 3), (4, 4), (5, 5)]:
        value = predicted.mean[i, output] + np.linspace(-0.5, 0.5, 20001)
        local = norm.logpdf(
            value[:, None], means[:, i, output], np.sqrt(variances[:, i, output])
        )
        log_density = local @ weights[:, i]
        density = np.exp(log_density - log_density.max())
        density /= density.sum()
        mean = value @ density
        assert predicted.mean[i, output] == pytest.approx(mean, abs=1e-9)
        std = np.sqrt((value - mean) ** 2 @ density)
        assert predicted.std[i, output] == pytest.approx(std, rel=1e-6)


def test_plain_product_is_over_confident(movement):
    """Where nothing was seen the weighted product keeps the prior variance."""
    unseen = np.array([30.0])
    _, variances = experts(movement, unseen)
    plain = 1.0 / np.sum(1.0 / variances, axis=0)
    weighted = movement.predict(unseen).std ** 2
    assert (weighted > 0.999 * variances.min(axis=0)).all()
    assert np.median(weighted / plain) > 4.0
    # Where one was seen, three others sharpen what they know nothing about.
    _, seen = experts(movement, TIMES)
    held_out = demonstrations(STEP_STD, count=50, seed=9).poses
    deviation = np.abs(held_out - CURVES)
    plain = np.sqrt(1.0 / np.sum(1.0 / seen, axis=0))
    assert np.mean(deviation < 1.96 * plain) < 0.9
    assert np.mean(deviation < 1.96 * movement.predict(TIMES).std) > 0.93
