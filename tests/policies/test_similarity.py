"""Size and heading of a path are the posterior of a Gaussian process across it."""

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import AlignedDemonstrations
from gplfd_policies.demonstrations.aligned import continued
from gplfd_policies.demonstrations.path_similarity import (
    SimilarityConfig,
    SimilarityModel,
    advance,
    forecasts,
    normalised,
    posteriors,
    size_and_heading,
    size_visibility,
    updated,
)
from gplfd_policies.movements.movement import EmpiricalDistribution
from gplfd_policies.phase.phase_rule import PathPhase

TIMES = np.linspace(0.0, 1.0, 200)


def arc(radius, angles=1.2 * TIMES):
    return np.array([handle_pose_on_arc(radius, angle) for angle in angles])


def turned(poses, yaw):
    level = (poses[..., 0] - 1j * poses[..., 2]) * np.exp(1j * yaw)
    seen = poses.copy()
    seen[..., 0], seen[..., 2] = level.real, -level.imag
    return seen


@pytest.fixture(scope="module")
def aligned():
    rng = np.random.default_rng(0)
    yaws = zip((0.4, 0.5, 0.6), (-0.05, 0.02, 0.03), strict=True)
    poses = [turned(arc(radius), yaw) for radius, yaw in yaws]
    waves = np.sin(np.outer(np.pi * TIMES, [1.0, 2.0]))
    wobble = 4e-3 * np.stack([waves @ rng.normal(size=(2, 6)) for _ in poses])
    return AlignedDemonstrations(times=TIMES, poses=np.stack(poses) + wobble)


def seen(similarity, noise):
    """The estimate after half of an arc of 0.5 m, with errors of the positions [m]."""
    rng = np.random.default_rng(1)
    path = arc(0.5)[TIMES <= 0.5][:, [0, 2]]
    for x, z in path + noise * rng.normal(size=path.shape):
        if (distance := np.hypot(x, z)) >= similarity.due:
            (similarity,) = updated([similarity], [(distance, np.arctan2(-z, x))])
    return similarity


def inferred(similarity):
    """Mean and σ of the logarithm of size, heading and its σ [rad]."""
    (posterior,) = posteriors([similarity])
    size, *others = size_and_heading(posterior.weights, posterior.features)
    return np.log(size), *others


def test_demonstrations_are_brought_to_one_size_and_heading():
    sizes, yaws = np.array([0.35, 0.5, 0.62]), np.array([0.02, -0.05, 0.04])
    poses = np.stack([turned(arc(r), y) for r, y in zip(sizes, yaws, strict=True)])
    similar, log_sizes = normalised(AlignedDemonstrations(times=TIMES, poses=poses))
    assert_allclose(log_sizes, np.log(sizes) - np.log(sizes).mean(), atol=1e-12)
    # Of the mean size and heading.
    mean = turned(arc(np.exp(np.log(sizes).mean())), yaws.mean())
    assert_allclose(similar.poses[..., :3], [mean[:, :3]] * 3, atol=1e-12)


