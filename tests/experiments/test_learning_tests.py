"""Learning tests: folds, scores with known answers, and every method measured alike."""

import collections
import dataclasses
import functools
import json
import math
from collections.abc import Callable, Sequence
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher, TeacherConfig
from gplfd_experiments.studies.learning_tests import scores
from gplfd_experiments.studies.learning_tests.folds import (
    OnPhases,
    accuracy,
    aligned_to,
    by_door,
    folds,
    learn,
    spread_followed,
)
from gplfd_experiments.studies.learning_tests.scores import (
    TUMBLE_STD,
    adaptation,
    beyond,
    force_scores,
    method_metrics,
    prior_mean_used,
    tumbled_rotations,
    tumbling,
)
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.gp.heteroscedastic import KerstingNoise
from gplfd_policies.movements.baselines.local_gp import LocalGPConfig, fit_local_gp
from gplfd_policies.movements.baselines.wishart_gp import (
    WishartGPConfig,
    fit_wishart_gp,
)
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    ViaPoint,
    white_covariance,
)
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.registry.built_in import POLICIES, SPACES
from gplfd_policies.registry.method import Learner, Method, TrainingInput

Curve = Callable[[np.ndarray], np.ndarray]
ONE = "demonstration"
TEACHER = TeacherConfig(duration_mean=2.0, sampling_rate=30.0)
pytestmark = [pytest.mark.slow, pytest.mark.filterwarnings("ignore:sensor noise")]


@functools.cache
def doors(seed: int = 0, per_door: int = 2) -> list[Sequence[Demonstration]]:
    """Short demonstrations of three doors, as the teacher gives them."""
    rng = np.random.default_rng(seed)
    given = Teacher(TEACHER).demonstrate_doors(DEMONSTRATED_RADII, per_door, rng=rng)
    return by_door(given, per_door)


@functools.cache
def aligned_doors() -> AlignedDemonstrations:
    return align([one for door in doors() for one in door])


def zeros(times: np.ndarray) -> np.ndarray:
    return np.zeros((len(times), 6))


def ones(times: np.ndarray) -> np.ndarray:
    return np.ones((len(times), 6))


@dataclasses.dataclass(frozen=True)
class Known:
    """A movement whose mean and standard deviation are given functions."""

    aligned: AlignedDemonstrations
    mean: Curve = zeros
    std: Curve = ones
    duration: float = 6.0

    def predict(self, times: np.ndarray) -> GaussianTrajectory:
        return predicted(self.mean(times), self.std(times), times)


def predicted(
    mean: np.ndarray, std: np.ndarray, times: np.ndarray | None = None
) -> GaussianTrajectory:
    if times is None:
        times = np.linspace(0.0, 1.0, len(mean))
    covariance = functools.partial(white_covariance, std**2)
    return GaussianTrajectory.from_moments(times, mean, std, covariance)


class Untaught(Method):
    """Makes its movement from the whole training input."""

    def learn(self, training: TrainingInput) -> Any:
        return self.learner.fit(training)


def knowing(mean: Curve = zeros, std: Curve = ones, form: Any = None) -> Method:
    """A method that learns nothing and knows the answer."""
    learner = Learner(
        fit=lambda training: Known(align(training.demonstrations), mean, std),
        accepts_prior_mean=True,
        adaptation=form,
    )
    return Untaught(learner=learner)


@pytest.mark.parametrize("held_out", [ONE, "radius"])
def test_learning_does_not_see_what_is_left_out(held_out):
    for number, fold in enumerate(folds(doors(), held_out, seed=0)):
        left_out = {id(one) for one in fold.left_out}
        assert len(fold.training) + len(left_out) == 6
        assert not left_out & {id(one) for one in fold.training}
        changed = [
            tuple(
                other if id(own) in left_out else own
                for own, other in zip(*pair, strict=True)
            )
            for pair in zip(doors(), doors(seed=1), strict=True)
        ]
        again = folds(changed, held_out, seed=0)[number]
        assert not {id(one) for one in again.left_out} & left_out
        before, after = (align(each.training) for each in (fold, again))
        aligned_to(again.left_out[0], before)
        np.testing.assert_array_equal(before.poses, after.poses)


