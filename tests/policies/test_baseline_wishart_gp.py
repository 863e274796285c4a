"""Elliptical slice sampling and the Wishart process, and the movement with them."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import multivariate_normal

from gplfd_policies import AlignedDemonstrations
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    WishartLikelihood,
    WishartPrior,
    elliptical_slice_chain,
    fit_wishart_gp,
    sample_posterior,
)

pytestmark = pytest.mark.slow

MEAN = np.array([[4.0, 1.0], [1.0, 2.0]])


def prior(degrees=3, floor=1e-3):
    return WishartPrior((0.0, 1.0), 0.2, MEAN, degrees, floor)


def covariance(process, weights, times):
    """Σ(t) for the weights, of one draw or of many."""
    unit = np.einsum("...kdr,mr->...mdk", weights, process.features(times))
    return process.scaled(unit @ unit.swapaxes(-2, -1))


def test_sampler_meets_a_gaussian_posterior():
    mixing = np.array([[1.0, 0.5], [0.0, 2.0]])
    observed, variance = np.array([1.0, -1.0]), 0.3
    precision = np.eye(2) + mixing.T @ mixing / variance
    mean = np.linalg.solve(precision, mixing.T @ observed / variance)

    def log_likelihood(x):
        return -0.5 * float(np.sum((observed - mixing @ x) ** 2)) / variance

    chain = elliptical_slice_chain(
        log_likelihood, np.array([3.0, 3.0]), 6000, np.random.default_rng(2)
    )
    states = np.array(list(chain))[100:]
    assert_allclose(states.mean(axis=0), mean, atol=0.03)
    assert_allclose(np.cov(states.T), np.linalg.inv(precision), atol=0.02)


def test_prior_draws_average_to_nu_l_lt():
    process, rng = prior(degrees=3, floor=0.1), np.random.default_rng(0)
    lower = np.linalg.cholesky(MEAN / 3)
    assert_allclose(process.lower, lower)
    times = np.array([0.1, 0.3, 0.9])
    weights = rng.standard_normal((16000, *process.shape))
    draws = covariance(process, weights, times)
    assert_allclose(draws.mean(axis=0), np.tile(MEAN, (3, 1, 1)), atol=0.1)
    # A Wishart variance of ν degrees of freedom, less the floor: 2 (Σ_ii)²/ν.
    variances = draws[:, :, [0, 1], [0, 1]]
    expected = np.sqrt(2.0 / 3.0) * 0.9 * np.diag(MEAN)
    assert_allclose(variances.std(axis=0), np.tile(expected, (3, 1)), rtol=0.05)
    # Squares of Gaussians of correlation κ are correlated κ².
    correlation = np.corrcoef(variances[:, :, 0].T)
    kappa = np.exp(-0.5 * (np.subtract.outer(times, times) / 0.2) ** 2)
    assert_allclose(correlation, kappa**2, atol=0.03)


def likelihood_case():
    process, rng = prior(), np.random.default_rng(3)
    curves = rng.normal(size=(5, 7, 2)) + 4.0
    times = np.linspace(0.0, 1.0, 7)
    deviations = curves - curves.mean(axis=0)
    return process, curves, WishartLikelihood(process, times, deviations)


def test_likelihood_is_that_of_independent_contrasts():
    """D curves of unknown mean carry D − 1 contrasts, each N(0, Σ(t))."""
    process, curves, likelihood = likelihood_case()
    contrasts = np.zeros((4, 5))
    for row in range(4):
        contrasts[row, : row + 1] = 1.0 / (row + 1)
        contrasts[row, row + 1] = -1.0
    contrasts /= np.linalg.norm(contrasts, axis=1, keepdims=True)
    seen = np.einsum("ck,kti->cti", contrasts, curves)
    values, expected = [], []
    for seed in (0, 1):
        weights = np.random.default_rng(seed).standard_normal(process.shape)
        covariances = covariance(process, weights, np.linspace(0.0, 1.0, 7))
        values.append(likelihood(weights.ravel()))
        expected.append(
            sum(
                multivariate_normal(np.zeros(2), covariances[t])
                .logpdf(seen[:, t])
                .sum()
                for t in range(7)
            )
        )
    assert values[1] - values[0] == pytest.approx(expected[1] - expected[0])


@pytest.mark.bits
def test_likelihood_gradient_equals_finite_differences():
    process, _, likelihood = likelihood_case()
    flat = np.random.default_rng(4).standard_normal(process.shape).ravel()
    # Shorter steps would differentiate the rounding of a value in the hundreds.
    step, numeric = 1e-5, np.empty_like(flat)
    for index in range(len(flat)):
        moved = step * (np.arange(len(flat)) == index)
        rise = likelihood(flat + moved) - likelihood(flat - moved)
        numeric[index] = rise / (2.0 * step)
    assert_allclose(likelihood.gradient(flat), numeric, rtol=1e-5, atol=1e-6)


@pytest.mark.bits
def test_posterior_averages_the_covariances_of_its_samples():
    process, rng = prior(floor=0.05), np.random.default_rng(5)
    samples = rng.standard_normal((4, *process.shape))
    flat = samples.reshape(4, process.degrees, -1)
    moment = np.einsum("ska,skb->ab", flat, flat) / 4
    times = np.array([-0.5, 0.0, 0.33, 1.0, 2.0])
    expected = np.mean([covariance(process, w, times) for w in samples], axis=0)
    average = process.average(moment, times)
    assert_allclose(average, expected, rtol=1e-9)
    # Matrix products of five and of two rows may add in another order.
    assert_allclose(average[[0, 4]], process.average(moment, times[[1, 3]]), rtol=1e-12)


def test_sampler_averages_what_the_posterior_says():
    """One output, one degree, one time: the posterior of u² by quadrature."""
    process = WishartPrior((0.0, 1.0), 0.3, np.array([[2.0]]), 1, 0.01)
    deviations = np.array([[0.7], [-0.2], [-0.5]])[:, :, None]
    likelihood = WishartLikelihood(process, np.array([0.4]), deviations)
    grid = np.linspace(-8.0, 8.0, 4001)
    variance = 2.0 * (0.99 * grid**2 + 0.01)
    scatter = 0.7**2 + 0.2**2 + 0.5**2
    density = np.exp(-0.5 * grid**2 - 0.5 * scatter / variance) / variance
    expected = float(variance @ density / density.sum())
    rng = np.random.default_rng(0)
    # Standard error 1.2 %; of 4000 steps it is 4 %, and rounding decides the chain.
    config = WishartGPConfig(steps=25_000, discarded=100)
    moment = sample_posterior(likelihood, config, rng)
    sampled = process.average(moment, np.array([0.4]))[0, 0, 0]
    assert sampled == pytest.approx(expected, rel=0.05)


# --- The movement with Wishart variability ------------------------------------


TIMES = np.linspace(0.0, 1.0, 40)
STD = 0.02 * np.exp(1.2 * np.sin(5.0 * TIMES))
QUICK = WishartGPConfig(steps=200, discarded=60)


def test_variance_is_that_of_the_mean_and_of_repetitions():
    curves = np.stack([np.sin(3.0 * TIMES + k) for k in range(6)], axis=1)
    noise = np.random.default_rng(0).normal(size=(6, len(TIMES), 6))
    poses = curves + STD[:, None] * noise
    aligned = AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)
    movement = fit_wishart_gp(aligned, QUICK, 0)
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
