"""Each form against its definition: Eqs. (19)-(21) and Gaussian conditioning."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import AlignedDemonstrations, ViaPoint, adapt, fit_skill
from gplfd_policies.adaptation.process import (
    ConditionedProcess,
    ExactAdaptation,
    ForceAdaptation,
    ProcessAdaptation,
    Repetition,
)
from gplfd_policies.adaptation.product import ProductAdaptation, product_of_gaussians
from gplfd_policies.gp.deviations import (
    DeviationLikelihood,
    DeviationProcess,
    fit_deviations,
)
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.heteroscedastic import LEAST_SPREAD, MapNoise
from gplfd_policies.gp.kernels import RBF, LegendreBasis

pytestmark = pytest.mark.slow

TIMES = np.linspace(0.0, 1.0, 60)
ANGLE = 1.2
SMOOTH = RBF(length_scale=0.2, signal_std=0.1)


def door(radius, times=TIMES):
    pose = np.zeros((len(times), 6))
    pose[:, 0], pose[:, 4] = radius * np.sin(ANGLE * times), ANGLE * times
    pose[:, 2] = radius * (np.cos(ANGLE * times) - 1.0)
    return pose


@pytest.fixture(scope="module")
def skill():
    rng = np.random.default_rng(0)
    poses = np.array([door(radius) for radius in (0.35, 0.5, 0.65) for _ in range(2)])
    for index in range(len(poses)):
        rising = np.minimum(10.0 * TIMES, 1.0)[:, None]
        for frequency in (1.0, 2.0, 3.0):
            wave = np.sin(np.pi * frequency * TIMES[:, None] + rng.uniform(0, 6, 6))
            poses[index] += 0.002 / frequency * rising * rng.normal(size=6) * wave
    return fit_skill(AlignedDemonstrations(times=TIMES, poses=poses))


def random_covariance(rng, size):
    root = rng.normal(size=(size, size))
    return root @ root.T + 0.1 * np.eye(size)


def test_product_equals_printed_equations():
    rng = np.random.default_rng(0)
    demonstrated, via = random_covariance(rng, 7), random_covariance(rng, 7)
    mean_d, mean_v = rng.normal(size=7), rng.normal(size=7)
    mean, covariance = product_of_gaussians(mean_d, demonstrated, mean_v, via)
    inverse = np.linalg.inv(demonstrated + via)
    assert_allclose(
        mean, via @ inverse @ mean_d + demonstrated @ inverse @ mean_v, atol=1e-10
    )
    assert_allclose(covariance, demonstrated @ inverse @ via, atol=1e-10)
    assert_array_equal(covariance, covariance.T)
    precisions = np.linalg.inv(demonstrated) + np.linalg.inv(via)
    assert_allclose(np.linalg.inv(covariance), precisions, atol=1e-6)


def test_product_multiplies_with_a_process_on_the_via_points(skill):
    grid = np.linspace(0.0, 1.0, 15)
    points = [ViaPoint(phase=p, pose=door(0.42, np.array([p]))[0]) for p in (0.2, 0.5)]
    adaptation = ProductAdaptation(skill, grid)
    for point in points:
        adaptation.observe(point)
    output, demonstrated = 2, skill.predict(grid)
    fitted = skill.processes.outputs[output]
    phases = np.array([0.2, 0.5])
    values = np.array([point.pose[output] for point in points])
    via = ExactGP(
        kernel=RBF(
            length_scale=fitted.kernel.length_scale,
            signal_std=fitted.kernel.signal_std * fitted.scale,
        ),
        times=phases,
        values=values - skill.predict(phases).mean[:, output],
        noise_variance=np.full(2, 1e-6),
    )
    mean, covariance = product_of_gaussians(
        demonstrated.mean[:, output],
        demonstrated.covariance[output],
        demonstrated.mean[:, output] + via.mean(grid),
        via.covariance(grid),
    )
    assert_allclose(adaptation.mean[:, output], mean, atol=1e-9)
    assert_allclose(adaptation.std[:, output], np.sqrt(np.diag(covariance)), atol=1e-9)


@pytest.mark.parametrize(("least", "tolerance"), [(0.0, 1e-7), (LEAST_SPREAD, 1e-3)])
def test_exact_equals_gp_on_demonstrations_and_via_points(skill, least, tolerance):
    """Exactly, but where the spread meets its floor: log r has a bend there."""
    skill = fit_skill(skill.aligned, MapNoise(least_spread=least))
    phases, stds = np.array([0.123, 0.4, 0.77]), np.array([1e-3, 1e-2, 3e-3])
    adaptation = ExactAdaptation(skill, TIMES)
    for phase, std in zip(phases, stds, strict=True):
        pose = door(0.45, np.array([phase]))[0]
        adaptation.observe(ViaPoint(phase=float(phase), pose=pose, std=float(std)))
    output = 0
    fitted = skill.processes.outputs[output]
    scaled = (skill.aligned.poses[:, :, output] - fitted.offset) / fitted.scale
    seen = (door(0.45, phases)[:, output] - fitted.offset) / fitted.scale
    noise = fitted.noise.variance(TIMES)
    naive = ExactGP(
        kernel=fitted.kernel,
        times=np.concatenate([np.tile(TIMES, 6), phases]),
        values=np.concatenate([scaled.ravel(), seen]),
        noise_variance=np.concatenate([np.tile(noise, 6), (stds / fitted.scale) ** 2]),
    )
    mean = fitted.offset + fitted.scale * naive.mean(TIMES)
    assert_allclose(adaptation.mean[:, output], mean, atol=1e-8)
    std = fitted.scale * np.sqrt(naive.variance(TIMES) + noise)
    assert_allclose(adaptation.std[:, output], std, rtol=tolerance, atol=1e-8)


def smooth_repetition():
    """Six processes of the covariance SMOOTH around sin 3t."""
    basis = LegendreBasis(start=0.0, stop=1.0, size=48)
    values, vectors = np.linalg.eigh(basis.kernel_matrix(SMOOTH))
    curves = vectors * np.sqrt(np.maximum(values, 0.0))
    root = basis.root_weights[:, None]
    return Repetition(
        basis=basis,
        mean=root * np.tile(np.sin(3.0 * basis.nodes)[:, None], 6),
        deviations=np.tile(curves, (6, 1, 1)),
        log_white=root * np.full((48, 6), np.log(1e-12)),
    )


def smooth_process():
    return ConditionedProcess(smooth_repetition(), None, TIMES)


def dense_conditioning(phases, poses, along, variance):
    """One Gaussian over six outputs at all times, (6M, 6M), conditioned at once."""
    six, count = np.eye(6), len(phases)
    gram = np.kron(six, SMOOTH(phases, phases)) + variance * np.eye(6 * count)
    for number in range(count):
        places = number + count * np.arange(6)
        gram[np.ix_(places, places)] += np.outer(along[number], along[number])
    cross = np.kron(six, SMOOTH(TIMES, phases))
    rest = (poses - np.sin(3.0 * phases)[:, None]).T.ravel()
    mean = (cross @ np.linalg.solve(gram, rest)).reshape(6, -1).T
    covariance = np.kron(six, SMOOTH(TIMES, TIMES))
    covariance -= cross @ np.linalg.solve(gram, cross.T)
    blocks = covariance.reshape(6, len(TIMES), 6, -1)
    return np.sin(3.0 * TIMES)[:, None] + mean, np.einsum("imin->imn", blocks)


SHARED = np.array([0.05, -0.02, 0.0, 0.01, 0.03, -0.04])


@pytest.mark.parametrize(
    ("phases", "shared"),
    [
        (np.random.default_rng(1).uniform(0.0, 1.0, 200), 0.0 * SHARED),
        (np.random.default_rng(2).uniform(0.0, 1.0, 40), SHARED),
        (np.full(40, 0.37), SHARED),
    ],
    ids=["independent", "shared", "repeated"],
)
def test_shared_error_equals_dense_conditioning(phases, shared):
    """Via-points off the grid whose outputs share an error; or one over and over."""
    # Once more through the same place is news of the pose, never of what is shared.
    poses = np.sin(3.0 * phases)[:, None]
    poses = poses + 0.05 * np.random.default_rng(3).normal(size=6)
    process = smooth_process()
    for phase, pose in zip(phases, poses, strict=True):
        process.update(process.at(phase), pose, np.full(6, 1e-4), shared)
    along = np.tile(shared, (len(phases), 1))
    mean, covariance = dense_conditioning(phases, poses, along, 1e-4)
    assert_allclose(process.mean, mean, atol=1e-11 if shared.any() else 1e-12)
    conditioned = process.trajectory().covariance
    assert_allclose(conditioned, covariance + 1e-12 * np.eye(60), atol=1e-13)


def test_shared_error_leaves_what_is_across_the_path_certain():
    """The path runs along (1, 1, 0, ...): its sum is uncertain, its difference not."""
    process = smooth_process()
    pose = np.full(6, np.sin(1.5)) + np.array([0.05, -0.05, 0.0, 0.0, 0.0, 0.0])
    along = np.array([1.0, 1.0, 0.0, 0.0, 0.0, 0.0])
    process.update(process.at(0.5), pose, np.full(6, 1e-6), along)
    moved = process.mean - np.sin(3.0 * TIMES)[:, None]
    here = np.argmin(np.abs(TIMES - 0.5))
    assert_allclose(moved[here, :2], [0.05, -0.05], rtol=1e-2)
    alone = smooth_process()
    alone.update(alone.at(0.5), pose, 1e-6 + along**2, np.zeros(6))
    assert np.abs(alone.mean - np.sin(3.0 * TIMES)[:, None])[:, :2].max() < 1e-3


def test_what_is_left_out_of_a_covariance_is_not_seen():
    repetition = smooth_repetition()
    basis = repetition.basis
    kernel = SMOOTH(basis.nodes, basis.nodes)
    root = basis.root_weights[:, None]
    small = Repetition.from_covariance(
        basis,
        repetition.mean / root,
        np.tile(kernel, (6, 1, 1)),
        repetition.log_white / root,
    )
    assert small.deviations.shape[2] < 20
    processes = [ConditionedProcess(p, None, TIMES) for p in (repetition, small)]
    for process in processes:
        for phase in (0.1, 0.3, 0.5):
            here = process.at(phase)
            process.update(here, np.zeros(6), np.full(6, 1e-6), np.full(6, 0.01))
    std, rough = (np.sqrt(process.variance()) for process in processes)
    assert_allclose(processes[1].mean, processes[0].mean, atol=2e-4)
    assert_allclose(rough, std, atol=2e-4)


def test_process_conditions_its_own_prior(skill):
    """Means after via-points against a dense solve with the prior covariance."""
    prior = ProcessAdaptation(skill, TIMES).trajectory()
    chosen = [10, 25, 40]
    adaptation = ProcessAdaptation(skill, TIMES)
    poses = door(0.42)
    for index in chosen:
        adaptation.observe(ViaPoint(phase=float(TIMES[index]), pose=poses[index]))
    noise = skill.processes.moments(TIMES).noise
    for output in (0, 2):
        full = prior.covariance[output]
        # The via-points see the white part as noise, not as a part of the path.
        white = skill.deviations[output].white_variance(noise[:, output])
        white *= prior.std[:, output] ** 2 / noise[:, output]
        smooth = full - np.diag(white)
        cross = smooth[:, chosen]
        gram = full[np.ix_(chosen, chosen)] + 1e-6 * np.eye(3)
        step = poses[chosen, output] - prior.mean[chosen, output]
        mean = prior.mean[:, output] + cross @ np.linalg.solve(gram, step)
        assert_allclose(adaptation.mean[:, output], mean, atol=1e-5)


def test_a_door_may_have_a_force_of_its_own(skill):
    """A hundredth each of a constant and of half a constant, half over a tenth."""
    ours, plain = (
        form(skill, TIMES).trajectory().covariance
        for form in (ForceAdaptation, ProcessAdaptation)
    )
    square = np.sum(skill.aligned.poses**2, axis=(0, 1)) / np.prod(
        skill.aligned.poses.shape[:2]
    )
    apart = TIMES[:, None] - TIMES
    shape = 0.01 + 0.01 * 0.5 * (1.0 + np.exp(-50.0 * apart**2))
    for output, total in enumerate(np.repeat([square[:3].sum(), square[3:].sum()], 3)):
        change = ours[output] - plain[output]
        assert_allclose(change, 0.25 * total * shape, atol=4e-5 * total)


def test_a_door_heavier_than_all_demonstrated_ones_is_heavy_all_the_way(skill):
    """Seen at its first tenth; the demonstrations' spread alone forgets it."""
    demonstrated = skill.predict(TIMES).mean
    shift = 2.0 * np.sqrt(np.mean(demonstrated[:, :3] ** 2))
    errors = []
    for form in (ForceAdaptation, ProcessAdaptation):
        adaptation = form(skill, TIMES)
        for index in range(6):
            pose = demonstrated[index] + shift
            adaptation.observe(ViaPoint(phase=float(TIMES[index]), pose=pose, std=0.01))
        error = adaptation.mean[-20:, 1] - demonstrated[-20:, 1] - shift
        errors.append(np.abs(error).max() / shift)
        inside = np.abs(error) < 1.96 * adaptation.std[-20:, 1]
    assert errors[0] < 0.5
    assert errors[1] > 0.9
    assert not inside.any()


