"""The phase of an observation is told by the path, not by the clock or the radius."""

import numpy as np
import pytest

from gplfd_env.task import handle_pose_on_arc
from policies.phase import ClockPhase, PathPhase, PhaseNoise

FINAL_ANGLE = np.radians(67.0)


def follow(estimator, poses):
    return np.array([estimator.update(pose, 0.0) for pose in poses]).T


def true_phase(skill, angles):
    grid = np.linspace(0.0, 1.0, 2001)
    return np.interp(angles, skill.predict(grid).mean[:, 4], grid)


@pytest.mark.parametrize("radius", [0.30, 0.35, 0.42, 0.50, 0.60, 0.65])
def test_phase_does_not_depend_on_the_radius(skill, radius):
    angles = np.linspace(0.0, FINAL_ANGLE, 500)
    poses = [handle_pose_on_arc(radius, angle) for angle in angles]
    phase, std = follow(PathPhase(skill), poses)
    error = np.abs(phase - true_phase(skill, angles))
    opened = angles > np.radians(10.0)
    assert error[opened].max() < 0.05
    # Early on, a short way on a small door is a shorter way on a large one: the
    # estimate must know that it does not know.
    assert np.mean(error < 3.0 * std + 0.02) > 0.95


def test_clock_phase_is_the_command_s():
    clock = ClockPhase()
    clock.reset()
    assert clock.update(np.full(6, 9.0), 0.37) == (0.37, 0.0)
    np.testing.assert_array_equal(clock.rate(0.37), np.zeros(6))


def test_phase_std_is_the_size_of_the_errors(skill):
    """On doors of any demonstrated radius, with the errors that the rule expects."""
    rng, noise = np.random.default_rng(0), PhaseNoise()
    errors = np.repeat([noise.position, noise.rotation], 3)
    angle, found = 0.4, []
    for _ in range(300):
        estimator = PathPhase(skill, window=(1.0, 1.0))
        pose = handle_pose_on_arc(rng.uniform(0.35, 0.65), angle)
        found.append(estimator.update(pose + errors * rng.normal(size=6), 0.0))
    phases, stds = np.array(found).T
    actual = np.sqrt(np.mean((phases - true_phase(skill, angle)) ** 2))
    # The position counts twice, as pose and as direction: right to a factor only.
    assert 0.4 < np.median(stds) / actual < 2.5


def test_phase_stands_still_when_only_the_hand_turns(skill):
    estimator = PathPhase(skill)
    poses = np.zeros((200, 6))
    poses[:, 4] = np.linspace(0.0, 0.3, 200)
    phase, _ = follow(estimator, poses)
    assert phase.max() < true_phase(skill, 0.05)


def test_phase_follows_a_door_that_swings_back(skill):
    estimator = PathPhase(skill)
    angles = np.radians(np.concatenate([np.linspace(0, 40, 300), np.full(50, 40.0)]))
    follow(estimator, [handle_pose_on_arc(0.5, angle) for angle in angles])
    back = np.radians(np.linspace(40, 25, 200))
    phase, _ = follow(estimator, [handle_pose_on_arc(0.5, angle) for angle in back])
    assert phase[-1] == pytest.approx(true_phase(skill, back[-1]), abs=0.02)


def test_phase_is_independent_of_speed(skill):
    ends = []
    for samples in (60, 600):
        angles = np.linspace(0.0, np.radians(50.0), samples)
        poses = [handle_pose_on_arc(0.5, angle) for angle in angles]
        ends.append(follow(PathPhase(skill), poses)[0][-1])
    assert ends[0] == pytest.approx(ends[1], abs=1e-3)


def test_reset_returns_to_the_start(skill):
    estimator = PathPhase(skill)
    angles = np.linspace(0.0, 1.0, 300)
    follow(estimator, [handle_pose_on_arc(0.5, angle) for angle in angles])
    estimator.reset()
    assert estimator.update(np.zeros(6), 0.0)[0] < 0.1


def test_rate_is_the_derivative_of_the_mean(skill):
    estimator = PathPhase(skill)
    step = 1e-5
    around = skill.predict(np.array([0.5 - step, 0.5 + step])).mean
    numerical = (around[1] - around[0]) / (2 * step)
    np.testing.assert_allclose(estimator.rate(0.5), numerical, rtol=1e-5, atol=1e-6)