def test_posterior_and_forecast_are_those_of_a_dense_gaussian_process(aligned):
    """Of every size: evidence and moments by one big matrix instead of a filter."""
    # A deviation that counts beside the heading.
    config = SimilarityConfig(spacing=0.03, least_std=0.02, heading_std=0.02)
    model = SimilarityModel.of(aligned, config)
    distances = np.array([0.06, 0.11, 0.17, 0.22, 0.30])
    # An arc of 0.55 m, turned by 0.03 and with errors.
    angles = 0.03 + np.arcsin(distances / 1.1) + [0.01, -0.01, 0.01, 0.0, -0.01]
    similarity = model.prior()
    for distance, angle in zip(distances, angles, strict=True):
        (similarity,) = updated([similarity], [(distance, angle)])
    ahead = np.array([0.85, 0.9, 0.95, 1.0])
    path, free = np.interp(ahead, model.phases, model.path), config.scale_weight
    turning = np.interp(ahead, model.phases, model.lateral_std) / np.abs(path)

    def matern(first, second):
        step = model.rate * np.abs(np.subtract.outer(first, second))
        return (1.0 + step) * np.exp(-step)

    log_weights, means, variances = [], [], []
    for log_size in model.log_sizes:
        size = np.exp(log_size)
        shrunk = distances / size
        phase, expected, wobble = (
            np.interp(shrunk, model.outward[0], curve) for curve in model.outward[1:]
        )
        wobble = size * wobble
        across = distances * (angles - expected)
        covariance = config.heading_std**2 * np.outer(distances, distances)
        covariance += np.outer(wobble, wobble) * matern(phase, phase)
        covariance += config.position_std**2 * np.eye(5)
        surprise = across @ np.linalg.solve(covariance, across)
        log_weights.append(
            scipy.stats.multivariate_t(shape=covariance, df=free).logpdf(across)
            - 0.5 * (log_size / model.log_sizes[-1] * 2.5) ** 2
        )
        # How far the path is turned ahead: ψ + σ f/|m|, and what a sees of it.
        between = config.heading_std**2 * np.outer(np.ones(4), distances)
        between += turning[:, None] * wobble * matern(ahead, phase)
        prior = config.heading_std**2 + turning**2
        gain = np.linalg.solve(covariance, between.T).T
        angle, left = gain @ across, prior - (gain * between).sum(axis=1)
        means.append(size * path * np.exp(1j * angle))
        variances.append(left * (free + surprise) / (free + 5))
    expected = np.exp(np.array(log_weights) - max(log_weights))
    expected /= expected.sum()
    size = (expected * model.log_sizes).sum()
    std = np.sqrt((expected * (model.log_sizes - size) ** 2).sum())
    (posterior,) = posteriors([similarity])
    assert_allclose(inferred(similarity)[:2], (size, std), atol=0.04 * std)
    # The likely sizes lie between those that are compared.
    (paths,), (turns,) = forecasts([posterior], ahead)
    of_path = scipy.interpolate.CubicSpline(model.log_sizes, np.array(means))(
        posterior.log_sizes
    )
    of_turn = scipy.interpolate.CubicSpline(model.log_sizes, np.array(variances))
    assert_allclose(paths, of_path.T, atol=1e-3)
    assert_allclose(turns, of_turn(posterior.log_sizes).T, rtol=0.02)


def test_noise_that_is_smaller_than_stated_makes_the_size_better_known(aligned):
    similarity = SimilarityModel.of(aligned).prior()
    paths = rough, clean = [seen(similarity, noise) for noise in (3e-3, 2e-4)]
    assert inferred(clean)[1] < 0.8 * inferred(rough)[1]
    scale, least = (sizes.scale for sizes in posteriors(paths))
    assert (least < 0.9 * scale).all()
    # Nothing is known of the heading before, and more with every position.
    prior = inferred(similarity)[2:]
    assert prior == pytest.approx((0.0, SimilarityConfig().heading_std))
    assert inferred(rough)[3] < 0.9 * prior[1]


@pytest.mark.parametrize("count", [1, 2, 12])
def test_demonstrations_dilute_the_prior_of_the_size(count):
    poses = np.stack([arc(0.5)] * count)
    aligned = AlignedDemonstrations(times=TIMES, poses=poses)
    config = SimilarityConfig(size_std=0.3, size_weight=4.0)
    expected = 4.0 * 0.3**2 * (1.0 + 1.0 / count) / (4.0 + count - 1)
    std = SimilarityModel.of(aligned, config).log_sizes[-1] / 2.5
    assert std == pytest.approx(np.sqrt(expected))


def test_states_advance_as_their_process():
    """Two steps are one, and from nothing known nothing is learned."""
    rate, step = 7.0, np.array([0.1, 0.4])
    rng = np.random.default_rng(0)
    mean, root = rng.normal(size=(3, 2)), rng.normal(size=(3, 3, 2))
    spread = np.einsum("ijc,kjc->ikc", root, root)
    twice = advance(*advance(mean, spread, 0.3 * step, rate), 0.7 * step, rate)
    for once, both in zip(advance(mean, spread, step, rate), twice, strict=True):
        assert_allclose(once, both, atol=1e-12)
    stationary = np.repeat(np.diag([0.3, 1.0, rate**2])[:, :, None], 2, axis=2)
    assert_allclose(advance(mean, stationary, step, rate)[1], stationary, atol=1e-12)


def along_a_line(turn=0.0):
    """A leaf that slides by 1 m as slowly at both ends as a person moves it."""
    share = TIMES**3 * (10.0 - 15.0 * TIMES + 6.0 * TIMES**2)
    return np.outer(share, [0.0, 0.0, -1.0, 0.0, turn, 0.0])