def test_student_scale_is_the_textbook_one(skill):
    adaptation = ProcessAdaptation(skill, TIMES)
    prior = adaptation.trajectory()
    pose = prior.mean[30] + 4.0 * prior.std[30]
    adaptation.observe(ViaPoint(phase=float(TIMES[30]), pose=pose, std=1e-6))
    # ν = 5, n = 1, δ² = 16 to within the noise and the white part
    widened = adaptation.std[30] > 0.0
    assert widened.all()
    free = ProcessAdaptation(skill, TIMES)
    free.observe(ViaPoint(phase=float(TIMES[30]), pose=prior.mean[30], std=1e-6))
    ratio = adaptation.std / free.std
    assert_allclose(ratio, np.sqrt((5.0 + 16.0) / (5.0 + 1.0)), rtol=1e-3)


def test_one_demonstration_has_no_deviations():
    poses = door(0.5)[None]
    aligned = AlignedDemonstrations(times=TIMES, poses=poses)
    with pytest.warns(UserWarning, match="One demonstration"):
        skill = fit_skill(aligned, noise="homoscedastic")
    point = ViaPoint(phase=0.5, pose=door(0.5)[30] + 1e-3)
    with pytest.raises(ValueError, match=r'at least 2 demonstrations.*form="exact"'):
        adapt(skill, [point], "process").predict(TIMES)
    for form in ("similarity", "exact", "product"):
        assert np.isfinite(adapt(skill, [point], form).predict(TIMES).std).all()