def test_folds_take_turns():
    left_out = [fold.left_out for n in range(6) for fold in folds(doors(), ONE, n)]
    counts = collections.Counter(id(one) for (one,) in left_out)
    assert list(counts.values()) == [2] * 6
    given = doors(per_door=3)
    for seed, outer in ((0, 0), (1, 2), (2, 0)):
        middle, other = folds(given, "radius", seed)
        assert (middle.left_out, other.left_out) == (given[1], given[outer])


@pytest.mark.filterwarnings("ignore:turns")
def test_a_left_out_motion_of_two_turns_is_continued_as_the_others_are():
    share = np.linspace(0.0, 1.0, 200)
    turn = np.outer(share, [0.0, 0.0, 4.0 * np.pi])
    tilted = [
        Rotation.from_rotvec(turn) * Rotation.from_rotvec(np.outer(share, [tilt, 0, 0]))
        for tilt in (-0.02, 0.03, 0.01)
    ]
    *others, left_out = (
        Demonstration.from_quaternions(
            6.0 * share, np.outer(share, [0.2, 0, 0]), r.as_quat(scalar_first=True)
        )
        for r in tilted
    )
    aligned = align(others)
    found = aligned_to(left_out, aligned)
    expected = aligned.poses.mean(axis=0)
    assert np.abs(found.at(aligned.times) - expected)[:, 3:].max() < 0.1


def test_timing_of_the_left_out_demonstration_does_not_matter():
    """The same path in another time lies at the same phases."""
    noisy = ("noise_position", "noise_rotation", "wobble_position", "wobble_rotation")
    quiet = dict.fromkeys([f"{name}_std" for name in (*noisy, "vertical_drift")], 0.0)
    one = Teacher(TeacherConfig(**quiet)).demonstrate(0.5, np.random.default_rng(0))
    share = (one.times / one.times[-1]) ** 1.5
    poses = np.stack(
        [np.interp(share, one.times / one.times[-1], c) for c in one.poses.T], axis=1
    )
    late = Demonstration(times=2.0 * one.times, poses=poses)
    aligned = align([one])
    found = aligned_to(late, aligned)
    error = found.at(aligned.times) - aligned.poses[0]
    assert np.abs(error).max() < 2e-3
    assert (np.diff(found.phases) > 0.0).all()
    assert found.phases[[0, -1]] == pytest.approx([0.0, 1.0])


def test_known_gaussian_has_nominal_coverage_and_its_entropy():
    rng = np.random.default_rng(0)
    phases = np.linspace(0.0, 1.0, 20_000)
    std = 0.01 + 0.1 * np.outer(phases, np.arange(1, 7))
    mean = np.outer(np.sin(phases), np.ones(6))
    truth = mean + std * rng.standard_normal(mean.shape)
    score = accuracy(predicted(mean, std), truth)
    entropy = 0.5 * math.log(2.0 * math.pi * math.e) + np.mean(np.log(std))
    assert score["nlpd"] == pytest.approx(entropy, abs=0.01)
    for level in (50, 90, 95):
        assert score[f"coverage_{level}"] == pytest.approx(level / 100, abs=0.005)


def test_errors_are_distances_and_angles_whatever_the_chart():
    # 170 degrees and 170 degrees the other way round the same axis are 20 apart.
    mean, truth = np.zeros((5, 6)), np.zeros((5, 6))
    mean[:, :3], mean[:, 4] = [0.03, 0.0, 0.04], math.radians(170.0)
    truth[:, 4] = math.radians(-170.0)
    score = accuracy(predicted(mean, np.ones((5, 6))), truth)
    assert score["rmse_position_m"] == pytest.approx(0.05)
    assert score["rmse_rotation_rad"] == pytest.approx(math.radians(20.0))


