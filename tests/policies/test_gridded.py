"""A movement on a grid: interpolation, adaptation in place, reset."""

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_policies import ViaPoint, adapt
from gplfd_policies.adaptation import OwnAdaptation, ProcessAdaptation
from gplfd_policies.adaptation.gridded import GriddedMovement

pytestmark = pytest.mark.usefixtures("unchecked_types")


def test_interpolation_meets_the_movement(skill):
    movement = GriddedMovement(skill, None, 100)
    phases = np.linspace(0.0, 1.0, 777)
    exact = skill.predict(phases)
    means, stds = (
        np.stack(rows) for rows in zip(*(movement.at(p) for p in phases), strict=True)
    )
    assert np.abs(means - exact.mean)[:, :3].max() < 1e-4
    assert np.abs(stds - exact.std)[:, :3].max() < 5e-4


def test_observing_changes_the_movement_and_reset_undoes_it(skill):
    movement = GriddedMovement(skill, ProcessAdaptation, 50)
    before = movement.at(0.7)[0]
    target = skill.predict(np.array([0.6])).mean[0] + 0.05
    movement.observe(ViaPoint(phase=0.6, pose=target))
    assert np.abs(movement.at(0.7)[0] - before).max() > 0.01
    movement.reset()
    assert_array_equal(movement.at(0.7)[0], before)


def test_a_grid_of_one_point_is_refused(skill):
    with pytest.raises(ValueError, match="n_grid must be at least 2, got 1"):
        GriddedMovement(skill, None, 1)


def test_any_movement_that_adapts_can_be_gridded(skill):
    """Readapted to all via-points at once, it is what online adaptation makes of it."""
    via_points = [
        ViaPoint(phase=phase, pose=skill.predict(np.array([phase])).mean[0] + 0.02)
        for phase in (0.2, 0.4)
    ]

    class Readapted:
        aligned, duration, predict = skill.aligned, skill.duration, skill.predict

        def adapt(self, via_points):
            return adapt(skill, via_points, "process")

    movements = [
        GriddedMovement(Readapted(), OwnAdaptation, 50),
        GriddedMovement(skill, ProcessAdaptation, 50),
    ]
    for movement in movements:
        for via_point in via_points:
            movement.observe(via_point)
    readapted, online = (np.stack(movement.at(0.7)) for movement in movements)
    assert_allclose(readapted, online, atol=1e-12)
