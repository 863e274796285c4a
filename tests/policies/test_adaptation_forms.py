"""What every form of adaptation must do, and where they differ."""

from functools import partial

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import AlignedDemonstrations, ViaPoint, adapt, fit_skill
from gplfd_policies.adaptation import ADAPTATIONS, begin_adaptation
from gplfd_policies.adaptation.process import ExactAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.movements.baselines.promp import fit_promp

TIMES = np.linspace(0.0, 1.0, 50)
FORMS = sorted(ADAPTATIONS)
GRID_FREE = ["exact", "process"]
BY_PHASE = [form for form in FORMS if form != "similarity"]
"""Forms that take a via-point at its phase, and not as the next one of a path."""


def smooth_curves(count, length, seed, frequency=12.0):
    """Demonstrations whose deviations are smooth with a known length-scale."""
    rng = np.random.default_rng(seed)
    distance = np.subtract.outer(TIMES, TIMES)
    covariance = np.exp(-0.5 * (distance / length) ** 2) + 1e-9 * np.eye(len(TIMES))
    root = np.linalg.cholesky(covariance)
    deviations = np.einsum("ij,kjd->kid", root, rng.normal(size=(count, 50, 6)))
    mean = np.stack([0.3 * np.sin(frequency * TIMES + k) for k in range(6)], axis=1)
    return mean + 0.05 * deviations


def fit(poses):
    hurries = np.linspace(-0.2, 0.2, len(poses))
    clocks = TIMES + np.multiply.outer(hurries, TIMES * (1.0 - TIMES))
    return fit_skill(AlignedDemonstrations(times=TIMES, poses=poses, clocks=clocks))


@pytest.fixture(scope="module")
def skill():
    return fit(smooth_curves(8, 0.15, 0))


def via(skill, phase, shift, std=1e-3):
    mean = skill.predict(np.array([phase])).mean[0]
    return ViaPoint(phase=phase, pose=mean + shift, std=std)


@pytest.mark.parametrize("form", BY_PHASE)
def test_order_of_via_points_does_not_matter(skill, form):
    points = [via(skill, phase, 0.03 * k) for k, phase in enumerate((0.2, 0.5, 0.63))]
    forward, backward = (
        begin_adaptation(skill, ADAPTATIONS[form], TIMES) for _ in range(2)
    )
    for ahead, behind in zip(points, points[::-1], strict=True):
        forward.observe(ahead)
        backward.observe(behind)
    assert_allclose(forward.mean, backward.mean, atol=1e-9)
    # How surprising an output is, given the others, is asked when it is observed.
    once = 1e-9
    assert_allclose(forward.std, backward.std, atol=once)


@pytest.mark.parametrize("form", FORMS)
def test_adapt_takes_via_points_in_any_order_to_the_same_result(skill, form):
    """Also where they share an error along the path, on which the scale depends."""
    points = [
        ViaPoint(phase=phase, pose=via(skill, phase, shift).pose, along=slope)
        for phase, shift, slope in (
            (0.2, 0.03, 0.02),
            (0.5, -0.06, 0.04),
            (0.8, 0.1, 0.03),
        )
    ]
    first, *others = (
        adapt(skill, [points[place] for place in order], form).predict(TIMES)
        for order in ((0, 1, 2), (2, 1, 0), (1, 2, 0))
    )
    for other in others:
        assert_array_equal(other.mean, first.mean)
        assert_array_equal(other.std, first.std)


@pytest.mark.parametrize("form", FORMS)
def test_adapt_without_via_points_is_the_prediction(skill, form):
    predicted = skill.predict(TIMES)
    adapted = adapt(skill, [], form).predict(TIMES)
    assert_array_equal(adapted.mean, predicted.mean)
    assert_array_equal(adapted.std, predicted.std)


@pytest.mark.parametrize("form", GRID_FREE)
def test_answer_does_not_depend_on_the_grid(skill, form):
    points = [via(skill, phase, 0.05) for phase in (0.1234, 0.2345, 0.4)]
    common = np.array([0.0, 0.3, 0.95])
    coarse = adapt(skill, points, form).predict(common)
    for size in (10, 100):
        grid = np.union1d(np.linspace(0.0, 1.0, size), common)
        fine = adapt(skill, points, form).predict(grid)
        chosen = np.searchsorted(grid, common)
        assert_allclose(fine.mean[chosen], coarse.mean, atol=1e-12)
        assert_allclose(fine.std[chosen], coarse.std, atol=1e-12)


