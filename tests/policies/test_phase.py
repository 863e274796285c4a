"""The phase of an observation is told by the path, not by the clock or the radius."""

import numpy as np
import pytest
from numpy.testing import assert_allclose

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies.demonstrations.path_similarity import (
    SimilarityConfig,
    SimilarityModel,
    normalised,
    posteriors,
    updated,
)
from gplfd_policies.phase.phase_rule import PathPhase, PathPhaseConfig

pytestmark = pytest.mark.slow

FINAL_ANGLE = np.radians(67.0)
PRIOR = SimilarityConfig().heading_std
TRUSTING = PathPhaseConfig(similarity=SimilarityConfig(heading_std=0.0))
NOWHERE = np.float64(0.0)


def follow(skill, poses, config=None, rule=None, start=NOWHERE):
    """Phases, standard deviations and misfits along a path, each from the last."""
    rule = rule or PathPhase(skill, config or PathPhaseConfig())
    phases, previous = [], start
    for pose in poses:
        seen = rule.update(pose, previous, NOWHERE)
        previous = seen.phase
        phases.append((seen.phase, seen.std, seen.misfit))
    return np.array(phases).T


def estimate(skill, pose, previous=NOWHERE, **config):
    rule = PathPhase(skill, PathPhaseConfig(**config))
    return rule.update(pose, np.float64(previous), NOWHERE)


def true_phase(skill, angles):
    grid = np.linspace(0.0, 1.0, 2001)
    return np.interp(angles, skill.predict(grid).mean[:, 4], grid)


def turned(poses, yaw):
    """A motion as seen by a robot whose heading is off, about the vertical y axis."""
    x, z = poses[:, 0].copy(), poses[:, 2].copy()
    seen = poses.copy()
    seen[:, 0] = np.cos(yaw) * x + np.sin(yaw) * z
    seen[:, 2] = np.cos(yaw) * z - np.sin(yaw) * x
    return seen


def test_phase_std_is_the_size_of_the_errors(skill):
    """On doors of any demonstrated radius, with the errors that the rule expects."""
    rng, config = np.random.default_rng(0), PathPhaseConfig()
    errors = np.repeat([config.position_noise, config.rotation_noise], 3)
    rule = PathPhase(skill, PathPhaseConfig(window=(1.0, 1.0)))
    angle, estimates = 0.4, []
    for _ in range(300):
        pose = handle_pose_on_arc(rng.uniform(0.35, 0.65), np.array([angle]))
        seen = turned(pose, PRIOR * rng.normal()) + errors * rng.normal(size=6)
        rule.reset()
        estimates.append(follow(skill, seen, rule=rule)[:2, 0])
    phases, stds = np.array(estimates).T
    actual = np.sqrt(np.mean((phases - true_phase(skill, angle)) ** 2))
    assert 0.8 < np.median(stds) / actual < 1.25


def test_phase_stands_still_when_only_the_hand_turns(skill):
    poses = np.zeros((200, 6))
    poses[:, 4] = np.linspace(0.0, 0.3, 200)
    assert follow(skill, poses)[0].max() < true_phase(skill, 0.05)


def test_a_phase_that_is_stuck_is_freed(skill):
    """Far behind the hand, nothing near fits, and it is searched everywhere."""
    pose = handle_pose_on_arc(0.5, 1.0)
    freed = estimate(skill, pose)
    assert freed.phase == pytest.approx(true_phase(skill, 1.0), abs=0.03)
    assert freed.misfit < 1.0
    for stubborn in ({"lost_misfit": 1e3}, {"clearer_share": 0.0}):
        assert estimate(skill, pose, **stubborn).phase < 0.1


def test_misfit_makes_the_phase_unsure(skill):
    """A hand that has been lifted off the path fits nothing, wherever it is."""
    pose, place = handle_pose_on_arc(0.5, 0.8), true_phase(skill, 0.8)
    usual = estimate(skill, pose, place)
    assert usual.misfit < 1.0
    lifted = pose + np.array([0.0, 0.2, 0.0, 0.6, 0.0, 0.6])
    strange = estimate(skill, lifted, place)
    assert strange.misfit > 2.0
    assert strange.std > 1.5 * usual.std
    assert estimate(skill, pose, place, least_std=0.07).std == 0.07
    assert estimate(skill, lifted, place, largest_std=0.01).std == 0.01


