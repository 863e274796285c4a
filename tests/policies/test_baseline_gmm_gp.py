"""The mixture-based Gaussian process against its formulas and scikit-learn's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.stats import multivariate_normal
from sklearn.gaussian_process.kernels import Matern

from gplfd_policies import ViaPoint
from gplfd_policies.movements.baselines.gmm_gp import (
    MixtureKernel,
    NoiseLikelihood,
    fit_gmm_gp,
)

GRID = np.linspace(0.0, 1.0, 41)


@pytest.fixture(scope="module")
def process(aligned):
    return fit_gmm_gp(aligned)


def shifted(process, phase, stds, sigma):
    """A demand ``stds`` standard deviations beside the mean."""
    here = process.predict(np.array([phase]))
    return ViaPoint(phase=phase, pose=here.mean[0] + stds * here.std[0], std=sigma)


def published_kernel(process, a, b):
    """K(t, t') = Σ_l h_l(t) h_l(t') Σ̂_l k_l(t, t') [m, rad], shape (A, 6, B, 6)."""
    regression = process.regression
    shares_a, shares_b = regression.responsibilities(a), regression.responsibilities(b)
    scale = regression.standardisation.scale
    total = np.zeros((len(a), 6, len(b), 6))
    for component, length in enumerate(process.kernel.length_scales):
        matern = Matern(length_scale=length, nu=2.5)(a[:, None], b[:, None])
        weight = np.outer(shares_a[:, component], shares_b[:, component]) * matern
        outputs = regression.conditional_covariances[component]
        outputs = scale[:, None] * outputs * scale
        total += weight[:, None, :, None] * outputs[None, :, None, :]
    return total


def test_half_the_power_gives_the_covariance_within_components(process):
    kernel = replace(process.kernel, weight_power=0.5)
    shares = process.regression.responsibilities(GRID)
    within = np.tensordot(shares, process.regression.conditional_covariances, axes=1)
    assert_allclose(kernel.variance(GRID), np.diagonal(within, axis1=1, axis2=2))


def test_via_points_condition_it_as_any_gaussian(process):
    """Also where the outputs of a via-point share an error."""
    along = np.array([0.02, 0.0, -0.01, 0.0, 0.05, 0.01])
    via_points = [
        replace(shifted(process, 0.31, 1.0, 1e-3), along=along),
        replace(
            shifted(process, 0.56, -1.0, 2e-3),
            std=np.array([1e-3, np.inf, 2e-3, 1e-2, np.inf, 3e-2]),
        ),
        shifted(process, 0.6, 0.5, 1e-2),
    ]
    phases = np.array([point.phase for point in via_points])
    noise = np.concatenate([point.own_variance for point in via_points])
    constrained = np.isfinite(noise)
    shared = np.append(along, np.zeros(12))
    poses = np.concatenate([point.pose for point in via_points])
    observed = published_kernel(process, phases, phases).reshape(18, 18)
    observed = observed + np.diag(np.where(constrained, noise, 0.0))
    observed = (observed + np.outer(shared, shared))[constrained][:, constrained]
    across = published_kernel(process, GRID, phases).reshape(-1, 18)[:, constrained]
    prior_mean = process.regression.moments(phases)[0].ravel()
    missed = (poses - prior_mean)[constrained]
    mean = process.regression.moments(GRID)[0].ravel()
    mean = mean + across @ np.linalg.solve(observed, missed)
    size = 6 * len(GRID)
    covariance = published_kernel(process, GRID, GRID).reshape(size, size)
    covariance = covariance - across @ np.linalg.solve(observed, across.T)
    covariance = covariance.reshape(len(GRID), 6, len(GRID), 6)

    predicted = process.adapt(via_points).predict(GRID)
    assert_allclose(predicted.mean, mean.reshape(-1, 6), atol=1e-9)
    for output in range(6):
        block = covariance[:, output, :, output]
        assert_allclose(predicted.covariance[output], block, atol=1e-10)
        assert_allclose(predicted.std[:, output] ** 2, np.diag(block), atol=1e-10)


@pytest.mark.parametrize("weight_power", [1.0, 0.5])
def test_likelihood_gradient_equals_finite_differences(process, weight_power):
    evidence = NoiseLikelihood(process.regression, 15, weight_power)
    point = np.log([*np.linspace(0.1, 0.6, 6), 1e-3])
    _, gradient = evidence.negative_log_likelihood(point)
    step = 1e-5
    numeric = [
        (
            evidence.negative_log_likelihood(point + step * unit)[0]
            - evidence.negative_log_likelihood(point - step * unit)[0]
        )
        / (2.0 * step)
        for unit in np.eye(7)
    ]
    assert_allclose(gradient, numeric, rtol=1e-5, atol=1e-5)


def test_likelihood_is_that_of_all_demonstrations_stacked(process):
    """One function, seen D times with noise, without the reduction to averages."""
    regression = process.regression
    evidence = NoiseLikelihood(regression, 8, 1.0)
    chosen = np.searchsorted(regression.aligned.times, evidence.times)
    samples = regression.standardisation.apply(regression.aligned.poses[:, chosen])
    count = len(samples)
    mean = np.tile(regression.standardised_moments(evidence.times)[0].ravel(), count)
    stacked = samples.reshape(-1)

    def dense(scales, noise):
        kernel = MixtureKernel(regression=regression, length_scales=scales)
        places = kernel.places(evidence.times)
        block = kernel(places, places).reshape(48, 48)
        joint = np.tile(block, (count, count)) + noise * np.eye(48 * count)
        return -float(multivariate_normal.logpdf(stacked, mean, joint))

    def reduced(scales, noise):
        return evidence.negative_log_likelihood(np.log([*scales, noise]))[0]

    parameters = (np.linspace(0.1, 0.6, 6), 1e-2)
    other = (np.linspace(0.5, 0.2, 6), 0.3)
    assert reduced(*parameters) - reduced(*other) == pytest.approx(
        dense(*parameters) - dense(*other), rel=1e-6
    )
