"""The compliant agent: movement, adaptation, stiffness and admittance together."""

import dataclasses
from types import SimpleNamespace

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies.adaptation.gridded import LOOK_AHEAD, GriddedMovement
from gplfd_policies.adaptation.process import ProcessAdaptation
from gplfd_policies.agents.agent import CompliantAgent
from gplfd_policies.arrays.rows import ALL_ROWS
from gplfd_policies.control.compliance import ComplianceConfig
from gplfd_policies.control.load import CarriedLoad
from gplfd_policies.control.steps import STEP_SHAPES
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.phase.phase_rule import (
    POSE_ERROR,
    ClockPhase,
    PathPhase,
    PhaseEstimate,
)

pytestmark = pytest.mark.slow

PERIOD = 0.01
AT_REST = np.zeros(6)


def agent_of(skill, form=ProcessAdaptation, **config):
    return CompliantAgent(
        movement=GriddedMovement(skill, form, 100),
        phases=PathPhase(skill),
        config=ComplianceConfig(load=CarriedLoad(limit=20.0), **config),
    )


def observed(pose, force=(0.0, 0.0, 0.0)):
    return {"ee_pose": np.array(pose), "wrench": np.array([*force, 0.0, 0.0, 0.0])}


def held_still(agent, steps, pose=AT_REST, force=(0.0, 0.0, 0.0)):
    """Steps of an agent whose hand stays where it is, under a constant force."""
    agent.reset(observed(pose))
    return [agent.act(observed(pose, force)) for _ in range(steps)]


def ideal_door(agent, radius, steps):
    """A weightless door: the handle goes to the point of its arc nearest the command.

    The hand feels a spring of 2000 N/m across the arc. Returns steps and door angles.
    """
    angle, force, taken, angles = 0.0, np.zeros(3), [], []
    agent.reset(observed(AT_REST))
    for _ in range(steps):
        step = agent.act(observed(handle_pose_on_arc(radius, angle), force))
        x, _, z = step.action[:3]
        angle = max(0.0, np.arctan2(x, z + radius))
        handle = handle_pose_on_arc(radius, angle)[:3]
        force = 2000.0 * (handle - step.action[:3])
        taken.append(step)
        angles.append(angle)
    return taken, np.array(angles)


def stacked(steps, name):
    return np.array([getattr(step, name) for step in steps])


@pytest.mark.parametrize("radius", [0.35, 0.65])
def test_adaptation_finds_the_radius_of_an_ideal_door(skill, radius):
    agent = agent_of(skill)
    _, angles = ideal_door(agent, radius, 700)
    assert angles[-1] > np.radians(62.0)
    end = agent.forecast().mean[-1]
    expected = handle_pose_on_arc(radius, end[4])
    assert_allclose(end[[0, 2]], expected[[0, 2]], atol=0.03)


@pytest.mark.parametrize("radius", [0.35, 0.65])
def test_rendered_stiffness_keeps_the_stability_bound(skill, radius, monkeypatch):
    """Recomputed from K alone, by condition (2), not from what the governor reports."""
    monkeypatch.setattr("gplfd_policies.control.compliance._STD_TIMES", (0.0, 0.0))
    steps, _ = ideal_door(agent_of(skill, via_spacing=0.2), radius, 450)
    frames, gamma = stacked(steps, "frame"), 70.0

    def excess(stiffness):
        k = frames * stiffness[:, None, :3] @ np.swapaxes(frames, 1, 2)
        # The damping is the same at every stiffness of the profile.
        change = np.diff(k, axis=0) - 2.0 * gamma * PERIOD * k[:-1]
        return np.linalg.eigvalsh(change).max()

    assert excess(stacked(steps, "stiffness")) < 0.0
    # Ungoverned it would be crossed: rare via-points drop the uncertainty at once.
    assert excess(DEFAULT_PROFILE.stiffness(stacked(steps, "std"), frames)) > 0.0


def test_an_episode_begins_as_the_first_whatever_was_before(skill):
    agent = agent_of(skill)
    first, _ = ideal_door(agent, 0.5, 60)
    again, _ = ideal_door(agent, 0.5, 60)
    assert_array_equal(stacked(again, "stiffness"), stacked(first, "stiffness"))
    assert_array_equal(stacked(again, "std"), stacked(first, "std"))


def test_via_points_change_uncertainty_and_stiffness_in_small_steps(skill):
    steps, _ = ideal_door(agent_of(skill), 0.5, 400)
    moving = stacked(steps, "observed_phase") > 0.03
    changes = np.diff(stacked(steps, "stiffness")[moving, :3], axis=0)
    assert sum(step.via_point for step in steps) > 40
    assert np.abs(changes).max() < 10.0


def test_fig10_compliance_towards_the_hinge_rises_to_the_end(skill):
    """Without adaptation, towards the hinge as it is at the closed door."""
    agent = agent_of(skill, None, stiffness_frame="axes")
    steps, angles = ideal_door(agent, 0.5, round(skill.duration / PERIOD))
    stiffness = stacked(steps, "stiffness")[:, 2]
    thirds = [
        stiffness[(angles > low) & (angles <= low + 0.35)].mean()
        for low in (0.0, 0.35, 0.7)
    ]
    assert thirds[0] > thirds[1] > thirds[2]


