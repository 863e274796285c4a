"""The contract of every learned movement, whatever method learned it."""

import itertools
import pickle
from dataclasses import replace
from functools import cache, partial

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import PosePath, ViaPoint, align, fit_skill
from gplfd_policies.adaptation import OwnAdaptation
from gplfd_policies.movements.baselines.dmp import DMPConfig, fit_dmp
from gplfd_policies.movements.baselines.gmm_gp import fit_gmm_gp
from gplfd_policies.movements.baselines.gmr import GMRConfig, fit_gmr
from gplfd_policies.movements.baselines.kmp import fit_kmp
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig, fit_local_gp
from gplfd_policies.movements.baselines.prodmp import fit_prodmp
from gplfd_policies.movements.baselines.promp import ProMPConfig, fit_promp
from gplfd_policies.movements.baselines.tp_gmm import fit_tp_gmm
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import Adaptable, EmpiricalDistribution, Movement
from gplfd_policies.movements.prior_mean import fit_residual

pytestmark = pytest.mark.slow

GRID = np.linspace(0.0, 1.0, 31)
ARRAYS = ("times", "mean", "std", "mean_rate", "std_rate", "covariance")
SHORT_CHAIN = WishartGPConfig(steps=40, discarded=10, times=20)
LINE = PosePath(phases=np.array([0.0, 1.0]), poses=np.outer([0.1, 0.5], np.arange(6.0)))


FITS = {
    "gp": fit_skill,
    "gp around a prior mean": lambda aligned: fit_residual(
        aligned, LINE, partial(fit_skill, centred=False)
    ),
    "dmp": fit_dmp,
    "dmp with a spread": partial(fit_dmp, config=DMPConfig(spread=True)),
    "promp": fit_promp,
    "gmr": fit_gmr,
    "tp-gmm": fit_tp_gmm,
    "local-gp": partial(fit_local_gp, config=LocalGPConfig(clusters=4)),
    "wishart-gp": partial(fit_wishart_gp, config=SHORT_CHAIN, seed=0),
    "kmp": fit_kmp,
    "gmm-gp": fit_gmm_gp,
    "prodmp": fit_prodmp,
}
ADAPTABLE = ("promp", "tp-gmm", "kmp", "gmm-gp", "prodmp")
"""Movements with a method ``adapt``; a skill is adapted by `gplfd_policies.adapt`."""
SCALED = [name for name in FITS if name not in ("tp-gmm", "gp around a prior mean")]
DIFFERENCES = ("gmr", "tp-gmm", "local-gp", "wishart-gp", "kmp", "gmm-gp")
"""Movements whose rates are differences of their moments."""
ANALYTIC = [name for name in FITS if name not in (*DIFFERENCES, "dmp with a spread")]


@pytest.fixture(scope="module")
def aligned(demonstrations):
    return align(demonstrations, n_samples=60)


@pytest.fixture(scope="module")
def learned(aligned):
    """Every method's movement, learned once."""
    return cache(lambda name: FITS[name](aligned))


def same_bits(first, second):
    return all(
        getattr(first, name).tobytes() == getattr(second, name).tobytes()
        for name in ARRAYS
    )


def demonstrated(aligned, place, row=0, std=1e-3):
    """A pose of one of the demonstrations."""
    return ViaPoint(phase=aligned.times[place], pose=aligned.poses[row, place], std=std)


@pytest.mark.parametrize("name", FITS)
def test_it_has_the_interface_and_says_what_it_was_learned_from(name, learned, aligned):
    movement = learned(name)
    assert isinstance(movement, Movement)
    assert isinstance(movement, Adaptable) == (name in ADAPTABLE)
    assert movement.aligned is aligned
    assert movement.duration == aligned.duration
    text = f"{type(movement).__name__}(6 demonstrations, 60 phases, "
    assert repr(movement) == f"{text}{aligned.duration:.3g} s)"


@pytest.mark.parametrize("name", FITS)
def test_predictions_have_their_shapes_and_a_covariance_of_their_variances(
    name, learned
):
    predicted = learned(name).predict(GRID)
    assert_array_equal(predicted.times, GRID)
    assert np.isfinite(predicted.mean).all()
    for curve in ARRAYS[1:5]:
        assert getattr(predicted, curve).shape == (31, 6)
    assert predicted.covariance.shape == (6, 31, 31)
    if name == "dmp":
        assert np.isnan(predicted.std).all()
        assert np.isnan(predicted.covariance).all()
        return
    variance = np.diagonal(predicted.covariance, axis1=1, axis2=2).T
    assert_allclose(variance, predicted.std**2, rtol=1e-5, atol=1e-12)
    for covariance in predicted.covariance:
        assert_allclose(covariance, covariance.T, atol=1e-9 * covariance.max())
        assert np.linalg.eigvalsh(covariance)[0] > -1e-9 * covariance.max()


