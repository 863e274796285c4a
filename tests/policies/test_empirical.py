"""The demonstrations' own mean and spread."""

import numpy as np
import pytest

from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import EmpiricalDistribution


def test_moments_are_those_of_the_samples(skill):
    aligned = skill.aligned
    trajectory = EmpiricalDistribution(aligned).predict(aligned.times)
    np.testing.assert_allclose(trajectory.mean, aligned.poses.mean(axis=0), atol=1e-14)
    spread = aligned.poses.std(axis=0, ddof=1)
    np.testing.assert_allclose(trajectory.std, spread, atol=1e-14)


def test_covariance_is_that_of_the_samples(skill):
    times = np.linspace(0.0, 1.0, 7)
    trajectory = EmpiricalDistribution(skill.aligned).predict(times)
    curves = np.array(
        [
            np.interp(times, skill.aligned.times, pose[:, 4])
            for pose in skill.aligned.poses
        ]
    )
    np.testing.assert_allclose(trajectory.covariance[4], np.cov(curves.T), atol=1e-14)
    np.testing.assert_allclose(
        np.einsum("omm->mo", trajectory.covariance), trajectory.std**2, atol=1e-14
    )


def test_one_demonstration_has_no_spread():
    poses = np.linspace(0.0, 1.0, 5)[None, :, None] * np.ones(6)
    aligned = AlignedDemonstrations(times=np.linspace(0.0, 1.0, 5), poses=poses)
    trajectory = EmpiricalDistribution(aligned).predict(np.array([0.1, 0.5]))
    np.testing.assert_array_equal(trajectory.std, 0.0)
    assert trajectory.mean[0, 0] == pytest.approx(0.1)
