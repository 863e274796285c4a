"""Via-points, phases beyond the demonstrations and tumbling, with known answers."""

import dataclasses
import functools
import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.studies.learning_tests import tumbling as tumbling_module
from gplfd_experiments.studies.learning_tests.extrapolation import beyond
from gplfd_experiments.studies.learning_tests.folds import OnPhases, folds
from gplfd_experiments.studies.learning_tests.tumbling import (
    TUMBLE_STD,
    tumble,
    tumbled_rotations,
    tumbling,
)
from gplfd_experiments.studies.learning_tests.via_points import GRID, adaptation
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.trajectory import (
    GaussianTrajectory,
    ViaPoint,
    white_covariance,
)
from gplfd_policies.registry.method import Method, TrainingInput

RADII = (0.35, 0.50, 0.65)
Curve = Callable[[np.ndarray], np.ndarray]


def zeros(times: np.ndarray) -> np.ndarray:
    return np.zeros((len(times), 6))


def ones(times: np.ndarray) -> np.ndarray:
    return np.ones((len(times), 6))


@dataclasses.dataclass(frozen=True)
class Known:
    """A movement of which mean and standard deviation are given functions."""

    aligned: AlignedDemonstrations
    mean: Curve = zeros
    std: Curve = ones
    duration: float = 6.0

    def predict(self, times: np.ndarray) -> GaussianTrajectory:
        return GaussianTrajectory.from_moments(
            times, self.mean(times), self.std(times), lambda: np.zeros((6, 1, 1))
        )


def demonstrated(seed: int = 0, per_door: int = 2) -> list[tuple[Demonstration, ...]]:
    recorded = Teacher().demonstrate_doors(
        RADII, per_door, rng=np.random.default_rng(seed)
    )
    return [
        recorded[first : first + per_door]
        for first in range(0, len(recorded), per_door)
    ]


@functools.cache
def aligned_doors() -> AlignedDemonstrations:
    return align([one for door in demonstrated() for one in door])


class Shifted:
    """Passes via-points at a distance; far away moves by half a std, and is surer."""

    def __init__(self, offset: np.ndarray, movement: Known, grid: np.ndarray) -> None:
        self._offset, self._grid = offset, grid
        self.mean = movement.mean(grid)
        self.std = movement.std(grid)

    def observe(self, via_point: ViaPoint) -> None:
        place = int(np.argmin(np.abs(self._grid - via_point.phase)))
        others = np.arange(len(self._grid)) != place
        near = np.abs(self._grid - via_point.phase) < 0.2
        self.mean[others & ~near] += 0.5 * self.std[others & ~near]
        self.mean[place] = via_point.pose + self._offset
        self.std = 0.25 * self.std

    def trajectory(self) -> GaussianTrajectory:
        return GaussianTrajectory.from_moments(
            self._grid,
            self.mean,
            self.std,
            functools.partial(white_covariance, self.std**2),
        )


class Untaught(Method):
    """Makes its movement from the whole training input."""

    def learn(self, training: TrainingInput) -> Any:
        return self.fit(training)


def knowing(mean: Curve = zeros, std: Curve = ones, form: Any = None) -> Method:
    """A method that learns nothing and knows the answer."""
    return Untaught(
        fit=lambda training: Known(align(training.demonstrations), mean, std),
        accepts_prior_mean=True,
        adaptation=form,
    )


def test_far_changes_are_in_units_of_the_std_before() -> None:
    offset = np.zeros(6)
    offset[[0, 4]] = 0.003, 0.01
    method = knowing(form=functools.partial(Shifted, offset))
    poses = np.zeros((7, 6))
    poses[:, 1] = 0.2
    left_out = OnPhases(phases=np.linspace(0.0, 1.0, 7), poses=poses)

    score = adaptation(method, Known(aligned_doors()), [left_out])

    assert score["via_far_change"] == pytest.approx(0.5)
    assert score["via_far_std_change"] == pytest.approx(0.75)
    assert score["rmse_rest_unadapted_position_m"] == pytest.approx(0.2)


class Obedient(Shifted):
    """Changes nothing but the place of the via-point."""

    def observe(self, via_point: ViaPoint) -> None:
        place = int(np.argmin(np.abs(self._grid - via_point.phase)))
        self.mean[place] = via_point.pose + self._offset


class Following(Shifted):
    """Goes a share of the way to a via-point, everywhere."""

    share = 0.5

    def observe(self, via_point: ViaPoint) -> None:
        self.mean[:] = self.share * via_point.pose + (1.0 - self.share) * self.mean