def test_via_point_shifts_the_clock_by_no_more_than_the_path_it_looks_at(
    skill, monkeypatch
):
    """Where the path is slow, a jump of 3 cm back would be nearly the whole task."""
    agent = agent_of(skill)
    agent.reset(observed(AT_REST))
    learned = agent.movement.distribution
    back = SimpleNamespace(mean=learned.mean - 0.03 * np.eye(6)[0], std=learned.std)
    back.observe = lambda _: monkeypatch.setattr(agent.movement, "distribution", back)
    monkeypatch.setattr(agent.movement, "adapted_at", lambda _: back)
    poses = [handle_pose_on_arc(0.5, angle) for angle in np.linspace(0.0, 0.3, 20)]
    steps = [agent.act(observed(pose)) for pose in poses]
    change = np.diff(stacked(steps, "phase")) - PERIOD / skill.duration
    assert change.max() == pytest.approx(LOOK_AHEAD)


def test_via_points_share_what_the_phase_leaves_open(skill, monkeypatch):
    agent, seen = agent_of(skill), []
    watching = SimpleNamespace(observe=seen.append)
    monkeypatch.setattr(agent.movement, "adapted_at", lambda _: watching)
    agent.reset(observed(AT_REST))
    rates = []
    for angle in np.linspace(0.0, 0.8, 200):
        pose = handle_pose_on_arc(0.5, angle)
        if agent.act(observed(pose)).via_point:
            rates.append(agent.phases.rate(np.float64(seen[-1].phase)))
    assert len(seen) > 10
    for via_point, rate in zip(seen, rates, strict=True):
        assert_array_equal(via_point.std, np.repeat(POSE_ERROR, 3))
        # Along the path, by one standard deviation of the phase.
        std = np.linalg.norm(via_point.along) / np.linalg.norm(rate)
        assert std > 0.0
        assert_allclose(via_point.along, std * rate, rtol=1e-9)


def test_lag_does_not_slow_the_clock_down(skill):
    # The hand stands still, without a force: the command must go on all the same.
    steps = held_still(agent_of(skill), 300)
    expected = 300 * PERIOD / skill.duration
    assert steps[-1].phase == pytest.approx(expected, rel=1e-6)


def test_force_across_the_path_is_yielded_to(skill):
    step = held_still(agent_of(skill, None), 100, force=(0.0, 5.0, 0.0))[-1]
    expected = 5.0 / step.stiffness[1]
    assert step.action[1] - step.desired[1] == pytest.approx(expected, rel=0.05)


def test_a_hand_that_is_held_becomes_soft(skill):
    """Held against the pull: σ along the path grows by the lag, the clock waits."""
    agent = dataclasses.replace(agent_of(skill), config=ComplianceConfig())
    step = held_still(agent, 1)[0]
    assert step.stiffness[0] > 450.0
    for _ in range(1500):
        force = -2000.0 * step.action[0]
        step = agent.act(observed(AT_REST, force=(force, 0.0, 0.0)))
    assert force == pytest.approx(-13.0, abs=0.5)
    assert step.stiffness[0] == pytest.approx(100.0, abs=1.0)
    assert step.path_lag == pytest.approx(0.03, abs=2e-3)
    assert step.std[0] >= 0.99 * step.path_lag
    freed = [agent.act(observed(AT_REST)) for _ in range(200)]
    assert freed[-1].path_lag < 5e-3
    assert stacked(freed, "stability_margin")[:, 0].min() > 0.0


@pytest.mark.parametrize(
    ("config", "expected"),
    [
        ({}, [True, True, True, True, False, True, False]),
        ({"phase_drop": 0.6}, [True, True, True, False, False, False, False]),
    ],
)
def test_via_points_are_taken_again_after_a_phase_that_was_wrong(
    skill, config, expected
):
    told = iter([0.1, 0.2, 0.7, 0.21, 0.22, 0.25, 0.24])

    class Told(ClockPhase):
        def update(self, poses, previous, command, rows=ALL_ROWS):
            nothing = np.zeros_like(command)
            return PhaseEstimate(np.full_like(command, next(told)), nothing, nothing)

    agent = agent_of(skill, via_spacing=0.02, **config)
    steps = held_still(dataclasses.replace(agent, phases=Told()), 7)
    assert [bool(step.via_point) for step in steps] == expected


SIX = r"observation\['{}'\] must be six finite numbers \[{}\], got"
UNUSABLE = [
    ({"wrench": [0.0, 0.0, np.nan, 0.0, 0.0, 0.0]}, SIX.format("wrench", "N, N m")),
    ({"wrench": "none"}, SIX.format("wrench", "N, N m")),
    ({"ee_pose": np.zeros((1, 6))}, SIX.format("ee_pose", "m, rad")),
]


def test_unusable_observation_is_refused_and_changes_nothing(skill):
    agent, undisturbed = agent_of(skill), agent_of(skill)
    pose = handle_pose_on_arc(0.42, 0.1)
    held_still(agent, 3, pose), held_still(undisturbed, 3, pose)
    for wrong, message in UNUSABLE:
        with pytest.raises(ValueError, match=message):
            agent.act(observed(pose) | wrong)
    for wrong in (np.zeros(6), {"ee_pose": pose}):
        with pytest.raises(ValueError, match=r"a mapping with '(ee_pose|wrench)'"):
            agent.act(wrong)
    step, expected = agent.act(observed(pose)), undisturbed.act(observed(pose))
    for name in STEP_SHAPES:
        assert_array_equal(getattr(step, name), getattr(expected, name))
