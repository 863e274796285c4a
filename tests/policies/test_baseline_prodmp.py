"""Probabilistic dynamic movement primitives: the equation, its start, conditioning."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from gplfd_policies import ViaPoint
from gplfd_policies.movements.baselines.prodmp import (
    ProDMPConfig,
    fit_prodmp,
    position_basis,
)

GRID = np.linspace(0.0, 1.0, 101)


@pytest.fixture(scope="module")
def prodmp(aligned):
    return fit_prodmp(aligned)


@pytest.mark.parametrize("config", [ProDMPConfig(), ProDMPConfig(alpha=60.0)])
def test_basis_functions_solve_the_published_equation(config):
    """Integrated for every weight, the goal and both boundary conditions."""
    centres = np.exp(-config.alpha_x * np.linspace(0.0, 1.0, config.n_basis))
    spacing = np.append(np.diff(centres), centres[-1] - centres[-2])
    gain = 0.25 * config.alpha**2

    def rates(z, state):
        x = np.exp(-config.alpha_x * z)
        psi = config.overlap ** (((x - centres) / spacing) ** 2)
        drive = np.append(x * psi / psi.sum(), [gain, 0.0, 0.0])
        y, rate = state.reshape(2, -1)
        return np.append(rate, drive - config.alpha * rate - gain * y)

    start = np.zeros((2, config.n_basis + 3))
    start[0, -2] = start[1, -1] = 1.0
    clock = np.linspace(0.0, 3.0, 3001)
    solved = scipy.integrate.solve_ivp(
        rates, (0.0, 3.0), start.ravel(), "DOP853", clock, rtol=1e-10, atol=1e-13
    )
    values, slopes = solved.y.reshape(2, -1, clock.size)
    # Responses have a maximum of 1 within the task.
    scale = values[:, clock <= 1.0].max(axis=1, keepdims=True)
    scale[-2:] = 1.0
    basis = position_basis(config)
    assert_allclose(basis(clock), (values / scale).T, atol=1e-6)
    slopes /= scale
    assert_allclose(basis(clock, 1), slopes.T, atol=1e-6 * np.abs(slopes).max())


@pytest.mark.parametrize("along", [0.0, 0.02])
def test_conditioning_equals_that_of_a_joint_gaussian(prodmp, aligned, along):
    """Of all outputs at all phases, with the covariance that the weights give them."""
    phases = np.append(GRID, [0.3, 0.8])
    basis, _ = prodmp.basis(phases)
    matrix = np.kron(np.eye(6), basis)
    joint = matrix @ prodmp.weight_covariance @ matrix.T
    mean = matrix @ prodmp.weight_mean
    seen = np.array([d * phases.size + v for v in (101, 102) for d in range(6)])
    points = [
        ViaPoint(phase=phase, pose=aligned.poses[1, row], std=2e-3, along=along)
        for phase, row in ((0.3, 60), (0.8, 160))
    ]
    noise = 4e-6 * np.eye(12) + along**2 * np.kron(np.eye(2), np.ones((6, 6)))
    gain = joint[:, seen] @ np.linalg.inv(joint[np.ix_(seen, seen)] + noise)
    missed = np.concatenate([point.pose for point in points]) - mean[seen]
    expected = (mean + gain @ missed).reshape(6, -1)[:, :-2].T
    variance = np.diag(joint - gain @ joint[seen]).reshape(6, -1)[:, :-2].T
    adapted = prodmp.adapt(points).predict(GRID)
    assert_allclose(adapted.mean, expected, atol=1e-8)
    assert_allclose(adapted.std**2, variance + prodmp.noise_variance, atol=1e-9)
