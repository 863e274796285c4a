"""Kernels, exact regression and factorisation: Eqs. (1)-(7), (13), (14)."""

import numpy as np
import pytest
from numpy.testing import assert_allclose
from sklearn.gaussian_process import GaussianProcessRegressor
from sklearn.gaussian_process.kernels import RBF as SklearnRBF
from sklearn.gaussian_process.kernels import ConstantKernel

from gplfd_policies.gp.exact import ExactGP, factorise
from gplfd_policies.gp.kernels import RBF

KERNEL = RBF(length_scale=0.2, signal_std=1.3)


def observations(count=25):
    rng = np.random.default_rng(3)
    times = np.sort(rng.uniform(0.0, 1.0, count))
    noise = np.exp(rng.normal(-4.0, 0.5, count))
    return times, np.sin(5.0 * times) + np.sqrt(noise) * rng.normal(size=count), noise


def posterior(kernel=KERNEL, log_noise_step=None):
    times, values, noise = observations()
    if log_noise_step is not None:
        noise = noise * np.exp(log_noise_step)
    return ExactGP(kernel=kernel, times=times, values=values, noise_variance=noise)


def test_printed_multi_output_kernel_is_not_a_covariance():
    times = np.linspace(0.0, 1.0, 8)
    printed = np.exp(np.subtract.outer(times, times) ** 2 / 0.3**2)
    ours = RBF(length_scale=0.3, signal_std=1.0)(times, times)
    assert np.linalg.eigvalsh(printed)[0] < -1.0
    assert np.linalg.eigvalsh(ours)[0] > 0.0


def test_kernel_derivatives_equal_finite_differences():
    a, b, step = np.linspace(0.0, 1.0, 4), np.linspace(-0.5, 1.0, 5), 1e-6
    slope = (KERNEL(a + step, b) - KERNEL(a - step, b)) / (2.0 * step)
    assert_allclose(KERNEL.time_derivative(a, b), slope, atol=1e-8)
    for index, name in enumerate(("length_scale", "signal_std")):
        values = {"length_scale": 0.2, "signal_std": 1.3}
        shifted = []
        for sign in (1.0, -1.0):
            moved = values | {name: values[name] * np.exp(sign * step)}
            shifted.append(RBF(**moved)(a, b))
        numeric = (shifted[0] - shifted[1]) / (2.0 * step)
        assert_allclose(KERNEL.log_gradients(a, b)[index], numeric, atol=1e-8)


def test_posterior_equals_scikit_learn():
    """With the kernel of Eq. (13), with the half; and without jitter."""
    times, values, noise = observations()
    kernel = ConstantKernel(1.3**2, "fixed") * SklearnRBF(0.2, "fixed")
    theirs = GaussianProcessRegressor(kernel, alpha=noise, optimizer=None)
    theirs.fit(times[:, None], values)
    grid = np.linspace(-0.3, 1.3, 40)
    mean, covariance = theirs.predict(grid[:, None], return_cov=True)
    ours = posterior()
    assert_allclose(ours.mean(grid), mean, atol=1e-10)
    assert_allclose(ours.covariance(grid), covariance, atol=1e-10)
    assert_allclose(ours.variance(grid), np.diag(covariance), atol=1e-10)
    assert ours.log_marginal_likelihood() == pytest.approx(
        theirs.log_marginal_likelihood_value_, rel=1e-10
    )
    assert ours.factor.jitter == 0.0


def test_likelihood_gradient_equals_finite_differences():
    step = 1e-5
    kernel_part, noise_part = posterior().likelihood_gradient()

    def moved(length, signal):
        kernel = RBF(length_scale=0.2 * np.exp(length), signal_std=1.3 * np.exp(signal))
        return posterior(kernel).log_marginal_likelihood()

    numeric = [
        (moved(step, 0.0) - moved(-step, 0.0)) / (2.0 * step),
        (moved(0.0, step) - moved(0.0, -step)) / (2.0 * step),
    ]
    assert_allclose(kernel_part, numeric, rtol=1e-6)
    for index in (0, 7, 24):
        shift = np.zeros(25)
        shift[index] = step
        up = posterior(log_noise_step=shift).log_marginal_likelihood()
        down = posterior(log_noise_step=-shift).log_marginal_likelihood()
        assert noise_part[index] == pytest.approx((up - down) / (2.0 * step), rel=1e-5)


def test_posterior_rates_equal_finite_differences():
    grid, step, fitted = np.linspace(-0.2, 1.2, 30), 1e-6, posterior()
    mean_rate, variance_rate = fitted.rates(grid)
    up, down = grid + step, grid - step
    assert_allclose(
        mean_rate, (fitted.mean(up) - fitted.mean(down)) / (2.0 * step), atol=1e-6
    )
    numeric = (fitted.variance(up) - fitted.variance(down)) / (2.0 * step)
    assert_allclose(variance_rate, numeric, atol=1e-6)


def test_least_jitter_on_failure_is_reported():
    singular = np.ones((4, 4)) - 1e-14 * np.eye(4)
    factor = factorise(singular)
    assert 0.0 < factor.jitter <= 1e-12
    rebuilt = factor.lower @ factor.lower.T
    assert_allclose(rebuilt, singular + factor.jitter * np.eye(4), atol=1e-15)


ONE = np.ones(1)
REFUSED = {
    "not positive definite.*smallest eigen": lambda: factorise(np.diag([1.0, -0.5])),
    "must be finite": lambda: factorise(np.array([[np.nan]])),
    "finite and >= 0": lambda: ExactGP(
        kernel=KERNEL, times=ONE, values=ONE, noise_variance=-ONE
    ),
    "length_scale must be positive and finite": lambda: RBF(
        length_scale=0.0, signal_std=1.0
    ),
}


@pytest.mark.parametrize("message", REFUSED)
def test_impossible_processes_are_refused(message):
    with pytest.raises(ValueError, match=message):
        REFUSED[message]()