def test_product_depends_on_the_grid():
    """Every predicted phase counts as an observation: σ falls without learning."""
    skill = fit(smooth_curves(8, 0.15, 0, frequency=2.0))
    points = [via(skill, phase, 0.0) for phase in (0.1, 0.2, 0.3)]
    ends = [
        np.mean(adapt(skill, points, "product").predict(np.linspace(0, 1, m)).std[-1])
        for m in (3, 10, 100)
    ]
    assert ends[0] > 1.1 * ends[1] > 1.2 * ends[2]


def test_zero_prior_mean_pulls_the_policy():
    """Via-points on the mean must change nothing; with a zero prior mean they do."""
    poses = smooth_curves(6, 0.3, 1) + 1.0
    skill, grid = fit(poses), np.linspace(0.0, 1.0, 20)
    points = [via(skill, phase, 0.0) for phase in (0.0, 0.05)]
    mean = skill.predict(grid).mean
    kept = adapt(skill, points, "product").predict(grid).mean
    assert_allclose(kept, mean, atol=1e-9)
    paper = partial(ProductAdaptation, prior_mean="zero")
    pulled = adapt(skill, points, paper).predict(grid).mean
    assert np.max(np.abs(pulled - mean)) > 0.005


@pytest.mark.parametrize("form", FORMS)
def test_noise_free_and_contradicting_via_points_are_survived(skill, form):
    first, second = via(skill, 0.5, 0.04, 0.0), via(skill, 0.5, -0.02, 0.0)
    near = via(skill, 0.5 + 1e-9, 0.04, 0.0)
    adapted = adapt(skill, [first, first, second, near], form).predict(TIMES)
    assert np.isfinite(adapted.mean).all()
    assert np.isfinite(adapted.std).all()
    if form not in BY_PHASE:
        return
    at_point = adapt(skill, [first, second], form).predict(np.array([0.5]))
    middle = 0.5 * (first.pose + second.pose)
    assert_allclose(at_point.mean[0], middle, atol=2e-3)


@pytest.mark.parametrize("form", GRID_FREE)
def test_rates_equal_finite_differences(skill, form):
    adapted = adapt(skill, [via(skill, 0.3, 0.05), via(skill, 0.41, 0.02)], form)
    grid, step = np.linspace(0.02, 0.98, 31), 1e-6
    up, down = adapted.predict(grid + step), adapted.predict(grid - step)
    here = adapted.predict(grid)
    for name in ("mean", "std"):
        numeric = (getattr(up, name) - getattr(down, name)) / (2.0 * step)
        rate = getattr(here, f"{name}_rate")
        # σ turns sharply at a via-point
        assert_allclose(rate, numeric, atol=2e-6, rtol=1e-6)


@settings(max_examples=20)
@given(
    phases=st.lists(st.floats(0.0, 1.0), min_size=1, max_size=6),
    shift=st.floats(-0.5, 0.5),
    std=st.sampled_from([0.0, 1e-6, 1e-3, 1.0]),
    form=st.sampled_from(GRID_FREE),
)
def test_covariance_stays_a_covariance(skill, phases, shift, std, form):
    points = [via(skill, phase, shift, std) for phase in phases]
    adapted = adapt(skill, points, form).predict(TIMES)
    assert (adapted.std > 0.0).all()
    eigenvalues = np.linalg.eigvalsh(adapted.covariance)
    assert (eigenvalues[:, 0] > -1e-10 * eigenvalues[:, -1]).all()


def test_other_movements_adapt_in_their_own_form():
    promp = fit_promp(
        AlignedDemonstrations(times=TIMES, poses=smooth_curves(8, 0.3, 0))
    )
    point = ViaPoint(phase=0.4, pose=promp.predict(TIMES).mean[20] + 0.05)
    expected = promp.adapt([point]).predict(TIMES)
    adapted = adapt(promp, [point]).predict(TIMES)
    assert_array_equal(adapted.mean, expected.mean)
    assert_array_equal(adapted.covariance, expected.covariance)
    with pytest.raises(ValueError, match=r"own form .*: leave form='product' out"):
        adapt(promp, [point], "product")


@pytest.mark.parametrize("form", [ExactAdaptation, ProcessAdaptation])
def test_what_no_form_can_use_is_refused(skill, form):
    refused = {
        "too far beyond": lambda: form(skill, np.array([0.0, 50.0])),
        "finite grid": lambda: form(skill, np.array([0.0, np.nan])),
        r"phase 1.5 is outside the range": lambda: adapt(
            skill, [via(skill, 1.5, 0.0)], form
        ).predict(TIMES),
        "must increase strictly": lambda: ProductAdaptation(skill, np.full(2, 0.5)),
        r"form 'proces'.*exact.*process.*product": lambda: adapt(skill, [], "proces"),
    }
    for message, call in refused.items():
        with pytest.raises(ValueError, match=message):
            call()