def test_demonstrated_curves_shape_what_follows():
    """Early high, late low in every demonstration: no stationary model expects it."""
    rng = np.random.default_rng(0)
    swing = np.multiply.outer(rng.normal(size=8), 0.1 * np.cos(np.pi * TIMES))
    poses = np.tile(door(0.5), (8, 1, 1))
    poses[:, :, 0] += swing + 0.001 * rng.normal(size=swing.shape)
    skill = fit_skill(AlignedDemonstrations(times=TIMES, poses=poses))
    before = skill.predict(TIMES).mean
    adaptation = ProcessAdaptation(skill, TIMES)
    for index in (3, 6, 9):
        shift = 0.08 * np.cos(np.pi * TIMES[index])
        pose = np.full(6, np.nan)
        pose[0] = before[index, 0] + shift
        adaptation.observe(ViaPoint(phase=float(TIMES[index]), pose=pose))
    assert (adaptation.mean - before)[-3, 0] < -0.001


def test_deviation_covariance_has_the_demonstrated_variance():
    noise = np.linspace(0.001, 0.02, 9)
    process = DeviationProcess(
        wobble=0.002, varying=0.3, white=0.2, long_scale=1.0, short_scale=0.1
    )
    covariance = process.smooth_covariance(np.linspace(0.0, 1.0, 9), noise)
    total = np.diag(covariance) + process.white_variance(noise)
    assert_allclose(total, noise, rtol=1e-12)
    assert np.linalg.eigvalsh(covariance)[0] > -1e-15
    # Neither part exceeds what there is.
    task, wobble = process.split(noise)
    assert (wobble < 0.002).all()
    assert (task >= 0.0).all()