@pytest.mark.parametrize(("share", "error"), [(0.5, 0.5), (1.0, 0.0), (-0.2, 1.2)])
def test_far_error_is_a_share_of_what_it_was(
    share: float, error: float, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What is told everywhere may come nearer to the truth, or farther from it."""
    monkeypatch.setattr(Following, "share", share)
    method = knowing(form=functools.partial(Following, np.zeros(6)))
    poses = np.tile([0.1, 0.2, -0.1, 0.0, 0.05, 0.0], (7, 1))
    left_out = OnPhases(phases=np.linspace(0.0, 1.0, 7), poses=poses)
    score = adaptation(method, Known(aligned_doors()), [left_out])
    assert score["via_far_error"] == pytest.approx(error, abs=1e-12)


def test_via_point_errors_are_distance_and_angle() -> None:
    offset = np.array([0.003, 0.0, 0.004, 0.0, 0.01, 0.0])
    method = knowing(form=functools.partial(Obedient, offset))
    left_out = OnPhases(
        phases=np.array([0.0, 1.0]), poses=np.full((2, 6), 0.1) * [[1], [2]]
    )
    left_out.poses[:, [3, 5]] = 0.0

    score = adaptation(method, Known(aligned_doors()), [left_out])

    assert score["via_error_position_m"] == pytest.approx(0.005)
    assert score["via_error_strict_rotation_rad"] == pytest.approx(0.01)
    assert score["via_far_change"] == score["via_far_std_change"] == 0.0
    assert score["via_far_error"] == 1.0
    assert score["cpu_adapt_s"] is not None


def test_the_rest_is_what_follows_the_first_third() -> None:
    """A movement that is wrong early only has no error in the rest."""

    def early(times: np.ndarray) -> np.ndarray:
        return np.where(times[:, None] <= 0.3, 1.0, 0.0) * np.ones(6)

    movement = Known(aligned_doors(), early)
    left_out = OnPhases(phases=GRID, poses=np.zeros((len(GRID), 6)))
    score = adaptation(knowing(), movement, [left_out])
    assert score["rmse_rest_position_m"] == 0.0
    assert score["rmse_rest_unadapted_position_m"] == 0.0
    assert score["via_error_position_m"] is score["cpu_adapt_s"] is None


def test_growth_is_the_std_beyond_over_that_at_the_end() -> None:
    def growing(times: np.ndarray) -> np.ndarray:
        # Fourfold beyond, and less within: that is no growth at the end.
        level = np.where(times > 1.0, 4.0, np.where(times < 0.9, 0.1, 1.0))
        return level[:, None] * np.ones(6)

    fold = folds(demonstrated(), "demonstration", 0)[0]
    grown = beyond(knowing(std=growing), fold, 0)
    assert grown["uncertainty_growth"] == pytest.approx(4.0)
    assert grown["coverage_95_beyond"] == 1.0
    held = beyond(knowing(std=lambda times: 1e-6 * ones(times)), fold, 0)
    assert held["uncertainty_growth"] == pytest.approx(1.0)
    assert held["coverage_95_beyond"] == pytest.approx(0.0, abs=0.02)
    none = beyond(knowing(std=lambda times: np.nan * ones(times)), fold, 0)
    assert none == {
        "uncertainty_growth": None,
        "coverage_95_beyond": None,
        "prior_mean_used": 0.0,
    }


def test_beyond_is_not_learned() -> None:
    ends = []

    def learn_and_tell(training: TrainingInput) -> Known:
        ends.extend(one.poses[-1, 4] for one in training.demonstrations)
        return Known(align(training.demonstrations))

    fold = folds(demonstrated(), "demonstration", 0)[0]
    beyond(Untaught(fit=learn_and_tell, accepts_prior_mean=True), fold, 0)
    # Learned twice, without and with a prior mean.
    whole = 2 * [one.poses[-1, 4] for one in fold.given]
    np.testing.assert_allclose(ends, 0.7 * np.array(whole), rtol=0.1)


def test_tumbling_turns_by_more_than_pi_about_changing_axes() -> None:
    poses = tumble(0, range(6))[0].poses
    angle = np.linalg.norm(poses[:, 3:], axis=1)
    assert angle.max() > 1.1 * np.pi
    axes = poses[[100, -1], 3:] / angle[[100, -1], None]
    assert axes[0] @ axes[1] < 0.98
    resting = tumble(0, (0, 2))[0].poses
    np.testing.assert_array_equal(resting[:, [1, 3, 4, 5]], 0.0)
    np.testing.assert_array_equal(resting[:, [0, 2]], poses[:, [0, 2]])


def test_tumbling_of_the_truth_has_no_error_and_no_excess() -> None:
    def truth(times: np.ndarray) -> np.ndarray:
        mean = zeros(times)
        mean[:, 3:] = tumbled_rotations(times).as_rotvec()
        return mean

    def spread(times: np.ndarray) -> np.ndarray:
        return tumbling_module._spread(times)[:, None] * np.ones(6)

    known = tumbling(knowing(truth, spread), 0)
    assert known["tumbling_error"] == pytest.approx(0.0, abs=1e-9)
    assert known["outputs_nlpd"] == {"2": 0.0, "6": 0.0, "24": None}
    assert known["outputs_nlpd_change"] == 0.0

    doubled = tumbling(knowing(truth, lambda times: 2.0 * spread(times)), 0)
    # ln 2 - 3/8 for a std twice too large.
    assert doubled["outputs_nlpd"]["2"] == pytest.approx(
        math.log(2.0) - 0.375, abs=0.05
    )


def test_tumbling_error_is_in_standard_deviations_of_a_demonstration() -> None:
    def off(times: np.ndarray) -> np.ndarray:
        mean = zeros(times)
        turn = Rotation.from_rotvec(TUMBLE_STD * np.ones(3))
        mean[:, 3:] = (tumbled_rotations(times) * turn).as_rotvec()
        return mean

    assert tumbling(knowing(off), 0)["tumbling_error"] == pytest.approx(1.0)