def nearest_by_hand(skill, pose, previous):
    """The search as its definition reads, one row, one size, one point at a time."""
    grid, config = np.linspace(0.0, 1.0, 201), TRUSTING
    demonstrated = skill.predict(grid)
    poses = normalised(skill.aligned)[0].poses
    curves = [[np.interp(grid, skill.aligned.times, c) for c in p.T] for p in poses]
    positions = np.array(curves)[:, :3]
    mean = positions.mean(axis=0)
    length = np.linalg.norm(mean, axis=0)
    unit = mean / np.maximum(length, 1e-3)
    variance = (positions[:, 1].std(axis=0) / np.maximum(length, 1e-3)) ** 2
    variance += (1e-3 / np.maximum(length, 1e-3)) ** 2
    stretch = np.einsum("kig,ig->kg", positions, unit).std(axis=0)
    x, z = pose[[0, 2]]
    reach = np.linalg.norm(pose[:3]) + 1e-9
    similarity = SimilarityModel.of(skill.aligned, config.similarity).prior()
    if (distance := np.hypot(x, z)) >= similarity.due:
        (similarity,) = updated([similarity], [(distance, np.arctan2(-z, x))])
    (posterior,) = posteriors([similarity])
    _, _, size_variance, cosine, sine, angle_variance = posterior.features[:6]

    def cost(index):
        centre, std = demonstrated.mean[index], demonstrated.std[index]
        turned_by = (centre[3:] - pose[3:]) ** 2 / (
            std[3:] ** 2 + config.rotation_noise**2
        )
        share = np.hypot(config.distance_share, np.sqrt(size_variance[0]))
        spread = config.position_noise**2 + (share * length[index]) ** 2
        spread += stretch[index] ** 2
        total = 0.0
        for number, weight in enumerate(posterior.weights):
            far = reach - np.exp(posterior.log_sizes[number]) * length[index]
            angle = np.arctan2(sine[number], cosine[number])
            back = turned(pose[None], -angle)[0, :3] / reach
            aside = np.sum((unit[:, index] - back) ** 2)
            blur = (config.position_noise / reach) ** 2 + angle_variance[number]
            squares = far**2 / spread + aside / (variance[index] + blur)
            total += weight * np.exp(-0.5 * squares)
        return turned_by.sum() - 2.0 * np.log(max(total, 1e-300))

    first = max(0, int(np.floor((previous - 0.02) * 200)) - 1)
    last = min(200, int(np.ceil((previous + 0.05) * 200)) + 1)
    costs = [cost(index) for index in range(first, last + 1)]
    best = int(np.argmin(costs))
    if best in (0, len(costs) - 1):
        return grid[first + best]
    before, here, after = costs[best - 1 : best + 2]
    bend = before - 2.0 * here + after
    return grid[first + best] + 0.5 * (before - after) / bend / 200


@pytest.mark.parametrize("previous", [0.0, 0.0123, 0.3071, 0.7513, 0.9987, 1.0])
def test_search_is_the_one_that_is_defined(skill, previous):
    estimator = PathPhase(skill, TRUSTING)
    rng = np.random.default_rng(0)
    for _ in range(20):
        estimator.reset()
        place = np.clip(previous + rng.uniform(-0.06, 0.06), 0.0, 1.0)
        angle = skill.predict(place[None]).mean[0, 4]
        pose = handle_pose_on_arc(0.45, angle) + 1e-3 * rng.normal(size=6)
        estimated = estimator.update(pose, np.float64(previous), NOWHERE)
        expected = nearest_by_hand(skill, pose, previous)
        assert float(estimated.phase) == pytest.approx(expected, abs=1e-9)


def test_rate_is_the_derivative_of_the_mean(skill):
    estimator, step = PathPhase(skill), 1e-5
    around = skill.predict(np.array([0.5 - step, 0.5 + step])).mean
    numerical = (around[1] - around[0]) / (2 * step)
    assert_allclose(estimator.rate(np.float64(0.5)), numerical, rtol=1e-5, atol=1e-6)


@pytest.mark.parametrize("radius", [0.35, 0.65])
@pytest.mark.parametrize("yaw", np.radians([-5.0, 5.0]))
def test_phase_does_not_depend_on_the_heading(skill, radius, yaw):
    angles = np.linspace(0.0, FINAL_ANGLE, 500)
    poses = handle_pose_on_arc(radius, angles)
    straight = follow(skill, poses)[0]
    askew, std, _ = follow(skill, turned(poses, yaw))
    misled = follow(skill, turned(poses, yaw), TRUSTING)[0]
    opened = (angles > np.radians(20.0)) & (angles < np.radians(62.0))
    error = np.abs(askew - straight)[opened]
    assert error.max() < 0.06
    assert error.max() < 0.5 * np.abs(misled - straight)[opened].max()
    assert (np.abs(askew - true_phase(skill, angles)) < 3.0 * std)[opened].all()
