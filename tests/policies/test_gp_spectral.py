"""The exact collapse of replicates and the spectral form against the dense ones."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies.gp.exact import (
    DenseEvidence,
    ExactGP,
    Replicates,
    SpectralEvidence,
    fit_kernel,
)
from gplfd_policies.gp.kernels import RBF, SIZES, LegendreBasis

pytestmark = pytest.mark.slow

KERNEL = RBF(length_scale=0.2, signal_std=1.0)


def demonstrations(count, size):
    rng = np.random.default_rng(count * 1000 + size)
    times = np.linspace(0.0, 1.0, size)
    noise = 0.01 * np.exp(1.5 * np.sin(4.0 * times))
    samples = np.sin(4.0 * times) + np.sqrt(noise) * rng.normal(size=(count, size))
    return times, samples, noise


@pytest.mark.parametrize(("count", "size"), [(1, 30), (2, 60), (6, 60), (20, 20)])
def test_collapse_equals_naive_gp(count, size):
    times, samples, noise = demonstrations(count, size)
    replicates = Replicates.from_samples(times, samples)
    collapsed = replicates.condition(KERNEL, noise)
    full = ExactGP(
        kernel=KERNEL,
        times=np.tile(times, count),
        values=samples.ravel(),
        noise_variance=np.tile(noise, count),
    )
    value = collapsed.log_marginal_likelihood() + replicates.log_remainder(noise)
    assert value == pytest.approx(full.log_marginal_likelihood(), rel=1e-10)
    by_kernel, full_kernel = (gp.likelihood_gradient()[0] for gp in (collapsed, full))
    assert_allclose(by_kernel, full_kernel, rtol=1e-9)
    grid = np.linspace(-0.1, 1.1, 25)
    assert_allclose(collapsed.mean(grid), full.mean(grid), atol=1e-10)
    assert_allclose(collapsed.covariance(grid), full.covariance(grid), atol=1e-10)


@pytest.mark.parametrize("size", list(SIZES))
def test_basis_represents_rbf_to_rounding(size):
    start, stop = -0.3, 1.7
    basis = LegendreBasis(start=start, stop=stop, size=size)
    times = np.linspace(start, stop, 301)
    matrix = basis.matrix(times)
    for factor in (1.0, 3.0, 20.0):
        kernel = RBF(length_scale=factor * SIZES[size] * 2.0, signal_std=1.0)
        rebuilt = matrix @ basis.kernel_matrix(kernel) @ matrix.T
        assert_allclose(rebuilt, kernel(times, times), atol=1e-12)


@pytest.mark.parametrize(("size", "accuracy"), [(48, 1e-10), (96, 1e-9), (192, 2e-8)])
def test_basis_interpolates_and_differentiates_smooth_curves(size, accuracy):
    basis = LegendreBasis(start=0.0, stop=2.0, size=size)
    times = np.concatenate([np.linspace(0.0, 2.0, 41), basis.nodes[:3]])
    coefficients = basis.root_weights * np.sin(3.0 * basis.nodes)
    matrix = basis.matrix(times)
    assert_allclose(matrix @ coefficients, np.sin(3.0 * times), atol=1e-13)
    slopes = matrix @ basis.differentiate(coefficients)
    assert_allclose(slopes, 3.0 * np.cos(3.0 * times), rtol=0.0, atol=accuracy)


@pytest.mark.parametrize("size", [30, 200])
@pytest.mark.parametrize("scale", [0.4, 1.0])
def test_spectral_evidence_equals_dense(size, scale):
    times, samples, noise = demonstrations(1, size)
    basis = LegendreBasis(start=0.0, stop=1.0, size=48)
    spectral = SpectralEvidence(basis, times, samples[0], noise)
    dense = DenseEvidence(times=times, values=samples[0], noise=noise)
    for length in (0.11, 0.4, 2.0):
        kernel = RBF(length_scale=length, signal_std=0.7)
        value, gradient = spectral(kernel, scale)
        expected, expected_gradient = dense(kernel, scale)
        assert value == pytest.approx(expected, rel=1e-10)
        assert_allclose(gradient, expected_gradient, rtol=1e-8, atol=1e-8)


@pytest.mark.parametrize("size", SIZES)
def test_one_row_of_a_basis_is_that_of_its_matrix(size):
    basis = LegendreBasis(start=-0.5, stop=2.0, size=size)
    times = np.array([-0.5, 0.1234, basis.nodes[3], 2.0])
    rows = np.stack([basis.row(float(time)) for time in times])
    assert_allclose(rows, basis.matrix(times), rtol=1e-9, atol=1e-12)


def test_spectral_posterior_equals_dense():
    times, samples, noise = demonstrations(6, 150)
    replicates = Replicates.from_samples(times, samples)
    dense = replicates.condition(KERNEL, noise)
    basis = LegendreBasis(start=0.0, stop=1.0, size=48)
    weights, factor = replicates.condition_in(basis, KERNEL, noise)
    grid = np.linspace(0.0, 1.0, 77)
    matrix = basis.matrix(grid)
    assert_allclose(matrix @ weights, dense.mean(grid), atol=1e-10)
    half = matrix @ factor
    assert_allclose(half @ half.T, dense.covariance(grid), atol=1e-12)


def test_fit_finds_the_best_of_many_starts():
    times, samples, noise = demonstrations(6, 120)
    mean = samples.mean(axis=0)
    kernel, _ = fit_kernel(times, mean, noise / 6.0)
    evidence = DenseEvidence(times=times, values=mean, noise=noise / 6.0)
    grid = [
        evidence(RBF(length_scale=length, signal_std=signal), 1.0)[0]
        for length in np.geomspace(0.05, 3.0, 6)
        for signal in np.geomspace(0.05, 20.0, 6)
    ]
    assert evidence(kernel, 1.0)[0] >= max(grid)


def test_short_length_scales_widen_the_basis():
    rng = np.random.default_rng(0)
    times = np.linspace(0.0, 1.0, 150)
    true = RBF(length_scale=0.06, signal_std=1.0)(times, times)
    values = np.linalg.cholesky(true + 1e-9 * np.eye(150)) @ rng.normal(size=150)
    noise = np.full(150, 1e-4)
    kernel, _ = fit_kernel(times, values, noise)
    assert kernel.length_scale == pytest.approx(0.06, rel=0.1)
    dense = DenseEvidence(times=times, values=values, noise=noise)
    # At a maximum of the dense evidence, although the search used the spectral one.
    assert_allclose(dense(kernel, 1.0)[1][:2], 0.0, atol=1e-2)


def test_length_scales_below_every_basis_use_the_dense_form():
    rng = np.random.default_rng(1)
    times = np.linspace(0.0, 1.0, 100)
    true = RBF(length_scale=0.012, signal_std=1.0)(times, times)
    values = np.linalg.cholesky(true + 1e-9 * np.eye(100)) @ rng.normal(size=100)
    kernel, _ = fit_kernel(times, values, np.full(100, 1e-4), shortest=0.005)
    assert kernel.length_scale == pytest.approx(0.012, rel=0.2)


def test_cost_of_the_evidence_does_not_grow_with_the_samples():
    basis = LegendreBasis(start=0.0, stop=1.0, size=48)
    for size in (100, 3000):
        times, samples, noise = demonstrations(1, size)
        reduced = SpectralEvidence(basis, times, samples[0], noise)
        assert reduced.triangle.shape == (48, 48)
        assert reduced.projected.shape == (48,)
