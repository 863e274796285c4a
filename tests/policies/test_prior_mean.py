"""Prior means: what is known before, and what is learned around it."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import PosePath, PriorMean, ViaPoint, align, fit_skill, make_agent
from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.adaptation.process import ExactAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.product import ProductAdaptation
from gplfd_policies.gp.exact import ExactGP
from gplfd_policies.gp.heteroscedastic import KerstingNoise
from gplfd_policies.movements.baselines.local_gp import fit_local_gp
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.prior_mean import fit_residual

pytestmark = pytest.mark.slow

BESIDE = np.array([0.1, 0.02, -0.1, 0.05, 0.3, -0.05])
GRID = np.linspace(0.0, 1.0, 31)
FAR = np.array([-40.0, -30.0, 30.0, 40.0])
SHORT_CHAIN = WishartGPConfig(steps=20, discarded=5, times=15, degrees=6)
FITS = {
    "map": partial(fit_skill, noise="map"),
    "kersting": partial(fit_skill, noise=KerstingNoise(n_iterations=2)),
    "homoscedastic": partial(fit_skill, noise="homoscedastic"),
    "local": fit_local_gp,
    "wishart": partial(fit_wishart_gp, config=SHORT_CHAIN, seed=0),
}
FORMS = {
    "process": ProcessAdaptation,
    "product": ProductAdaptation,
    "paper": partial(ProductAdaptation, prior_mean="zero"),
    "exact": ExactAdaptation,
}
VIA_POINTS = (
    ViaPoint(phase=0.3, pose=np.full(6, 0.02)),
    ViaPoint(phase=0.8, pose=np.array([0.1, np.nan, -0.1, np.nan, 0.2, 0.0])),
)


class Line:
    """A prior mean that goes on straight."""

    slope = np.array([0.4, 0.0, -0.2, 0.0, 0.8, 0.1])

    def mean(self, times):
        return BESIDE + np.outer(times, self.slope)

    def rate(self, times):
        return np.tile(self.slope, (len(times), 1))


@pytest.fixture(scope="module")
def doors(demonstrations):
    return align(demonstrations, n_samples=40)


@pytest.fixture(scope="module")
def movement(doors):
    return fit_residual(doors, Line(), partial(fit_skill, centred=False))


def moved(via_point, prior_mean):
    expected = prior_mean.mean(np.array([via_point.phase]))[0]
    return replace(via_point, pose=via_point.pose + expected)


@pytest.mark.parametrize("fit", FITS)
def test_far_from_the_demonstrations_the_mean_is_the_prior_mean(fit, doors):
    learned = fit_residual(doors, Line(), partial(FITS[fit], centred=False))
    assert_allclose(learned.predict(FAR).mean, Line().mean(FAR), rtol=0.0, atol=1e-6)
    around, plain = learned.predict(GRID), FITS[fit](doors).predict(GRID)
    # Where there are demonstrations they say where to go.
    assert np.sqrt(np.mean(((around.mean - plain.mean) / plain.std) ** 2)) < 0.2


@pytest.mark.parametrize("output", [0, 4])
def test_prediction_is_that_of_a_process_with_a_prior_mean(movement, doors, output):
    """Against the naive process of Eq. (1) on all D·M observations of one output."""
    fitted = movement.residual.processes.outputs[output]
    scale, times, count = fitted.scale, doors.times, len(doors.poses)
    naive = ExactGP(
        kernel=replace(fitted.kernel, signal_std=scale * fitted.kernel.signal_std),
        times=np.tile(times, count),
        values=(doors.poses - Line().mean(times))[:, :, output].ravel(),
        noise_variance=np.tile(scale**2 * fitted.noise.variance(times), count),
    )
    asked = np.linspace(-0.5, 2.0, 21)
    expected = Line().mean(asked)[:, output] + naive.mean(asked)
    assert_allclose(movement.predict(asked).mean[:, output], expected, atol=1e-6)


@pytest.mark.parametrize("form", FORMS)
def test_adaptation_is_that_of_the_residual_plus_the_prior_mean(form, doors):
    """Demonstrations and via-points moved together move the answer, and no more."""
    prior_mean = Line()
    raised = replace(doors, poses=doors.poses + prior_mean.mean(doors.times))
    fit = partial(fit_skill, centred=False)
    whole = begin_adaptation(fit_residual(raised, prior_mean, fit), FORMS[form], GRID)
    rest = FORMS[form](fit(doors), GRID)
    for via_point in VIA_POINTS:
        whole.observe(moved(via_point, prior_mean))
        rest.observe(via_point)
    assert_allclose(whole.mean, rest.mean + Line().mean(GRID), atol=1e-5)
    assert_allclose(whole.std, rest.std, rtol=1e-3, atol=1e-7)
    trajectory, other = whole.trajectory(), rest.trajectory()
    assert_array_equal(trajectory.mean, whole.mean)
    assert_allclose(trajectory.mean_rate, other.mean_rate + Line().slope, atol=1e-3)


@pytest.mark.parametrize("name", ["dmp", "oracle"])
def test_methods_that_cannot_be_given_a_prior_mean_say_so(name, demonstrations):
    with pytest.raises(ValueError, match="accepts no prior mean;"):
        make_agent(name, demonstrations, prior_mean=Line())


def test_path_passes_its_poses_without_overshoot_and_rests_at_its_ends():
    phases = np.array([0.0, 0.2, 0.5, 1.4])
    poses = np.outer([0.0, 1.0, 1.0, 3.0], np.arange(1.0, 7.0))
    path = PosePath(phases=phases, poses=poses)
    assert isinstance(path, PriorMean)
    assert_allclose(path.mean(phases), poses, atol=1e-12)
    assert_allclose(path.mean(np.array([0.3, 0.4])), poses[[1, 1]])
    ends = np.array([-5.0, 9.0])
    assert_array_equal(path.mean(ends), poses[[0, -1]])
    assert_array_equal(path.rate(ends), np.zeros((2, 6)))
    times, step = np.array([-0.1, 0.1, 0.37, 0.8, 1.5]), 1e-6
    difference = (path.mean(times + step) - path.mean(times - step)) / (2.0 * step)
    assert_allclose(path.rate(times), difference, atol=1e-6)


@pytest.mark.parametrize(
    ("phases", "poses", "message"),
    [
        (np.zeros(1), np.zeros((1, 6)), "N at least 2"),
        (np.array([0.0, 1.0, 1.0]), np.zeros((3, 6)), "increase strictly"),
    ],
)
def test_path_refuses_what_is_none(phases, poses, message):
    with pytest.raises(ValueError, match=message):
        PosePath(phases=phases, poses=poses)
