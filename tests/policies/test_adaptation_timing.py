"""Via-points by a repetition's own clock: path and timing conditioned together."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_policies import Demonstration, PosePath, ViaPoint, adapt, align, fit_skill
from gplfd_policies.adaptation import OwnClockAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.conditioning import (
    ConditionedProcess,
    Repetition,
    leading_curves,
)
from gplfd_policies.adaptation.own_clock import delayed, timing_covariance
from gplfd_policies.adaptation.process import demonstrated_repetition
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.movements.prior_mean import fit_residual

pytestmark = pytest.mark.usefixtures("unchecked_types")

TIMES = np.linspace(0.0, 1.0, 60)
PATH = RBF(length_scale=0.3, signal_std=0.05)
TIMING = RBF(length_scale=0.25, signal_std=0.04)
PLACES = np.arange(1.0, 7.0)


def mean(phases):
    return np.sin(np.multiply.outer(phases, PLACES))


def slope(phases):
    return PLACES * np.cos(np.multiply.outer(phases, PLACES))


def repetition(timing=TIMING):
    basis = LegendreBasis(start=0.0, stop=1.0, size=48)
    root = basis.root_weights[:, None]
    curves = np.zeros((48, 0))
    if timing is not None:
        curves = leading_curves(basis.kernel_matrix(timing), 1e-16)
    deviations = leading_curves(basis.kernel_matrix(PATH), 1e-16)
    return Repetition(
        basis=basis,
        mean=root * mean(basis.nodes),
        deviations=np.tile(deviations, (6, 1, 1)),
        log_white=root * np.full((48, 6), np.log(1e-12)),
        slope=root * slope(basis.nodes),
        timing=curves,
    )


def dense(first, second, timing=TIMING):
    """Prior covariance between six outputs at phases, (6N, 6M)."""
    covariance = np.kron(np.eye(6), PATH(first, second))
    if timing is not None:
        late = timing(first, second)
        rates = np.einsum("ni,mj->injm", slope(first), slope(second))
        covariance += (rates * late[None, :, None, :]).reshape(covariance.shape)
    return covariance


@pytest.mark.parametrize("timing", [TIMING, None])
def test_timing_equals_dense_conditioning(timing):
    """30 via-points with a shared error against one solve of 180 equations."""
    rng = np.random.default_rng(0)
    phases = rng.uniform(0.0, 0.6, 30)
    late = 0.05 * np.sin(2.0 * phases)
    poses = mean(phases - late) + 0.02 * rng.normal(size=6)
    along = 0.01 * slope(phases)
    process = ConditionedProcess(repetition(timing), TIMES)
    for phase, pose, error in zip(phases, poses, along, strict=True):
        process.update(process.at(phase), pose, np.full(6, 1e-6), error)
    gram = dense(phases, phases, timing) + 1e-6 * np.eye(180)
    for number in range(30):
        places = number + 30 * np.arange(6)
        gram[np.ix_(places, places)] += np.outer(along[number], along[number])
    cross = dense(TIMES, phases, timing)
    step = cross @ np.linalg.solve(gram, (poses - mean(phases)).T.ravel())
    assert_allclose(process.mean, mean(TIMES) + step.reshape(6, -1).T, atol=1e-8)
    full = dense(TIMES, TIMES, timing) - cross @ np.linalg.solve(gram, cross.T)
    blocks = process.distribution(np.ones(6), None).covariance
    for output in range(6):
        part = slice(60 * output, 60 * output + 60)
        assert_allclose(blocks[output], full[part, part], atol=1e-9)


def test_rates_are_the_slopes_of_mean_and_spread():
    """Timing moves along ṁ, so that rates know m̈ and the slope of the timing."""
    fine = np.linspace(0.0, 1.0, 2001)
    process = ConditionedProcess(repetition(), fine)
    process.update(process.at(0.4), mean(np.array([0.35]))[0], np.full(6, 1e-4), PLACES)
    found = process.distribution(np.ones(6), None)
    for rate, curve in (
        (found.mean_rate, found.mean),
        (found.std_rate, found.std),
    ):
        differences = np.gradient(curve, fine, axis=0)
        assert_allclose(rate[2:-2], differences[2:-2], atol=2e-4)


def paced_arc(radius, hurry, rng):
    clock = np.linspace(0.0, 1.0, 200)
    paced = clock + hurry * clock * (1.0 - clock)
    poses = handle_pose_on_arc(radius, 1.2 * paced**2 * (3.0 - 2.0 * paced))
    waves = np.sin(np.outer(clock, rng.uniform(3.0, 9.0, 6)) + rng.uniform(0.0, 6.0, 6))
    wobble = np.repeat([1.5e-3, 6e-3], 3) * np.minimum(10.0 * clock, 1.0)[:, None]
    return Demonstration(times=6.0 * clock, poses=poses + wobble * waves)


@pytest.fixture(scope="module")
def openings():
    rng = np.random.default_rng(3)
    hurries = (-0.3, 0.2, 0.35, -0.1, 0.05, -0.25)
    radii = np.repeat([0.35, 0.5, 0.65], 2)
    given = [paced_arc(r, h, rng) for r, h in zip(radii, hurries, strict=True)]
    unseen = [paced_arc(0.42, 0.3, rng), paced_arc(0.58, -0.3, rng)]
    return fit_skill(align(given)), unseen


def forecast(form, skill, opening, seen):
    poses = opening.poses[::4]
    grid = np.linspace(0.0, 1.0, 50)
    adaptation = form(skill, grid)
    for phase, pose in zip(grid[:seen], poses[:seen], strict=True):
        adaptation.observe(ViaPoint(phase=float(phase), pose=pose))
    return adaptation, poses


def test_a_hurry_is_recognised_and_the_rest_comes_sooner(openings):
    """Held-out radii and paces by their own clock: half the error of what follows."""
    skill, unseen = openings
    errors = {ProcessAdaptation: [], OwnClockAdaptation: []}
    for form, opening, seen in (
        (form, opening, seen)
        for form in errors
        for opening in unseen
        for seen in (18, 25)
    ):
        adaptation, poses = forecast(form, skill, opening, seen)
        errors[form].append((adaptation.mean - poses)[seen:, [0, 2]])
    rms = {form: np.sqrt(np.mean(np.vstack(e) ** 2)) for form, e in errors.items()}
    assert rms[OwnClockAdaptation] < 0.6 * rms[ProcessAdaptation]


def test_evidence_tells_own_clocks_from_registered_phases(openings):
    skill, unseen = openings
    hurried, _ = forecast(OwnClockAdaptation, skill, unseen[0], 25)
    assert hurried.shares[0] > 0.99
    grid = np.linspace(0.0, 1.0, 50)
    registered = OwnClockAdaptation(skill, grid)
    assert registered.shares[0] == 0.5
    for phase in grid[:25]:
        pose = skill.predict(np.array([phase])).mean[0]
        registered.observe(ViaPoint(phase=float(phase), pose=pose))
    assert registered.shares[0] < 0.5


def test_own_clock_is_the_mixture_of_its_two_filters(openings):
    skill, unseen = openings
    adaptation, _ = forecast(OwnClockAdaptation, skill, unseen[1], 2)
    share = adaptation.shares[0]
    assert 0.01 < share < 0.99
    first, second = (one.trajectory() for one in adaptation._parts)
    mixed = adaptation.trajectory()
    second_moment = share * (first.std**2 + first.mean**2)
    second_moment += (1.0 - share) * (second.std**2 + second.mean**2)
    assert_allclose(mixed.std**2 + mixed.mean**2, second_moment, atol=1e-12)
    assert_array_equal(mixed.mean, adaptation.mean)
    assert_allclose(mixed.std, adaptation.std, rtol=1e-12)
    diagonal = np.diagonal(mixed.covariance, axis1=1, axis2=2).T
    assert_allclose(np.sqrt(diagonal), mixed.std, rtol=1e-6, atol=1e-9)
    fine = np.linspace(0.0, 1.0, 1001)
    adaptation, _ = forecast(
        lambda skill, _: OwnClockAdaptation(skill, fine), skill, unseen[1], 2
    )
    mixed = adaptation.trajectory()
    slopes = np.gradient(mixed.std, fine, axis=0)
    assert_allclose(mixed.std_rate[2:-2], slopes[2:-2], atol=5e-3)


def test_without_clocks_phases_are_certain(openings):
    """The default form follows what is known; timing without clocks is refused."""
    skill, unseen = openings
    bare = replace(skill, aligned=replace(skill.aligned, clocks=None))
    points = [ViaPoint(phase=0.3, pose=unseen[0].poses[60])]
    assert adapt(skill, points).form is OwnClockAdaptation
    assert adapt(bare, points).form is ProcessAdaptation
    with pytest.raises(ValueError, match=r"clocks, which are missing: .*form=.process"):
        adapt(bare, points, "own-clock").predict(TIMES)


def test_timing_covariance_has_the_size_of_the_clocks():
    rng = np.random.default_rng(0)
    hurries = 0.2 * rng.standard_normal(2000)
    bump = TIMES * (1.0 - TIMES)
    clocks = TIMES + np.multiply.outer(hurries - hurries.mean(), bump)
    covariance = timing_covariance(TIMES, clocks, TIMES[::3])
    assert_allclose(
        np.sqrt(np.diag(covariance)), 0.2 * bump[::3], rtol=0.05, atol=1e-12
    )
    # Half of it is the demonstrated shape, the rest any as smooth as a quarter.
    first, last = 5, 15
    correlation = covariance[first, last] / (0.2**2 * bump[15] * bump[45])
    distance = TIMES[45] - TIMES[15]
    expected = 0.5 + 0.5 * np.exp(-0.5 * (distance / 0.25) ** 2)
    assert correlation == pytest.approx(expected, rel=0.1)


def test_timing_of_a_bend_has_its_moments(openings):
    """Mean and spread of m(t + δτ) by chance, not those of the tangent."""
    skill, _ = openings
    registered = demonstrated_repetition(skill, TIMES)
    basis = registered.basis
    std = 0.15 * np.sin(np.pi * basis.nodes)
    shape = np.exp(-0.5 * (np.subtract.outer(basis.nodes, basis.nodes) / 0.3) ** 2)
    late = delayed(skill, registered, std[:, None] * shape * std)
    before, after = (ConditionedProcess(one, TIMES) for one in (registered, late))
    draws = np.random.default_rng(0).standard_normal(20000)
    for place in (20, 30, 45):
        moved = TIMES[place] + 0.15 * np.sin(np.pi * TIMES[place]) * draws
        poses = skill.predict(np.clip(moved, 0.0, 1.0)).mean
        spread = before.variance()[place] + poses.var(axis=0)
        tolerance = 0.03 * poses.std(axis=0)
        assert (np.abs(after.mean[place] - poses.mean(axis=0)) < tolerance).all()
        assert_allclose(after.variance()[place], spread, rtol=0.05)


def test_intervals_keep_the_degrees_of_freedom_of_the_demonstrations(openings):
    skill, unseen = openings
    for form in (ProcessAdaptation, OwnClockAdaptation):
        adaptation, _ = forecast(form, skill, unseen[0], 25)
        assert adaptation.trajectory().degrees_of_freedom == 5.0


def test_a_prior_mean_takes_part_in_no_delay(openings):
    """The slope of a residual is not the path's: phases are certain."""
    skill, unseen = openings
    path = PosePath(phases=TIMES, poses=handle_pose_on_arc(0.5, 1.2 * TIMES))
    movement = fit_residual(skill.aligned, path, partial(fit_skill, centred=False))
    points = [ViaPoint(phase=0.3, pose=unseen[0].poses[60])]
    assert adapt(movement, points).form is ProcessAdaptation
    with pytest.raises(ValueError, match="learn without a prior mean"):
        adapt(movement, points, "own-clock").predict(TIMES)
