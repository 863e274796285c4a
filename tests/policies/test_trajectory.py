"""What a predicted distribution says about observed poses."""

from functools import partial

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.stats import norm, t

from gplfd_policies import GaussianTrajectory
from gplfd_policies.movements.trajectory import white_covariance

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
    found = distribution.coverage(poses, level, normal=True)
    assert found == pytest.approx(normal, abs=0.005)


def test_inside_is_what_lies_in_the_interval():
    distribution = predicted(0.02, 5.0)
    poses = distribution.mean + 0.05 * np.linspace(-1.0, 1.0, 300).reshape(50, 6)
    low, high = distribution.interval(0.9)
    inside = distribution.inside(poses, 0.9)
    assert_array_equal(inside, (poses >= low) & (poses <= high))
    assert inside.mean() == distribution.coverage(poses, 0.9)
    with pytest.raises(ValueError, match=r"level must be in \(0, 1\), got 1.0"):
        distribution.inside(poses, 1.0)


def test_density_is_that_of_a_normal_distribution():
    std = np.linspace(0.01, 0.1, 300).reshape(50, 6)
    distribution = predicted(std, 5.0)
    poses = distribution.mean + np.linspace(-0.1, 0.1, 600).reshape(2, 50, 6)
    expected = -norm.logpdf(poses, distribution.mean, std).mean()
    assert distribution.nlpd(poses) == pytest.approx(expected, rel=1e-12)


def test_without_a_spread_there_is_neither_coverage_nor_density():
    distribution = predicted(np.nan)
    assert np.isnan(distribution.coverage(distribution.mean))
    assert np.isnan(distribution.nlpd(distribution.mean))
    assert not distribution.inside(distribution.mean).any()


def test_nothing_is_known_more_finely_than_a_micrometre():
    distribution = predicted(0.0)
    assert distribution.coverage(distribution.mean + 1e-6) == 1.0
    assert distribution.coverage(distribution.mean + 3e-6) == 0.0
    assert np.isfinite(distribution.nlpd(distribution.mean + 3e-6))


@pytest.mark.parametrize("rows", [slice(10, None), TIMES > 0.3, np.array([4, 9])])
def test_some_of_the_times(skill, rows):
    whole = skill.predict(TIMES)
    part = whole[rows]
    for name in ("times", "mean", "std", "mean_rate", "std_rate"):
        assert_array_equal(getattr(part, name), getattr(whole, name)[rows])
    variance = np.diagonal(part.covariance, axis1=1, axis2=2).T
    assert_allclose(variance, part.std**2, rtol=1e-12)
    assert part.degrees_of_freedom == whole.degrees_of_freedom
