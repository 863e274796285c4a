"""The mixture-based Gaussian process against its formulas and scikit-learn's."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal
from sklearn.gaussian_process.kernels import Matern

from gplfd_policies.adaptation import OwnAdaptation
from gplfd_policies.adaptation.gridded import GriddedMovement
from gplfd_policies.movements.baselines.gmm_gp import (
    MixtureKernel,
    NoiseLikelihood,
    fit_gmm_gp,
)
from gplfd_policies.movements.movement import ViaPoint

GRID = np.linspace(0.0, 1.0, 41)


@pytest.fixture(scope="module")
def process(aligned):
    return fit_gmm_gp(aligned)


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


def test_the_kernel_is_the_published_one_with_the_kernels_of_a_library(process):
    scale, phases = process.regression.standardisation.scale, GRID[1::7] + 0.01
    kernel = process.kernel(*map(process.kernel.places, (GRID, phases)))
    expected = published_kernel(process, GRID, phases)
    assert_allclose(scale[:, None, None] * kernel * scale, expected, atol=1e-12)


@pytest.mark.bits
def test_an_agent_adapts_alike_whatever_else_was_predicted(process):
    """The process keeps its last prediction, which a via-point extends."""
    gridded, means = GriddedMovement(process, OwnAdaptation, 41), []
    for other in (GRID, GRID[::2]):
        process.predict(other)
        gridded.reset()
        gridded.adapted_at(0.3).observe(ViaPoint(phase=0.3, pose=np.full(6, 0.1)))
        means.append(gridded.distribution.mean)
    assert_array_equal(*means)


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
