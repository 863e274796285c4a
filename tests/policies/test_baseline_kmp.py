"""Kernelized movement primitives against the published formulas, and their limits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies import ViaPoint
from gplfd_policies.movements.baselines.kmp import KMPConfig, Reference, fit_kmp

GRID = np.linspace(0.0, 1.0, 41)
FREE = 1e6
"""Variance of a free output in the dense formulas, standardised."""


def correlation(a, b, length_scale):
    return np.exp(-0.5 * np.subtract.outer(a, b) ** 2 / length_scale**2)


def blocks(primitive):
    """Σ = blockdiag(Σ_i)."""
    precisions = primitive.reference.precisions
    size = 6 * len(precisions)
    sigma = np.zeros((size, size))
    for i, precision in enumerate(precisions):
        free = np.diag(precision) == 0.0
        sigma[6 * i : 6 * i + 6, 6 * i : 6 * i + 6] = np.linalg.inv(
            precision + np.diag(free / FREE)
        )
    return sigma


def dense(primitive, times):
    """Eqs. (21) and (26) as printed: (M, 6) and (M, 6, M, 6), standardised."""
    reference = primitive.reference
    config = reference.config
    kernel = np.kron(
        correlation(reference.phases, reference.phases, config.length_scale), np.eye(6)
    )
    across = np.kron(
        correlation(times, reference.phases, config.length_scale), np.eye(6)
    )
    prior = np.kron(correlation(times, times, config.length_scale), np.eye(6))
    sigma, stacked = blocks(primitive), reference.means.ravel()
    mean = across @ np.linalg.solve(
        kernel + config.mean_regularisation * sigma, stacked
    )
    count, lambda_c = len(reference.phases), config.covariance_regularisation
    inverse = np.linalg.solve(kernel + lambda_c * sigma, across.T)
    covariance = count / lambda_c * (prior - across @ inverse)
    return mean.reshape(-1, 6), covariance.reshape(len(times), 6, len(times), 6)


@pytest.fixture(scope="module")
def primitive(aligned):
    return fit_kmp(aligned)


@pytest.fixture(scope="module")
def small(aligned):
    """Few enough references for dense matrices, with both ends of the motion."""
    return fit_kmp(aligned, KMPConfig(references=70))


def shifted(primitive, phase, stds, sigma):
    """A demand ``stds`` standard deviations beside the mean."""
    here = primitive.predict(np.array([phase]))
    return ViaPoint(phase=phase, pose=here.mean[0] + stds * here.std[0], std=sigma)


@pytest.mark.parametrize("times", [GRID, np.linspace(-0.4, 1.5, 20)])
@pytest.mark.parametrize("lambda_c", [1500.0, 25.0])
def test_prediction_is_the_published_dense_formula(small, times, lambda_c):
    config = replace(small.reference.config, covariance_regularisation=lambda_c)
    some = shifted(small, 0.4321, 1.0, 1e-3)
    partly = replace(some, phase=0.77, pose=np.where(np.arange(6) % 2, np.nan, 0.1))
    primitives = []
    for movement in (small, small.adapt([some, partly])):
        entries = (
            vars(movement.reference)[n] for n in ("phases", "means", "precisions")
        )
        primitives.append(replace(movement, reference=Reference(config, *entries)))
    for primitive in primitives:
        mean, covariance = dense(primitive, times)
        predicted = primitive.predict(times)
        standardisation = primitive.regression.standardisation
        ours = standardisation.apply(predicted.mean)
        assert_allclose(ours, mean, atol=1e-6)
        scale = standardisation.scale
        for output in range(6):
            block = scale[output] ** 2 * covariance[:, output, :, output]
            tolerance = 1e-6 * block.max()
            assert_allclose(predicted.covariance[output], block, atol=tolerance)
            assert_allclose(
                predicted.std[:, output] ** 2, np.diag(block), atol=tolerance
            )


def test_a_via_point_takes_the_place_of_an_entry_at_its_phase(primitive):
    phases = primitive.reference.phases
    between = shifted(primitive, 0.5 * (phases[200] + phases[201]), 1.0, 1e-4)
    assert len(primitive.adapt([between]).reference.phases) == 401
    beside = replace(between, phase=phases[200] + 2e-4)
    assert len(primitive.adapt([beside]).reference.phases) == 400
    again = shifted(primitive, phases[200] + 1e-4, -1.0, 1e-4)
    both = primitive.adapt([beside, again])
    assert len(both.reference.phases) == 400
    here = both.predict(np.array([again.phase]))
    scale = primitive.regression.standardisation.scale
    assert (np.abs(here.mean[0] - again.pose) < 0.01 * scale).all()


def test_updates_equal_smoothing_the_whole_reference(primitive):
    points = [shifted(primitive, 0.0312 * k, 0.5, 2e-3) for k in range(1, 30)]
    points += [shifted(primitive, 0.7013, std, 0.0) for std in (1.0, 1.0, -1.0)]
    adapted = primitive.adapt(points)
    updated = adapted.reference
    entries = updated.phases, updated.means, updated.precisions
    pairs = updated.moments(GRID), Reference(updated.config, *entries).moments(GRID)
    for ours, theirs in zip(*pairs, strict=True):
        assert_allclose(ours, theirs, rtol=0.0, atol=1e-9 * np.abs(theirs).max())
