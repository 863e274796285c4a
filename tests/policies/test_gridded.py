"""A policy on a grid: interpolation, adaptation in place, reset."""

import numpy as np
import pytest

from policies.adaptation import ProcessAdaptation
from policies.gridded import Demonstrated, GriddedPolicy
from policies.trajectory import ViaPoint


def test_interpolation_meets_the_policy(skill):
    policy = GriddedPolicy(skill, Demonstrated, 100)
    phases = np.linspace(0.0, 1.0, 777)
    exact = skill.predict(phases)
    means, stds = (
        np.stack(rows) for rows in zip(*(policy.at(p) for p in phases), strict=True)
    )
    assert np.abs(means - exact.mean)[:, :3].max() < 1e-4
    assert np.abs(stds - exact.std)[:, :3].max() < 5e-4


def test_grid_points_are_met_exactly(skill):
    policy = GriddedPolicy(skill, Demonstrated, 11)
    exact = skill.predict(np.linspace(0.0, 1.0, 11))
    for index in (0, 5, 10):
        np.testing.assert_allclose(policy.at(index / 10)[0], exact.mean[index])


def test_observing_changes_the_policy_and_reset_undoes_it(skill):
    policy = GriddedPolicy(skill, ProcessAdaptation, 50)
    before = policy.at(0.7)[0]
    target = skill.predict(np.array([0.6])).mean[0] + 0.05
    policy.observe(ViaPoint(phase=0.6, pose=target))
    assert np.abs(policy.at(0.7)[0] - before).max() > 0.01
    policy.reset()
    np.testing.assert_array_equal(policy.at(0.7)[0], before)


def test_answers_may_be_changed_by_the_caller(skill):
    policy = GriddedPolicy(skill, Demonstrated, 50)
    mean, _ = policy.at(0.5)
    mean += 1.0
    assert np.abs(policy.at(0.5)[0] - mean).max() > 0.5


def test_a_grid_of_one_point_is_refused(skill):
    with pytest.raises(ValueError, match="n_grid must be at least 2, got 1"):
        GriddedPolicy(skill, Demonstrated, 1)