@pytest.mark.parametrize("name", ANALYTIC)
def test_rates_are_the_derivatives_of_mean_and_spread(name, learned, aligned):
    """Also outside the demonstrations, and after a via-point."""
    movement, step = learned(name), 1e-5
    times = np.append(np.linspace(0.013, 0.987, 37), [-0.27, -0.1, 1.1, 1.27])
    movements = [movement]
    if name in ADAPTABLE:
        movements.append(movement.adapt([demonstrated(aligned, 24)]))
    for adapted in movements:
        here, up, down = (adapted.predict(times + by) for by in (0.0, step, -step))
        for curve in ("mean", "std"):
            slope = (getattr(up, curve) - getattr(down, curve)) / (2.0 * step)
            assert_allclose(getattr(here, f"{curve}_rate"), slope, atol=1e-5, rtol=1e-4)


@pytest.mark.parametrize("name", FITS)
def test_a_pickled_copy_predicts_and_adapts_with_the_same_bits(name, learned, aligned):
    movement = learned(name)
    copy, predicted = pickle.loads(pickle.dumps(movement)), movement.predict(GRID)
    assert same_bits(copy.predict(GRID), predicted)
    assert same_bits(pickle.loads(pickle.dumps(predicted)), predicted)
    if name in ADAPTABLE:
        points = [demonstrated(aligned, 20)]
        adapted = movement.adapt(points)
        expected = adapted.predict(GRID)
        assert same_bits(copy.adapt(points).predict(GRID), expected)
        assert same_bits(pickle.loads(pickle.dumps(adapted)).predict(GRID), expected)


@pytest.mark.usefixtures("as_for_users")  # Types were checked above.
@pytest.mark.parametrize("name", SCALED)
def test_units_do_not_matter(name, learned, aligned):
    """Powers of two are exact, so that every search takes the same decisions."""
    powers = [10.0, -3.0, 4.0, 5.0, -1.0, 2.0]
    if name.startswith("dmp"):
        powers = [10.0, 10.0, 10.0, 0.0, 0.0, 0.0]  # rotations are no numbers here
    factor = 2.0 ** np.array(powers)
    size = aligned.poses.std(axis=(0, 1))
    ours = learned(name)
    theirs = FITS[name](replace(aligned, poses=factor * aligned.poses))
    predicted = [(ours.predict(GRID), theirs.predict(GRID))]
    if name in ADAPTABLE:
        here = demonstrated(aligned, 24)
        scaled = replace(here, pose=factor * here.pose, std=factor * here.std)
        adapted = ours.adapt([here]), theirs.adapt([scaled])
        predicted.append(tuple(part.predict(GRID) for part in adapted))
    for plain, other in predicted:
        assert_allclose((other.mean / factor - plain.mean) / size, 0.0, atol=1e-6)
        assert_allclose(other.std / factor, plain.std, rtol=1e-6)


@pytest.mark.parametrize("times", [[], [0.1, np.nan]])
@pytest.mark.parametrize("name", FITS)
def test_times_that_are_none_are_refused(name, learned, times):
    with pytest.raises(ValueError, match="finite phases, at least one"):
        learned(name).predict(np.array(times, dtype=np.float64))


@pytest.mark.filterwarnings("ignore:One demonstration")
@pytest.mark.parametrize("name", ADAPTABLE)
def test_via_points_are_obeyed(name, learned, aligned):
    """A demonstrated pose is met; only `tp-gmm` turns it into a hinge, and comes near.

    The movement itself stays as it was.
    """
    movement, point = learned(name), demonstrated(aligned, 45, std=1e-5)
    phase = np.array([point.phase])
    before = movement.predict(phase)
    after = movement.adapt([point]).predict(phase)
    missed, met = (np.abs(poses.mean[0] - point.pose) for poses in (before, after))
    if name == "tp-gmm":
        assert met[[0, 2]].max() < 0.5 * missed[[0, 2]].max()
    else:
        assert (met < 2e-3).all()
        assert met.max() < 0.05 * missed.max()
    assert same_bits(movement.predict(phase), before)
    alone = FITS[name](replace(aligned, poses=aligned.poses[:1], clocks=None))
    assert np.isfinite(alone.adapt([point]).predict(phase).mean).all()


