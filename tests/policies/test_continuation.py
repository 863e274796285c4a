"""Where demonstrations end, the motion goes on as it was going."""

from dataclasses import replace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import AlignedDemonstrations, PosePath, ViaPoint, fit_skill
from gplfd_policies.adaptation.gridded import GriddedMovement, GriddedMovements
from gplfd_policies.adaptation.process import ProcessAdaptation
from gplfd_policies.demonstrations.aligned import carried_on, continued
from gplfd_policies.movements.movement import EmpiricalDistribution
from gplfd_policies.movements.prior_mean import ResidualMovement

PHASES = np.linspace(0.0, 1.0, 200)


def arc(radius, angle):
    """A hinge's arc, slow at both ends."""
    gentle = PHASES**2 * (3.0 - 2.0 * PHASES)
    return np.array([handle_pose_on_arc(radius, angle * share) for share in gentle])


def drawer():
    path = np.zeros((200, 6))
    path[:, 0] = 0.4 * PHASES
    path[:, 3:] = (0.3, -0.2, 0.1)
    return path


def aligned(*poses):
    return AlignedDemonstrations(times=PHASES, poses=np.stack(poses), duration=6.0)


@pytest.fixture(scope="module")
def skill():
    """Learned from demonstrations of four doors that were continued."""
    rng = np.random.default_rng(0)
    radii = 0.4, 0.5, 0.55, 0.6
    poses = [arc(r, 0.8) + rng.normal(0.0, 1e-3, (200, 6)) for r in radii]
    return fit_skill(continued(aligned(*poses), 0.5))


@pytest.mark.parametrize("radius", [0.3, 0.65])
def test_an_arc_goes_on_along_its_circle(radius):
    shares = np.array([0.1, 0.3, 0.5])
    on = carried_on(arc(radius, 0.8), shares)
    true = [handle_pose_on_arc(radius, 0.8 * (1.0 + share)) for share in shares]
    assert_allclose(on, true, atol=2e-4)


def test_a_straight_pull_goes_on_straight_without_turning():
    on = carried_on(drawer(), np.array([0.25, 0.5]))
    expected = [[0.5, 0.0, 0.0, 0.3, -0.2, 0.1], [0.6, 0.0, 0.0, 0.3, -0.2, 0.1]]
    assert_allclose(on, expected, atol=1e-9)


def test_a_screw_about_any_axis_goes_on():
    axis = np.array([1.0, 2.0, -1.0]) / np.sqrt(6.0)
    turns = Rotation.from_rotvec(axis * 0.9 * np.linspace(0.0, 1.5, 301)[:, None])
    shift = 0.2 * np.linspace(0.0, 1.5, 301)[:, None] * axis
    positions = turns.apply([0.3, -0.1, 0.2]) + shift
    path = np.hstack([positions, turns.as_rotvec()])
    on = carried_on(path[:201], np.array([0.25, 0.5]))
    assert_allclose(on, path[[250, 300]], atol=1e-4)


def test_the_demonstrated_part_stays_what_it_was():
    short = aligned(arc(0.4, 0.8), arc(0.6, 0.8))
    longer = continued(short, 0.5)
    assert longer.times[-1] == 1.0
    assert longer.duration * longer.end == pytest.approx(6.0)
    again = longer.demonstrated
    assert short.demonstrated is short
    assert again.end == 1.0
    assert again.duration == pytest.approx(6.0)
    before = np.linspace(0.0, 1.0, 50)
    for path, other in zip(short.poses, longer.poses, strict=True):
        for first, second in zip(path.T, other.T, strict=True):
            again = np.interp(before * longer.end, longer.times, second)
            assert_allclose(again, np.interp(before, short.times, first), atol=3e-4)


def test_drift_is_nothing_for_arcs_and_what_it_is_for_a_bent_path():
    arcs = continued(aligned(arc(0.4, 0.9), arc(0.6, 0.9)), 0.5)
    assert (arcs.drift * arcs.end).max() < 5e-3
    # A straight line that is bent at the end goes elsewhere than it was going.
    bent = drawer()
    bent[140:, 2] = 0.5 * (bent[140:, 0] - bent[140, 0])
    # A continued task has it per phase of its own.
    longer, longest = (continued(aligned(bent), beyond) for beyond in (0.5, 1.0))
    error = longer.drift * longer.end
    assert error[2] > 0.05
    assert_allclose(longest.drift * longest.end, error)


def test_sigma_grows_beyond_the_demonstrations_by_the_drift(skill):
    longer = skill.aligned
    gridded = GriddedMovement(skill, ProcessAdaptation, 100)
    phases = np.linspace(0.0, 1.0, 100)
    plain = skill.predict(phases).std
    measured = GriddedMovements(gridded).at(phases)[:, 6:12]
    beyond = np.maximum(phases - longer.end, 0.0)[:, None] * longer.drift
    assert_allclose(measured, np.hypot(plain, beyond), rtol=5e-3)
    assert beyond[-1].max() > 1e-3


def test_sigma_has_a_rate_where_all_demonstrations_agree():
    longer = continued(aligned(arc(0.4, 0.8), arc(0.5, 0.8)), 0.5)
    assert longer.drift.any()
    mean = EmpiricalDistribution(aligned=longer)
    path = GriddedMovement(mean, None, 200).trajectory()
    assert (path.std[0] == 0.0).all()
    assert_allclose(path.std_rate, np.gradient(path.std, path.times, axis=0), atol=1e-2)


def test_a_prior_mean_is_stretched_over_the_longer_task():
    path = PosePath(phases=PHASES, poses=arc(0.4, 0.8))
    longer = replace(aligned(arc(0.4, 0.8)), end=1.0 / 1.6)
    mean = EmpiricalDistribution(aligned=longer)
    movement = ResidualMovement(aligned=longer, prior_mean=path, residual=mean)
    at, step = np.array([0.1, 0.4, 0.6]), 1e-6
    assert_array_equal(movement.expected(at), path.mean(1.6 * at))
    rest = movement.residual.predict(at)
    difference = movement.expected(at + step) - movement.expected(at - step)
    rate = movement.predict(at).mean_rate - rest.mean_rate
    assert_allclose(rate, difference / (2.0 * step), atol=1e-6)


def test_what_was_seen_beyond_the_demonstrations_is_known(skill):
    gridded = GriddedMovement(skill, ProcessAdaptation, 100)
    seen = ViaPoint(phase=0.8, pose=skill.predict(np.array([0.8])).mean[0])
    before = gridded.distribution.std.copy()
    GriddedMovements(gridded).observe([0], [seen])
    grid = np.linspace(0.0, 1.0, 100)
    expected = np.maximum(grid - 0.8, 0.0)[:, None] * skill.aligned.drift
    assert_allclose(gridded.drift, expected)
    gridded.reset()
    assert gridded.drift[70].max() > 0.0
    assert_array_equal(gridded.distribution.std, before)