def test_density_without_a_spread():
    """None without a std; finite for an exact prediction without spread."""
    nothing = np.zeros((9, 6))
    score = accuracy(predicted(nothing, np.full((9, 6), np.nan)), np.ones((9, 6)))
    assert score["nlpd"] is score["coverage_50"] is score["coverage_95"] is None
    assert score["rmse_position_m"] == pytest.approx(math.sqrt(3.0))
    exact = accuracy(predicted(nothing, nothing), nothing)
    assert exact["nlpd"] is not None
    assert math.isfinite(exact["nlpd"])
    assert exact["coverage_50"] == 1.0


def test_intervals_are_normal_for_every_method():
    truth = np.random.default_rng(1).standard_t(3.0, (4000, 6))
    normal = predicted(np.zeros((4000, 6)), np.ones((4000, 6)))
    student = dataclasses.replace(normal, degrees_of_freedom=3.0)
    score = accuracy(student, truth)
    assert score["coverage_95"] == student.coverage(truth, normal=True)
    assert score["coverage_95"] < 0.88


def test_spread_followed_is_one_for_a_copy_and_zero_for_one_level():
    rng = np.random.default_rng(0)
    poses = np.exp(rng.standard_normal((1, 30, 6))) * rng.standard_normal((5, 30, 6))
    spread = poses.std(axis=0, ddof=1)
    assert spread_followed(3.0 * spread, poses) == pytest.approx(1.0)
    assert spread_followed(1.0 / spread, poses) == pytest.approx(-1.0)
    assert spread_followed(np.ones((30, 6)), poses) == 0.0
    assert spread_followed(np.full((30, 6), np.nan), poses) is None
    assert spread_followed(np.ones((30, 6)), np.zeros((5, 30, 6))) is None


class Adapted:
    """An adaptation of a known movement, which via-points change in a given way."""

    def __init__(self, change: Any, movement: Known, grid: np.ndarray) -> None:
        self._change, self.grid = change, grid
        self.mean, self.std = movement.mean(grid), movement.std(grid)

    def trajectory(self) -> GaussianTrajectory:
        return predicted(self.mean, self.std, self.grid)

    def observe(self, via_point: ViaPoint) -> None:
        self._change(self, via_point)


def adapted_scores(change: Any, pose: Any, last: float = 1.0) -> dict[str, Any]:
    """Scores at a demonstration that goes from a pose to a multiple of it."""
    poses = np.linspace(1.0, last, 7)[:, None] * np.asarray(pose)
    left_out = OnPhases(phases=np.linspace(0.0, 1.0, 7), poses=poses)
    method = knowing(form=functools.partial(Adapted, change))
    return adaptation(method, Known(aligned_doors()), [left_out])


def test_via_points_are_missed_by_distance_and_angle_and_change_what_is_far():
    """Far changes are in units of the standard deviation before."""

    def passing(adapted: Adapted, via_point: ViaPoint) -> None:
        place = int(np.argmin(np.abs(adapted.grid - via_point.phase)))
        adapted.mean[place] = np.add(via_point.pose, [0.003, 0, 0.004, 0, 0.01, 0])

    def moving(adapted: Adapted, via_point: ViaPoint) -> None:
        far = np.abs(adapted.grid - via_point.phase) >= 0.2
        adapted.mean[far] += 0.5 * adapted.std[far]
        adapted.std = 0.25 * adapted.std

    exact = adapted_scores(passing, [0.1, 0.1, 0.1, 0.0, 0.1, 0.0], last=2.0)
    assert exact["via_error_position_m"] == pytest.approx(0.005)
    assert exact["via_error_strict_rotation_rad"] == pytest.approx(0.01)
    assert exact["via_far_change"] == 0.0
    assert exact["via_far_error"] == 1.0
    assert exact["cpu_adapt_s"] is not None
    shifted = adapted_scores(moving, [0.0, 0.2, 0.0, 0.0, 0.0, 0.0])
    assert shifted["via_far_change"] == pytest.approx(0.5)