@pytest.mark.parametrize("name", ["kmp", "tp-gmm"])
def test_via_points_may_come_in_any_order_and_grouping(name, learned, aligned):
    """The others condition exactly; here contradicting ones have an answer, too."""
    movement = learned(name)
    points = [demonstrated(aligned, place, std=2e-3) for place in (12, 25, 40)]
    together = movement.adapt(points).predict(GRID)
    for other in (
        movement.adapt(points[::-1]),
        movement.adapt(points[:1]).adapt(points[1:]),
    ):
        assert_allclose(other.predict(GRID).mean, together.mean, atol=1e-8)
    both = [demonstrated(aligned, 40, row, std=0.0) for row in (0, 5)]
    assert np.isfinite(movement.adapt(both).predict(GRID).mean).all()


def prior(name, movement, times):
    """Mean (T, 6) and covariance (6 T, 6 T) of all outputs, without white noise."""
    if name in ("promp", "prodmp"):
        design = np.kron(movement.basis(times)[0][:, None], np.eye(6)[:, :, None])
        design = design.reshape(6 * times.size, -1)
        mean = (design @ movement.weight_mean).reshape(-1, 6)
        return mean, design @ movement.weight_covariance @ design.T
    places = (movement.kernel if name == "gmm-gp" else movement).places(times)
    mean, covariance = places[1], movement.seen.covariance(places, places)
    if name == "gmm-gp":
        scale = movement.regression.standardisation.scale
        covariance = scale[:, None, None] * covariance * scale
        mean, _ = movement.regression.moments(times)
    return mean, covariance.reshape(6 * times.size, -1)


@pytest.mark.parametrize(("strict", "tolerance"), [(False, 1e-9), (True, 1e-6)])
@pytest.mark.parametrize("name", ["promp", "prodmp", "gmm-gp"])
def test_adapting_online_is_conditioning_on_all_at_once(
    name, strict, tolerance, learned, aligned
):
    """Also on repeated and contradicting demands of no tolerance.

    There the innovations have a condition number of 1e8.
    """
    movement = learned(name)
    online, along = OwnAdaptation(movement, GRID), 0.01 * np.arange(-2.0, 4.0)
    points = [demonstrated(aligned, place, 1, 2e-3) for place in range(3, 48, 3)]
    points = [replace(point, along=along) for point in points]
    for number in range(0, len(points), 3):  # Some leave outputs free.
        pose = points[number].pose.copy()
        pose[[1, 4]] = np.nan
        points[number] = replace(points[number], pose=pose)
    if strict:
        points += [demonstrated(aligned, 40, row, 0.0) for row in (0, 0, 5)]
    least = (1e-4 * aligned.poses.std(axis=(0, 1))) ** 2
    for point in points:
        online.observe(point)
    mean, joint = prior(name, movement, np.append([p.phase for p in points], GRID))
    size = 6 * len(points)
    noise = np.ravel([np.maximum(point.own_variance, least) for point in points])
    shared = scipy.linalg.block_diag(*(np.outer(p.along, p.along) for p in points))
    seen = np.flatnonzero(np.isfinite(noise))
    observed = (joint[:size, :size] + np.diag(noise) + shared)[np.ix_(seen, seen)]
    half = np.linalg.solve(np.linalg.cholesky(observed), joint[seen, size:])
    missed = np.ravel([point.pose for point in points]) - mean.ravel()[:size]
    white_missed = np.linalg.solve(np.linalg.cholesky(observed), missed[seen])
    expected = mean[len(points) :] + (white_missed @ half).reshape(-1, 6)
    left = (joint[size:, size:] - half.T @ half).reshape(GRID.size, 6, GRID.size, 6)
    white = np.zeros(6) + getattr(movement, "noise_variance", 0.0)
    covariance = np.einsum("mono->omn", left) + white[:, None, None] * np.eye(GRID.size)
    variance = np.diagonal(covariance, axis1=1, axis2=2).T
    for ours, theirs in (
        (online.mean, expected),
        (online.std**2, variance),
        (online.trajectory().covariance.T, covariance.T),
    ):
        error = (ours - theirs) / np.abs(theirs).max(axis=0)
        assert_allclose(error, 0.0, atol=tolerance)


