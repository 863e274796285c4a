"""Probabilistic movement primitives: learning, prediction, conditioning."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies import AlignedDemonstrations, ViaPoint
from gplfd_policies.movements.baselines.promp import ProMPConfig, fit_promp

GRID = np.linspace(0.0, 1.0, 101)


@pytest.fixture(scope="module")
def promp(aligned):
    return fit_promp(aligned)


@pytest.fixture(scope="module")
def as_in_the_library(library):
    """With its basis functions and the distribution of weights that it was given."""
    aligned = AlignedDemonstrations(times=library["phases"], poses=library["poses"])
    sample = library["promp_deviations"].T @ library["promp_deviations"]
    return replace(
        fit_promp(aligned, ProMPConfig(n_basis=20, overlap=0.7)),
        weight_mean=library["promp_mean"],
        weight_covariance=sample + 0.5 * np.diag(np.diag(sample)),
    )


def dense(config, phases):
    """Weights to values of all outputs at the phases, (6 M, W), by the definition."""
    centres = np.linspace(0.0, 1.0, config.n_basis)
    distance = (phases[:, None] - centres) * 2.0 * config.n_basis
    gaussians = config.overlap ** (distance**2)
    return np.kron(np.eye(6), gaussians / gaussians.sum(axis=1, keepdims=True))


def test_basis_functions_have_the_stated_overlap_and_sum_to_one(promp):
    phases = np.array([0.0, 0.31, 1.0, 1.2])
    expected = dense(promp.config, phases) @ promp.weight_mean
    assert_allclose(promp.predict(phases).mean.T.ravel(), expected, atol=1e-12)
    constant = replace(promp, weight_mean=np.full_like(promp.weight_mean, 0.7))
    assert_allclose(constant.predict(GRID).mean, 0.7, rtol=1e-12)


def test_learning_recovers_the_distribution_the_demonstrations_came_from():
    rng = np.random.default_rng(0)
    small = ProMPConfig(n_basis=4, shrinkage=0.0)
    root = rng.normal(size=(24, 24)) / 5.0
    noise = np.array([1e-2, 2e-2, 3e-2, 1e-2, 2e-2, 3e-2])
    weights = rng.normal(size=24) + rng.normal(size=(4000, 24)) @ root.T
    values = (weights @ dense(small, GRID).T).reshape(-1, 6, GRID.size)
    poses = values.transpose(0, 2, 1) + noise * rng.normal(size=(4000, GRID.size, 6))
    learned = fit_promp(AlignedDemonstrations(times=GRID, poses=poses), small)
    # The ridge estimates carry R (φᵀφ)⁻¹ on top of Σ, a thousandth of it here.
    assert_allclose(learned.weight_mean, weights.mean(axis=0), atol=2e-3)
    scale = np.sqrt(np.diag(root @ root.T))
    error = (learned.weight_covariance - root @ root.T) / np.outer(scale, scale)
    assert np.abs(error).max() < 5.0 / np.sqrt(4000.0)
    assert_allclose(np.sqrt(learned.noise_variance), noise, rtol=5e-3)


def test_distribution_equals_the_library_for_the_same_weights(
    as_in_the_library, library
):
    ours = as_in_the_library.predict(library["promp_phases"])
    assert_allclose(ours.mean, library["promp_positions"], rtol=1e-10, atol=1e-12)
    assert_allclose(ours.mean_rate, library["promp_rates"], rtol=1e-9, atol=1e-9)
    some = as_in_the_library.predict(library["promp_phases"][::2])
    rows, columns = np.tril_indices(some.times.size)
    noise = as_in_the_library.noise_variance[:, None] * (rows == columns)
    assert_allclose(
        some.covariance[:, rows, columns],
        library["promp_covariance"] + noise,
        atol=1e-12,
    )


def test_few_demonstrations_span_few_movements(aligned):
    published = fit_promp(aligned, ProMPConfig(shrinkage=0.0))
    rank = np.linalg.matrix_rank(published.weight_covariance, tol=1e-10)
    assert rank == len(aligned.poses) - 1
    phases = aligned.times[80:81]

    def miss(movement, pose):
        demand = ViaPoint(phase=float(phases[0]), pose=pose, std=1e-3)
        met = movement.adapt([demand]).predict(phases).mean[0]
        return float(np.abs(met - pose).max())

    # What was demonstrated is met; a standard deviation off in x but not in z is not.
    assert miss(published, aligned.poses[0, 80]) < 1e-3
    usual = published.predict(phases)
    foreign = usual.mean[0] + usual.std[0] * [1.0, 0.0, 1.0, 0.0, 1.0, 0.0]
    assert miss(published, foreign) > 5e-3
    assert miss(fit_promp(aligned, ProMPConfig(shrinkage=0.3)), foreign) < 2e-3
    # Insisting bends the rest out of what was demonstrated.
    insisted = ViaPoint(phase=float(phases[0]), pose=foreign, std=1e-7)
    before = published.predict(GRID)
    after = fit_promp(aligned).adapt([insisted]).predict(GRID)
    assert np.max(np.abs(after.mean - before.mean) / before.std) > 2.5
