"""The basis of probabilistic dynamic movement primitives against its equation."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from gplfd_policies.movements.baselines.prodmp import ProDMPConfig, position_basis


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