def likelihood(deviations):
    times, noise = np.linspace(0.0, 1.0, 25), np.exp(np.linspace(-3.0, 1.0, 25))
    return DeviationLikelihood(times, deviations, noise)


def test_deviation_likelihood_gradient_equals_finite_differences():
    value = likelihood(np.random.default_rng(0).normal(size=(4, 25)))
    theta, step = np.array([-1.0, -0.4, 0.2, -0.6, -1.2]), 1e-6
    numeric = [
        (value(theta + step * unit)[0] - value(theta - step * unit)[0]) / (2.0 * step)
        for unit in np.eye(5)
    ]
    assert_allclose(value(theta)[1], numeric, rtol=1e-5)


def test_deviation_likelihood_counts_degrees_of_freedom():
    """D deviations from their mean are D − 1 independent draws: REML, spelt out."""
    rng = np.random.default_rng(0)
    curves = rng.normal(size=(4, 25))
    deviations = curves - curves.mean(axis=0)
    theta = np.array([-1.0, -0.4, 0.2, -0.6, -1.2])
    value = likelihood(deviations)
    process = value.process(theta)
    covariance = process.smooth_covariance(value.times, value.noise)
    covariance += np.diag(process.white_variance(value.noise) + 1e-6 * value.noise)
    # Orthonormal contrasts between the demonstrations
    contrasts = np.linalg.svd(np.eye(4) - 0.25)[2][:3]
    independent = contrasts @ curves
    _, log_determinant = np.linalg.slogdet(covariance)
    expected = sum(
        -0.5 * (log_determinant + draw @ np.linalg.solve(covariance, draw))
        for draw in independent
    )
    assert value(theta)[0] == pytest.approx(expected, rel=1e-9)


def test_fitted_deviations_tell_task_from_wobble():
    rng = np.random.default_rng(0)
    times = np.linspace(0.2, 1.0, 60)
    noise = 1e-4 + 0.01 * times**2
    radius = rng.normal(size=(12, 1)) * np.sqrt(noise - 1e-4)
    distance = np.subtract.outer(times, times)
    short = np.exp(-0.5 * (distance / 0.12) ** 2) + 1e-8 * np.eye(60)
    wobble = 0.01 * rng.normal(size=(12, 60)) @ np.linalg.cholesky(short).T
    curves = radius + wobble
    fitted = fit_deviations(times, curves - curves.mean(axis=0), noise)
    # At the end of the task the wobble is 1e-4 of 1e-2.
    _, size = fitted.split(noise)
    assert 2e-5 < size[-1] < 3e-4
    covariance = fitted.smooth_covariance(times, noise)
    root = np.sqrt(np.diag(covariance))
    correlation = covariance / root[:, None] / root
    assert correlation[20, -1] > 0.9
    assert fitted.short_scale == pytest.approx(0.12, rel=0.2)
