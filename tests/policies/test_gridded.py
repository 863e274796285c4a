"""A movement on a grid: interpolation, adaptation in place, reset."""

import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_policies import ViaPoint
from gplfd_policies.adaptation.gridded import GriddedMovement, GriddedMovements
from gplfd_policies.adaptation.process import ProcessAdaptation

pytestmark = pytest.mark.usefixtures("unchecked_types")


def test_interpolation_meets_the_movement(skill):
    movement = GriddedMovement(skill, None, 100)
    phases = np.linspace(0.0, 1.0, 777)
    exact = skill.predict(phases)
    means, stds = GriddedMovements(movement).at(phases)
    assert np.abs(means - exact.mean)[:, :3].max() < 1e-4
    assert np.abs(stds - exact.std)[:, :3].max() < 5e-4


def test_observing_changes_the_movement_and_reset_undoes_it(skill):
    movement = GriddedMovement(skill, ProcessAdaptation, 50)
    before = movement.trajectory().mean
    target = skill.predict(np.array([0.6])).mean[0] + 0.05
    movement.observe(ViaPoint(phase=0.6, pose=target))
    assert np.abs(movement.trajectory().mean - before).max() > 0.01
    movement.reset()
    assert_array_equal(movement.trajectory().mean, before)