def out_and_along(offset):
    """A leaf that comes out of the wall first and then slides along it by 1 m."""
    out = np.outer(1.0 - (1.0 - TIMES) ** 4, [offset, 0.0, 0.0, 0.0, 0.0, 0.0])
    return out + along_a_line()


def repeated(path, seed, sizes=(0.5, 0.5, 0.7, 0.7, 0.9, 0.9)):
    """Demonstrations of a path in several sizes, with errors as a person's."""
    rng = np.random.default_rng(seed)
    waves = np.sin(np.outer(np.pi * TIMES, np.arange(1.0, 7.0)))
    errors = np.repeat([1.5e-3, 0.02], 3)
    poses = [
        path * np.repeat([size, 1.0], 3) + errors * (waves @ rng.normal(size=(6, 6)))
        for size in sizes
    ]
    return AlignedDemonstrations(times=TIMES, poses=np.array(poses))


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("sizes", [(0.5, 0.9), (0.5, 0.5, 0.7, 0.7, 0.9, 0.9)])
def test_a_straight_path_has_no_size_and_its_phase_is_its_distance(seed, sizes):
    """Whatever chance leaves in the mean of the demonstrations."""
    aligned = repeated(along_a_line(), seed, sizes)
    model = SimilarityModel.of(aligned)
    assert not model.log_sizes.any()
    rule = PathPhase(EmpiricalDistribution(aligned=aligned))
    distances = np.linspace(0.03, 0.6, 150)
    phases, phase = [], np.float64(0.0)
    for distance in distances:
        pose = np.array([0.0, 0.0, -distance, 0.0, 0.0, 0.0])
        seen = rule.update(pose, phase, phase)
        phase = seen.phase
        phases.append(phase)
    assert seen.inferred[:2].tolist() == [1.0, 0.0]
    # The mean path's distance is an average over sizes.
    expected = np.interp(distances, np.abs(model.path), TIMES)
    assert np.abs(phases - expected)[10:].max() < 0.03


@pytest.mark.parametrize("count", [1, 2, 6])
@pytest.mark.parametrize(
    "path",
    [arc(1.0), along_a_line(turn=1.2), out_and_along(0.1)],
    ids=["circle", "straight, turning", "out, then along"],
)
def test_size_shows_where_a_path_bends_or_turns_by_its_length(path, count):
    poses = normalised(repeated(path, 0, count * (0.5,)))[0].poses
    assert size_visibility(poses) == 1.0


def test_a_straight_continuation_hides_no_size():
    aligned = continued(repeated(out_and_along(0.06), 0, 6 * (0.5,)), 0.5)
    # The prior of `test_demonstrations_dilute_the_prior_of_the_size`.
    expected = np.sqrt(12.0 * 0.35**2 * (1.0 + 1.0 / 6.0) / (12.0 + 5.0))
    std = SimilarityModel.of(aligned).log_sizes[-1] / 2.5
    assert std == pytest.approx(expected, rel=0.01)


@pytest.mark.parametrize("deviations", [0.0, 0.5, 1.0, 1.25, 1.75, 2.0, 9.0])
def test_size_shows_by_the_bend_in_deviations_less_one(deviations):
    """In any direction of path and bend; by the deviation of one repetition."""
    bend = TIMES - TIMES**2 * (TIMES**3).sum() / (TIMES**4).sum()
    bend /= np.sqrt((bend**2).mean())
    # Orthogonal along the path, so that the straight line is the first axis.
    axes = np.linalg.qr(np.random.default_rng(1).normal(size=(3, 3)))[0]
    spread, n = 4e-3, SimilarityConfig().position_std
    path = np.outer(TIMES**2, axes[0])
    path = path + np.outer(deviations * np.hypot(spread, n) * bend, axes[1])
    # Two repetitions, √2 σ apart.
    apart = np.sqrt(0.5) * spread * axes[2]
    poses = np.zeros((2, TIMES.size, 6))
    poses[..., :3] = path + np.array([-1.0, 1.0])[:, None, None] * apart
    expected = min(max(deviations - 1.0, 0.0), 1.0)
    assert size_visibility(poses) == pytest.approx(expected, abs=1e-9)
