"""Kernelized movement primitives against the published formulas, and their limits."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_policies import ViaPoint
from gplfd_policies.movements.baselines.kmp import KMPConfig, Reference, fit_kmp

GRID = np.linspace(0.0, 1.0, 41)
RATE = np.array([0.3, np.nan, -2.0, 0.0, 3.0, np.nan])
"""A demanded rate, standardised; NaN is free."""
FREE = 1e9
"""Variance of a free output in the dense formulas, standardised."""


def kernel(a, b, length_scale):
    """k(t, t') and its derivatives, (12 A, 12 B): pose, then rate of each phase."""
    apart = np.subtract.outer(a, b) / length_scale
    slope, bend = apart / length_scale, (1.0 - apart**2) / length_scale**2
    blocks = np.array([[np.ones_like(apart), slope], [-slope, bend]])
    blocks = (blocks * np.exp(-0.5 * apart**2)).transpose(2, 0, 3, 1)
    return np.kron(blocks.reshape(2 * len(a), -1), np.eye(6))


def blocks(primitive):
    """Σ = blockdiag(Σ_i)."""
    precisions = primitive.reference.precisions
    size = 12 * len(precisions)
    sigma = np.zeros((size, size))
    for i, precision in enumerate(precisions):
        free = np.diag(precision) == 0.0
        own = slice(12 * i, 12 * i + 12)
        sigma[own, own] = np.linalg.inv(precision + np.diag(free / FREE))
    return sigma


def dense(primitive, times):
    """Eqs. (21) and (26) as printed: (M, 12) and (M, 12, M, 12), standardised."""
    reference = primitive.reference
    config, phases = reference.config, reference.phases
    gram = kernel(phases, phases, config.length_scale)
    across = kernel(times, phases, config.length_scale)
    prior = kernel(times, times, config.length_scale)
    sigma, stacked = blocks(primitive), reference.means.ravel()
    mean = across @ np.linalg.solve(gram + config.mean_regularisation * sigma, stacked)
    count, lambda_c = len(reference.phases), config.covariance_regularisation
    inverse = np.linalg.solve(gram + lambda_c * sigma, across.T)
    covariance = count / lambda_c * (prior - across @ inverse)
    return mean.reshape(-1, 12), covariance.reshape(len(times), 12, len(times), 12)


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


@pytest.mark.parametrize("rows", ["features", "rates"])
@pytest.mark.parametrize("columns", ["features", "rates"])
def test_features_give_the_kernel_and_its_differences(small, rows, columns):
    """The authors' kernel, with central instead of forward differences."""
    reference, step = small.reference, 1e-4
    scale = reference.config.length_scale
    steps = {
        "features": [(0.0, 1.0)],
        "rates": [(step, 0.5 / step), (-step, -0.5 / step)],
    }
    expected = sum(
        by * to * kernel(GRID + up, GRID + right, scale)[::12, ::12]
        for up, by in steps[rows]
        for right, to in steps[columns]
    )
    ours = getattr(reference, rows)(GRID) @ getattr(reference, columns)(GRID).T
    assert_allclose(ours, expected, atol=1e-5 * np.abs(expected).max())


@pytest.mark.parametrize("times", [GRID, np.linspace(-0.4, 1.5, 20)])
@pytest.mark.parametrize("lambda_c", [1500.0, 25.0])
def test_prediction_is_the_published_dense_formula(small, times, lambda_c):
    config = replace(small.reference.config, covariance_regularisation=lambda_c)
    some = shifted(small, 0.4321, 1.0, 1e-3)
    partly = replace(some, phase=0.77, pose=np.where(np.arange(6) % 2, np.nan, 0.1))
    primitives = []
    rate = RATE * small.standardisation.scale
    for movement in (small, small.adapt([some, partly], [rate])):
        entries = (
            vars(movement.reference)[n] for n in ("phases", "means", "precisions")
        )
        primitives.append(replace(movement, reference=Reference(config, *entries)))
    for primitive in primitives:
        mean, covariance = dense(primitive, times)
        predicted = primitive.predict(times)
        standardisation = primitive.standardisation
        ours = standardisation.apply(predicted.mean)
        assert_allclose(ours, mean[:, :6], atol=1e-6)
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
    scale = primitive.standardisation.scale
    assert (np.abs(here.mean[0] - again.pose) < 0.02 * scale).all()


def test_the_mean_passes_a_via_point_with_the_demanded_rate(primitive):
    """Wherever it is: between references, at one, and at both ends."""
    scale = primitive.standardisation.scale
    for phase in (0.4321, primitive.reference.phases[200], 0.0, 1.0):
        point = shifted(primitive, phase, 1.0, 0.0)
        adapted = primitive.adapt([point], [RATE * scale])
        here = adapted.predict(phase + np.array([-1e-4, 0.0, 1e-4]))
        assert (np.abs(here.mean[1] - point.pose) < 1e-3 * scale).all()
        assert np.nanmax(np.abs(here.mean_rate[1] / scale - RATE)) < 1e-3
        free = primitive.adapt([point]).predict(here.times).mean_rate[1] / scale
        assert np.nanmin(np.abs(free - RATE)) > 0.1


@pytest.mark.parametrize(("rate", "tolerance"), [(np.nan, 1e-9), (RATE, 2e-5)])
def test_updates_equal_smoothing_the_whole_reference(primitive, rate, tolerance):
    """A demanded rate has no tolerance, and leaves more rounding."""
    points = [shifted(primitive, 0.0312 * k, 0.5, 2e-3) for k in range(1, 29)]
    rates = [rate * primitive.standardisation.scale] * len(points)
    updated = primitive.adapt(points, rates).reference
    entries = updated.phases, updated.means, updated.precisions
    pairs = updated.moments(GRID), Reference(updated.config, *entries).moments(GRID)
    for ours, theirs in zip(*pairs, strict=True):
        assert_allclose(ours, theirs, rtol=0.0, atol=tolerance * np.abs(theirs).max())