@pytest.mark.parametrize(("share", "error"), [(0.5, 0.5), (1.0, 0.0), (-0.2, 1.2)])
def test_far_error_is_a_share_of_what_it_was(share, error):
    """A change everywhere may come nearer to the truth, or go farther from it."""

    def nearer(adapted: Adapted, via_point: ViaPoint) -> None:
        adapted.mean += share * (via_point.pose - adapted.mean)

    score = adapted_scores(nearer, [0.1, 0.2, -0.1, 0.0, 0.05, 0.0])
    assert score["via_far_error"] == pytest.approx(error, abs=1e-12)


def test_growth_is_the_std_beyond_over_that_at_the_end():
    def growing(times: np.ndarray) -> np.ndarray:
        # Fourfold beyond, and less within: that is no growth at the end.
        level = np.where(times > 1.0, 4.0, np.where(times < 0.9, 0.1, 1.0))
        return level[:, None] * np.ones(6)

    fold = folds(doors(), "demonstration", 0)[0]
    grown = beyond(knowing(std=growing), fold, 0)
    assert grown["uncertainty_growth"] == pytest.approx(4.0)
    held = beyond(knowing(std=lambda times: 1e-6 * ones(times)), fold, 0)
    assert held["uncertainty_growth"] == pytest.approx(1.0)
    none = beyond(knowing(std=lambda times: np.nan * ones(times)), fold, 0)
    assert none == {"uncertainty_growth": None, "prior_mean_used": 0.0}


def used_by(method: Method) -> Any:
    given = [one for door in doors() for one in door]
    plain, _ = learn(method, given, 0)
    return prior_mean_used(method, given, 0, plain)


def going(share: float, *, corrected: bool = False) -> Method:
    """Goes a share of the way to the prior mean, perhaps corrected by the average."""

    def fit(training: TrainingInput) -> Known:
        aligned, prior = align(training.demonstrations), training.prior_mean
        average = aligned.poses.mean(axis=(0, 1))

        def mean(times: np.ndarray) -> np.ndarray:
            if prior is None:
                return np.tile(average, (len(times), 1))
            error = np.mean(aligned.poses - prior.mean(aligned.times), axis=(0, 1))
            way = share * (prior.mean(times) - average)
            return average + way + (error if corrected else 0.0)

        return Known(aligned, mean)

    return Untaught(learner=Learner(fit=fit, accepts_prior_mean=True))


@pytest.mark.parametrize(
    ("share", "expected"), [(0.0, 0.0), (0.4, 0.4), (1.0, 1.0), (-0.5, 0.0), (2.0, 1.0)]
)
def test_share_of_the_way_to_the_prior_mean(share, expected):
    assert used_by(going(share)) == pytest.approx(expected, abs=1e-12)


def test_correcting_the_prior_mean_everywhere_is_not_returning_to_it():
    """A residual learned about its own average keeps that average beyond."""
    assert used_by(going(1.0, corrected=True)) < 0.9


def test_tumbling_errors_are_relative_to_the_spread_of_demonstrations():
    def tumbled(times: np.ndarray, off: float = 0.0) -> np.ndarray:
        mean = zeros(times)
        turn = Rotation.from_rotvec(off * np.ones(3))
        mean[:, 3:] = (tumbled_rotations(times) * turn).as_rotvec()
        return mean

    def spread(times: np.ndarray, scale: float = 1.0) -> np.ndarray:
        return scale * scores._spread(times)[:, None] * np.ones(6)

    known = tumbling(knowing(tumbled, spread), 0)
    assert known["tumbling_error"] == pytest.approx(0.0, abs=1e-9)
    assert known["outputs_nlpd_change"] == 0.0
    doubled = Known(aligned_doors(), tumbled, functools.partial(spread, scale=2.0))
    # ln 2 - 3/8 for a std twice too large.
    expected = math.log(2.0) - 0.375
    assert scores._excess(doubled, 0) == pytest.approx(expected, abs=0.05)
    off = tumbling(knowing(functools.partial(tumbled, off=TUMBLE_STD)), 0)
    assert off["tumbling_error"] == pytest.approx(1.0)


