"""Scores of predictions against known distributions."""

import dataclasses
import math

import numpy as np
import pytest

from gplfd_experiments.studies.learning_tests.accuracy import (
    accuracy,
    averaged,
    spread_followed,
)
from gplfd_policies.movements.trajectory import GaussianTrajectory


def predicted(mean: np.ndarray, std: np.ndarray) -> GaussianTrajectory:
    phases = np.linspace(0.0, 1.0, len(mean))
    return GaussianTrajectory.from_moments(
        phases, mean, std, lambda: np.zeros((6, 1, 1))
    )


def test_known_gaussian_has_nominal_coverage_and_its_entropy() -> None:
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
    assert score["coverage_95_stated"] is None


def test_errors_are_distances_and_angles_whatever_the_chart() -> None:
    # 170 degrees and 170 degrees the other way round the same axis are 20 apart.
    mean = np.zeros((5, 6))
    mean[:, :3], mean[:, 3:] = [0.03, 0.0, 0.04], [0.0, math.radians(170.0), 0.0]
    truth = np.zeros((5, 6))
    truth[:, 4] = math.radians(-170.0)

    score = accuracy(predicted(mean, np.ones((5, 6))), truth)

    assert score["rmse_position_m"] == pytest.approx(0.05)
    assert score["rmse_rotation_rad"] == pytest.approx(math.radians(20.0))


def test_method_without_std_has_no_density() -> None:
    score = accuracy(
        predicted(np.zeros((9, 6)), np.full((9, 6), np.nan)), np.ones((9, 6))
    )
    assert score["nlpd"] is score["coverage_50"] is score["coverage_95"] is None
    assert score["rmse_position_m"] == pytest.approx(math.sqrt(3.0))


def test_exact_prediction_without_spread_has_a_finite_density() -> None:
    nothing = np.zeros((9, 6))
    score = accuracy(predicted(nothing, nothing), nothing)
    assert score["nlpd"] is not None
    assert math.isfinite(score["nlpd"])
    assert score["coverage_50"] == 1.0


def test_stated_intervals_are_those_of_the_method() -> None:
    rng = np.random.default_rng(1)
    truth = rng.standard_t(3.0, (4000, 6))
    mean, std = np.zeros((4000, 6)), np.ones((4000, 6))
    normal = predicted(mean, std)
    student = dataclasses.replace(normal, degrees_of_freedom=3.0)

    score = accuracy(student, truth)

    assert score["coverage_95_stated"] == pytest.approx(0.95, abs=0.01)
    assert score["coverage_95"] == student.coverage(truth, normal=True)
    assert score["coverage_95"] < 0.88


def test_spread_followed_is_one_for_a_copy_and_zero_for_one_level() -> None:
    rng = np.random.default_rng(0)
    poses = np.exp(rng.standard_normal((1, 30, 6))) * rng.standard_normal((5, 30, 6))
    spread = poses.std(axis=0, ddof=1)
    assert spread_followed(3.0 * spread, poses) == pytest.approx(1.0)
    assert spread_followed(1.0 / spread, poses) == pytest.approx(-1.0)
    assert spread_followed(np.ones((30, 6)), poses) == 0.0
    assert spread_followed(np.full((30, 6), np.nan), poses) is None
    assert spread_followed(np.ones((30, 6)), np.zeros((5, 30, 6))) is None


def test_errors_average_as_squares_and_missing_numbers_do_not_count() -> None:
    scores = [{"rmse_x": 3.0, "nlpd": 1.0, "none": None}, {"rmse_x": 4.0, "nlpd": None}]
    scores[1]["none"] = None
    assert averaged(scores) == {
        "rmse_x": pytest.approx(math.sqrt(12.5)),
        "nlpd": 1.0,
        "none": None,
    }
