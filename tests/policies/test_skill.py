"""Skills: six heteroscedastic outputs learned from aligned demonstrations."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import t as student

from gplfd_policies import AlignedDemonstrations, ViaPoint, fit_skill
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.heteroscedastic import KerstingNoise
from gplfd_policies.movements.skill import SIZE_STD

pytestmark = pytest.mark.slow

TIMES = np.linspace(0.0, 1.0, 60)
SPREAD = 0.01 + 0.05 * TIMES**2


def independent_noise(count, rng):
    curve = np.stack([np.sin(2.0 * TIMES + k) for k in range(6)], axis=1)
    return curve + SPREAD[:, None] * rng.normal(size=(count, len(TIMES), 6))


def arcs(radii, rng):
    angle = 1.2 * TIMES
    poses = np.zeros((len(radii), len(TIMES), 6))
    for index, radius in enumerate(radii):
        pose = poses[index]
        pose[:, 0], pose[:, 4] = radius * np.sin(angle), angle
        pose[:, 2] = radius * (np.cos(angle) - 1.0)
        poses[index] += 0.002 * np.sin(
            np.multiply.outer(3.0 * TIMES, rng.normal(size=6))
        )
    return poses


def aligned(poses):
    return AlignedDemonstrations(times=TIMES, poses=poses, duration=4.0)


@pytest.fixture(scope="module")
def skill():
    return fit_skill(aligned(independent_noise(6, np.random.default_rng(0))))


def test_prediction_is_equations_10_and_11(skill):
    """Against the naive process on all D·M observations of one output."""
    poses, output = skill.aligned.poses, 2
    fitted = skill.processes.outputs[output]
    noise = fitted.noise.variance(TIMES)
    full = ExactGP(
        kernel=fitted.kernel,
        times=np.tile(TIMES, 6),
        values=((poses[:, :, output] - fitted.offset) / fitted.scale).ravel(),
        noise_variance=np.tile(noise, 6),
    )
    grid = np.linspace(0.0, 1.0, 23)
    predicted = skill.predict(grid)
    mean = fitted.offset + fitted.scale * full.mean(grid)
    assert_allclose(predicted.mean[:, output], mean, atol=1e-10)
    spread = fitted.noise.variance(grid)
    latent = np.maximum(full.variance(grid), skill.smoothness * spread / 6.0)
    std = fitted.scale * np.sqrt(latent + spread)
    assert_allclose(predicted.std[:, output], std, rtol=1e-9)


def test_uncertainty_of_the_mean_is_at_least_its_share_of_the_spread(skill):
    """Where deviations are smooth, which are told from independent ones."""
    smooth = fit_skill(aligned(arcs([0.3, 0.4, 0.5, 0.6], np.random.default_rng(0))))
    assert skill.smoothness < 0.1 < 0.95 < smooth.smoothness
    moments = smooth.processes.moments(TIMES)
    variance = smooth.predict(TIMES).std ** 2
    share = smooth.smoothness / 4.0
    assert (variance >= moments.noise * (1.0 + share) * (1.0 - 1e-12)).all()
    # The model's own value would be far below.
    assert np.median(moments.latent / moments.noise) < 0.5 * share


@pytest.mark.parametrize("correlation", [0.0, 0.6, 0.9, 0.99])
def test_degrees_of_freedom_count_independent_looks(correlation):
    """The variance of an empirical variance tells how many looks it had."""
    rng = np.random.default_rng(0)
    window, repetitions = 20, 4000
    noise = np.empty((window, repetitions))
    noise[0] = rng.normal(size=repetitions)
    for row in range(1, window):
        fresh = np.sqrt(1.0 - correlation**2) * rng.normal(size=repetitions)
        noise[row] = correlation * noise[row - 1] + fresh
    looks = 2.0 / np.var(np.mean(noise**2, axis=0))
    squared = correlation**2
    counted = max(window * (1.0 - squared) / (1.0 + squared), 1.0)
    assert counted == pytest.approx(looks, rel=0.35)


def test_inside_and_outside_agree_at_the_ends(skill):
    inside = skill.predict(np.array([0.0, 1.0]))
    outside = skill.predict(np.array([-1e-9, 1.0 + 1e-9]))
    assert_allclose(inside.mean, outside.mean, atol=1e-7)
    assert_allclose(inside.std, outside.std, atol=1e-7)


def test_covariance_stretches_that_of_the_mean(skill):
    """The floor r/D on the variance of the mean scales it; correlations stay."""
    predicted, moments = skill.predict(TIMES), skill.processes.moments(TIMES)
    latent = skill.processes.latent_covariance(TIMES)
    for output in range(6):
        of_mean = predicted.covariance[output] - np.diag(moments.noise[:, output])
        assert_allclose(
            of_mean / np.sqrt(np.outer(np.diag(of_mean), np.diag(of_mean))),
            latent[output]
            / np.sqrt(np.outer(np.diag(latent[output]), np.diag(latent[output]))),
            atol=1e-8,
        )


@pytest.mark.bits
def test_spectral_and_dense_moments_agree(skill):
    """The fast form inside against the dense processes of every output."""
    grid = np.linspace(0.0, 1.0, 41)
    fast = skill.processes.moments(grid)
    for output, fitted in enumerate(skill.processes.outputs):
        scale = fitted.scale
        mean_rate, var_rate = fitted.latent.rates(grid)
        mean = fitted.offset + scale * fitted.latent.mean(grid)
        variance = scale**2 * fitted.latent.variance(grid)
        assert_allclose(fast.mean[:, output], mean, atol=1e-8)
        # Dense, a variance is what is left of the prior's after a subtraction: BLAS
        # kernels differ by up to 3e-11 of it.
        prior = scale**2 * fitted.kernel.signal_std**2
        assert_allclose(fast.latent[:, output], variance, atol=1e-10 * prior)
        # Slopes magnify the rounding of 48 coefficients: kernels differ by 1.3e-6.
        assert_allclose(fast.mean_rate[:, output], scale * mean_rate, atol=1e-5)
        assert_allclose(fast.latent_rate[:, output], scale**2 * var_rate, atol=1e-8)


def test_intervals_use_student_t_with_the_looks_at_the_spread(skill):
    level = 0.9
    smooth = fit_skill(aligned(arcs([0.3, 0.4, 0.5, 0.6], np.random.default_rng(0))))
    assert smooth.degrees_of_freedom == pytest.approx(3.0)
    assert skill.degrees_of_freedom > 25.0
    for fitted in (smooth, skill):
        predicted = fitted.predict(TIMES)
        low, high = predicted.interval(level)
        width = student.ppf(0.95, fitted.degrees_of_freedom)
        assert_allclose(high - low, 2.0 * width * predicted.std, rtol=1e-9)


@pytest.mark.parametrize(
    "noise", ["map", "homoscedastic", KerstingNoise(n_iterations=1)]
)
def test_one_demonstration_leaves_the_size_open(noise):
    """Beyond its scatter, the next may be larger by γ of its displacement."""
    poses = independent_noise(1, np.random.default_rng(0)) + 4.0 * TIMES[:, None]
    with pytest.warns(UserWarning, match="assumed to be larger or smaller by 25%"):
        skill = fit_skill(aligned(poses), noise=noise)
    predicted, scatter = skill.predict(TIMES), skill.processes.moments(TIMES)
    rest = predicted.std**2 - (SIZE_STD * (scatter.mean - scatter.mean[0])) ** 2
    least = scatter.noise + np.maximum(scatter.latent, skill.smoothness * scatter.noise)
    assert_allclose(rest, least, atol=1e-9)
    assert predicted.degrees_of_freedom is None
    diagonal = np.diagonal(predicted.covariance, axis1=1, axis2=2).T
    assert_allclose(np.sqrt(diagonal), predicted.std)
    step = 1e-6
    up, down = (skill.predict(TIMES[5:-5] + h).std for h in (step, -step))
    rate = (up - down) / (2.0 * step)
    assert_allclose(predicted.std_rate[5:-5], rate, rtol=1e-4, atol=1e-5)


def test_via_point_frees_outputs_by_nan_or_infinite_noise():
    pose = np.array([0.1, np.nan, 0.0, 0.0, 0.0, 0.0])
    point = ViaPoint(phase=0.5, pose=pose, std=np.array([1.0, 1, np.inf, 0, 2, 3]))
    expected = [1.0, np.inf, np.inf, 0.0, 4.0, 9.0]
    assert_array_equal(point.noise_variance, expected)
    assert_array_equal(
        ViaPoint(phase=0.5, pose=np.zeros(6), std=0.1).noise_variance, 0.1**2
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (
            {"phase": np.nan, "pose": np.zeros(6)},
            "phase of a via-point must be a finite",
        ),
        ({"phase": 0.1, "pose": np.zeros(6), "std": np.ones(3)}, "std must be one .*3"),
        ({"phase": 0.1, "pose": np.zeros(6), "along": np.ones((1, 6))}, "along must"),
        ({"phase": 0.1, "pose": np.full(6, np.inf)}, "six finite entries"),
        ({"phase": 0.1, "pose": np.zeros(6), "std": -1.0}, "must be >= 0"),
    ],
)
def test_impossible_via_points_are_refused(arguments, message):
    with pytest.raises(ValueError, match=message):
        ViaPoint(**arguments)