def small(policy: str) -> Method:
    """A method that aligns to few samples and learns in few steps."""
    chain = WishartGPConfig(steps=20, discarded=5, times=15, degrees=6)
    quick = {
        "gp-paper": functools.partial(fit_skill, noise=KerstingNoise(n_iterations=1)),
        "local-gp": functools.partial(fit_local_gp, config=LocalGPConfig(clusters=3)),
        "wishart-gp": functools.partial(fit_wishart_gp, config=chain),
    }
    method = POLICIES[policy].method
    assert method is not None
    few = functools.partial(align, n_samples=25)
    learner, pipeline = method.learner, method.pipeline
    return Method(
        learner=dataclasses.replace(learner, fit=quick.get(policy, learner.fit)),
        pipeline=dataclasses.replace(pipeline, align=few),
    )


@pytest.mark.parametrize("policy", SPACES)
def test_every_method_is_measured(policy):
    teacher = dataclasses.asdict(TEACHER)
    options = {"demonstrations_per_door": 2, "teacher": teacher, "held_out": ONE}
    metrics = method_metrics(small(policy), seed=0, **options)
    json.dumps(metrics, allow_nan=False)
    assert metrics["rmse_position_m"] < 0.3
    assert metrics["cpu_fit_s"] > 0.0
    assert metrics["nlpd"] is not None
    adapts = policy not in ("mean", "dmp", "gmr", "local-gp", "wishart-gp")
    assert (metrics["via_error_position_m"] is not None) == adapts
    used = metrics["prior_mean_used"]
    if policy in ("local-gp", "gp-paper", "gp"):
        assert used == pytest.approx(1.0, abs=1e-6)
    else:
        assert (used is not None) == (policy == "wishart-gp")


def pulling(one: Demonstration, force: float) -> Demonstration:
    """Give a demonstration a constant force along the x-axis of its hand."""
    axis = Rotation.from_rotvec(one.poses[:, 3:].copy()).apply([force, 0.0, 0.0])
    wrenches = np.hstack([axis, np.zeros_like(axis)])
    return dataclasses.replace(one, wrenches=wrenches)


def test_forces_are_predicted_and_forecast_once_they_were_felt():
    """Learned from 2, 3, 4 and 5 N: a mean of 3.5 N, of which 8 N is 4.5 N away."""
    recorded = Teacher().demonstrate_doors([0.5], 5, rng=np.random.default_rng(0))
    *given, left_out = recorded
    method = POLICIES["gp"].method
    assert method is not None
    shown = [pulling(one, 2.0 + n) for n, one in enumerate(given)]
    movement, _ = learn(method, shown, 0)
    phases = aligned_to(left_out, movement.aligned)
    found = force_scores(method, movement, phases, pulling(left_out, 8.0))
    assert found["force_error_n"] == pytest.approx(4.5, abs=0.1)
    assert found["forecast_25_force_error_n"] < 1.5
    near = force_scores(method, movement, phases, pulling(left_out, 3.5))
    assert near["force_error_n"] < 0.1
    assert near["force_coverage_95"] > 0.5
    assert near["force_nlpd"] < found["force_nlpd"]
    # Where forces were not learned, or not recorded, there is no score.
    assert force_scores(method, movement, phases, left_out) == {}
    plain, _ = learn(method, given, 0)
    assert force_scores(method, plain, phases, pulling(left_out, 8.0)) == {}