@pytest.mark.parametrize("name", ADAPTABLE)
def test_free_outputs_are_not_asked_for(name, learned, aligned):
    """NaN in the pose and an infinite deviation say the same; all free is no demand."""
    movement, point = learned(name), demonstrated(aligned, 30)
    free = np.array([False, True, False, True, False, True])
    some = [
        replace(point, pose=np.where(free, np.nan, point.pose)),
        replace(point, std=np.where(free, np.inf, point.std)),
    ]
    ours, theirs = (movement.adapt([demand]).predict(GRID) for demand in some)
    assert_allclose(ours.mean, theirs.mean, atol=1e-12)
    assert_allclose(ours.std, theirs.std, rtol=1e-12)
    before = movement.predict(GRID)
    for nothing in (
        replace(point, pose=np.full(6, np.nan)),
        replace(point, std=np.inf),
    ):
        after = movement.adapt([nothing]).predict(GRID)
        assert_allclose(after.mean, before.mean, atol=1e-9)


@pytest.mark.usefixtures("as_for_users")
@pytest.mark.parametrize(
    ("name", "count"),
    [*itertools.product(("gmr", "tp-gmm", "local-gp"), (1, 6)), ("wishart-gp", 6)],
)
def test_outputs_that_never_vary_are_predicted_as_such(name, count, aligned):
    """Also by those that learn from one demonstration, which they then follow."""
    poses = aligned.poses[:count].copy()
    poses[:, :, 1] = 0.25
    predicted = FITS[name](replace(aligned, poses=poses, clocks=None)).predict(GRID)
    assert np.abs(predicted.mean[:, 1] - 0.25).max() < 1e-4
    assert (predicted.std > 0.0).all()
    assert (predicted.std[:, 1] < 1e-4).all()
    if count == 1:
        curve = np.interp(GRID, aligned.times, poses[0, :, 0])
        assert_allclose(predicted.mean[:, 0], curve, atol=0.01)


@pytest.mark.filterwarnings("ignore:One demonstration")
@pytest.mark.parametrize("fit", [fit_promp, fit_prodmp])
def test_a_single_demonstration_is_of_unknown_size(fit, aligned):
    """As the skill of a single demonstration has it, in the outputs that move."""
    alone, moving = replace(aligned, poses=aligned.poses[:1], clocks=None), [0, 2, 4]
    trajectory, skill = fit(alone).predict(GRID), fit_skill(alone).predict(GRID)
    assert_allclose(trajectory.mean, skill.mean, atol=5e-3)
    error = ((trajectory.std - skill.std) / skill.std.max(axis=0))[:, moving]
    assert_allclose(error, 0.0, atol=0.05)


@pytest.mark.parametrize(
    ("fit", "message"),
    [
        (FITS["wishart-gp"], "at least 2 demonstrations, got 1"),
        (partial(fit_gmr, config=GMRConfig(components=61)), "61 components need as ma"),
        (
            partial(fit_local_gp, config=LocalGPConfig(clusters=16)),
            r"16 clusters of 60 ",
        ),
        (
            partial(fit_promp, config=ProMPConfig(n_basis=60)),
            "more than 60 phases, got 60: align with",
        ),
    ],
)
def test_too_few_demonstrations_or_phases_are_refused(fit, message, aligned):
    """One demonstration where the message asks for more, else one phase too few."""
    if "got 1" in message:
        aligned = replace(aligned, poses=aligned.poses[:1], clocks=None)
    with pytest.raises(ValueError, match=message):
        fit(aligned)


def test_the_empirical_distribution_has_the_moments_of_the_samples(aligned):
    trajectory = EmpiricalDistribution(aligned=aligned).predict(aligned.times)
    poses = aligned.poses
    assert_allclose(trajectory.mean, poses.mean(axis=0), atol=1e-14)
    assert_allclose(trajectory.std, poses.std(axis=0, ddof=1), atol=1e-14)
    for degrees, law in ((None, scipy.stats.norm), (5.0, scipy.stats.t(5.0))):
        low, high = replace(trajectory, degrees_of_freedom=degrees).interval(0.9)
        assert_allclose(high - low, 2.0 * law.ppf(0.95) * trajectory.std, atol=1e-14)
    some = EmpiricalDistribution(aligned=aligned).predict(GRID)
    curves = [np.interp(GRID, aligned.times, pose[:, 4]) for pose in poses]
    assert_allclose(some.covariance[4], np.cov(np.array(curves).T), atol=1e-14)
    single = EmpiricalDistribution(
        aligned=replace(aligned, poses=poses[:1], clocks=None)
    )
    assert_array_equal(single.predict(GRID).std, 0.0)
