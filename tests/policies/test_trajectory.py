"""A predicted distribution: what it says about observed poses, and its table."""

import csv
from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation
from scipy.stats import norm, t

from gplfd_policies import GaussianTrajectory
from gplfd_policies.movements.movement import CSV_COLUMNS, white_covariance

TIMES = np.linspace(0.0, 1.0, 50)


def predicted(std, degrees_of_freedom=None):
    mean = np.sin(np.outer(TIMES, np.arange(1.0, 7.0)))
    std = np.broadcast_to(std, mean.shape)
    return GaussianTrajectory(
        times=TIMES,
        mean=mean,
        std=std,
        mean_rate=mean,
        std_rate=std,
        covariance_function=partial(white_covariance, std**2),
        degrees_of_freedom=degrees_of_freedom,
    )


@pytest.mark.parametrize("level", [0.5, 0.9, 0.95])
def test_coverage_is_the_level_where_the_distribution_is_right(level):
    free = 5.0
    repetitions = t.rvs(free, size=(400, 50, 6), random_state=0)
    distribution = predicted(0.02, free)
    poses = distribution.mean + 0.02 * repetitions
    # Three standard errors of a share of 120,000 numbers.
    assert distribution.coverage(poses, level) == pytest.approx(level, abs=0.005)
    normal = 2.0 * t.cdf(norm.ppf(0.5 + 0.5 * level), free) - 1.0
    coverage = distribution.coverage(poses, level, normal=True)
    assert coverage == pytest.approx(normal, abs=0.005)


def test_density_is_that_of_a_normal_distribution():
    std = np.linspace(0.01, 0.1, 300).reshape(50, 6)
    distribution = predicted(std, 5.0)
    poses = distribution.mean + np.linspace(-0.1, 0.1, 600).reshape(2, 50, 6)
    expected = -norm.logpdf(poses, distribution.mean, std).mean()
    assert distribution.nlpd(poses) == pytest.approx(expected, rel=1e-12)


def test_nothing_is_known_more_finely_than_a_micrometre():
    distribution = predicted(0.0)
    assert distribution.coverage(distribution.mean + 1e-6) == 1.0
    assert distribution.coverage(distribution.mean + 3e-6) == 0.0
    assert np.isfinite(distribution.nlpd(distribution.mean + 3e-6))


# --- As a table ---------------------------------------------------------------


def table(path):
    with path.open(encoding="utf-8") as file:
        rows = list(csv.reader(line for line in file if not line.startswith("#")))
    assert ",".join(rows[0]) == CSV_COLUMNS
    return np.array(rows[1:], dtype=np.float64)


def test_rows_are_the_predicted_poses_at_their_times(skill, tmp_path):
    trajectory = skill.predict(TIMES)
    trajectory.to_csv(tmp_path / "new" / "a.csv", duration=8.0)
    written = table(tmp_path / "new" / "a.csv")
    assert_array_equal(written[:, 0], 8.0 * TIMES)
    assert_array_equal(written[:, 1:4], trajectory.mean[:, :3])
    assert_array_equal(written[:, 8:], trajectory.std)
    expected = Rotation.from_rotvec(trajectory.mean[:, 3:].copy())
    apart = (Rotation.from_quat(written[:, 4:8]) * expected.inv()).magnitude()
    assert_allclose(apart, 0.0, atol=1e-15)


def test_what_is_no_table_is_refused(skill, tmp_path):
    good, path = skill.predict(TIMES), tmp_path / "a.csv"
    with pytest.raises(ValueError, match="duration must be positive and finite"):
        good.to_csv(path, duration=np.nan)
    with pytest.raises(ValueError, match="times of a table must increase strictly"):
        skill.predict(TIMES[::-1]).to_csv(path, duration=8.0)
    lost = replace(good, mean=np.full((50, 6), np.nan))
    with pytest.raises(ValueError, match="poses of a table must be finite"):
        lost.to_csv(path, duration=8.0)
    assert list(tmp_path.iterdir()) == []
