"""The models of a mechanism, the choice among them, and what is opened with them."""

import functools
import math

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_allclose
from scipy import integrate, optimize, stats
from scipy.spatial.transform import Rotation

from gplfd_env import DoorGeometry
from gplfd_policies import make_agent
from gplfd_policies.agents.model_based import mechanism
from gplfd_policies.agents.model_based.following import UPRIGHT
from gplfd_policies.agents.model_based.mechanism import (
    GaussianProcess,
    MotionModel,
    Prismatic,
    Rotational,
)

pytestmark = pytest.mark.slow

X, Y, Z = np.eye(3)


def sliding(q):
    return np.array([0.0, 0.0, -q, 0.0, 0.0, 0.0])


def hinged(radius, hinge=-Z, pull=X):
    """A hinge in a direction from a hand that is pulled."""
    door = DoorGeometry(hinge=radius * hinge, axis=np.cross(pull, hinge))
    return lambda q: door.hand_poses(q / radius)


def folding(q, edge=0.16, width=0.35):
    """A trammel ellipse; q is not its length, but the leaf's angle."""
    across, along = edge * np.sin(q), -(2.0 * width - edge) * (1.0 - np.cos(q))
    return np.array([across, 0.0, along, 0.0, -q, 0.0])


def parallel(q, out=0.05):
    """Out of the wall on a quarter of a circle, then along it."""
    turn = min(q / out, np.pi / 2.0)
    further = max(q - out * np.pi / 2.0, 0.0)
    place = [out * np.sin(turn), 0.0, out * (np.cos(turn) - 1.0) - further]
    return np.array([*place, 0.0, 0.0, 0.0])


def helix(q, radius=0.45, rise=0.08):
    return hinged(radius)(q) + rise * q / radius * np.eye(6)[1]


def four_bar(q, radius=0.42):
    """A hinge that wanders by 2 to 3 cm."""
    angle = q / radius
    x = radius * np.sin(angle) - 0.025 * np.sin(angle) ** 2
    z = (radius - 0.02) * (np.cos(angle) - 1.0)
    return np.array([x, 0.0, z, 0.0, angle, 0.0])


def path(door, length=0.3, spacing=0.005, noise=1e-3, seed=0):
    """Poses along a door [m, rad], with noise of 1 mm and, times 50, of 0.05 rad."""
    poses = np.array([door(q) for q in np.arange(spacing, length, spacing)])
    error = np.random.default_rng(seed).normal(size=poses.shape)
    return poses + noise * np.repeat([1.0, 50.0], 3) * error


def fitted(poses, pull=X):
    """Every model of a path, fitted as its points arrive."""
    sides = [side for side in (X, Y, Z, -X, -Y, -Z) if side @ pull == 0.0]
    models = [
        *(MotionModel(np.zeros(6)), Prismatic(pull, pull), GaussianProcess(poses[:1])),
        *(Rotational.expected(pull, side) for side in sides),
    ]
    for count in range(1, len(poses) + 1):
        models = [model.updated(poses[:count]) for model in models]
    return models


@pytest.mark.parametrize("seed", range(3))
@pytest.mark.parametrize(
    ("door", "pull", "kind"),
    [
        (lambda q: np.zeros(6), X, MotionModel),
        (sliding, -Z, Prismatic),
        (lambda q: q * np.eye(6)[0], X, Prismatic),
        *((hinged(0.4, hinge), X, Rotational) for hinge in (Z, -Z, Y, -Y)),
        (hinged(0.8), X, Rotational),
        (hinged(0.4, Z, -X), -X, Rotational),
        (parallel, X, GaussianProcess),
        (lambda q: folding(2.0 * q), X, GaussianProcess),
    ],
)
def test_each_kind_is_recognised_with_a_millimetre_of_noise(door, pull, kind, seed):
    poses = path(door, seed=seed)
    best = min(fitted(poses, pull), key=lambda model: model.bic(poses))
    assert type(best) is kind


def test_the_criterion_is_that_of_the_paper():
    """-2 log p(D | M, θ) + k log n, q uniform over n places; the rest by SciPy."""
    poses = path(hinged(0.4), length=0.1, noise=3e-3)
    poses[4] += 0.5
    variance, n = np.repeat([1e-6, 0.04], 3), len(poses)
    numbers = {MotionModel: (0, 6), Prismatic: (1, 8), Rotational: (1, 9)}
    for model in fitted(poses):
        degrees, k = numbers.get(type(model), (1, 1 + 1 + 6 * 5))
        errors = poses - [model.poses(model.coordinates(pose[:3])) for pose in poses]
        normal = stats.multivariate_normal(cov=np.diag(variance)).pdf(errors)
        density = (0.99 * normal + 0.01 / (8.0 * np.pi**2)) / n**degrees
        likelihood = np.log(density).sum()
        assert model.bic(poses) == pytest.approx(-2.0 * likelihood + k * np.log(n))


@given(st.floats(0.0, 0.3), st.integers(0, 9))
@settings(max_examples=8)
def test_coordinates_invert_poses_and_directions_are_their_slopes(q, seed):
    for model in fitted(path(hinged(0.4), seed=seed))[1:]:
        pose, ahead = model.poses(q), model.poses(q + 1e-6)
        assert model.coordinates(pose[:3]) == pytest.approx(q, abs=1e-4)
        slope = (ahead - pose)[:3] / np.linalg.norm((ahead - pose)[:3])
        assert_allclose(model.direction(q), slope, atol=1e-4)


def test_the_line_is_the_most_probable_one():
    poses = path(lambda q: sliding(q) + 0.1 * q, length=0.04)
    lengths = np.linalg.norm(poses[:, :3], axis=1)

    def cost(line):
        errors = (poses[:, :3] - np.outer(lengths, line)) / 1e-3
        return (errors**2).sum() + (((line + Z) / UPRIGHT.heading_std) ** 2).sum()

    best = optimize.minimize(cost, -Z, tol=1e-12).x
    direction = Prismatic(-Z, -Z).updated(poses).direction(0.0)
    assert_allclose(direction, best / np.linalg.norm(best), atol=1e-4)


def test_the_process_is_an_integrated_wiener_process():
    """Its covariance ∫ (q - u)₊ (q' - u)₊ du by quadrature."""
    poses = path(parallel, length=0.1)
    model, chords = GaussianProcess(poses), np.diff(poses[:, :3], axis=0, prepend=0.0)
    lengths = np.cumsum(np.linalg.norm(chords, axis=1))[[3, 7, 10, 14, 18]]

    def covariance(s, t):
        area = integrate.quad(lambda u: (s - u) * (t - u), 0.0, min(s, t))
        return mechanism._SLOPE * s * t + mechanism._BEND * area[0]

    among = np.array([[covariance(a, b) for b in lengths] for a in lengths])
    alpha = np.linalg.solve(among + np.eye(5), poses[[3, 7, 10, 14, 18]])
    for q in (0.03, 0.08, 0.3):
        mean = [covariance(q, b) for b in lengths] @ alpha
        assert_allclose(model.poses(q), mean, atol=1e-9)
    ends = model.poses(lengths[-1] + np.array([0.0, 0.1, 0.2, 0.3]))
    assert_allclose(np.diff(ends, n=2, axis=0), 0.0, atol=1e-9)


@functools.cache
def opened(policy, door, last, periods=1000):
    """Coordinate, force across and along the path [N] in every period of an episode.

    The hand is fixed to a path with a stop at its end: a servo of 2000 N/m and 250 N
    s/m, a mass of 8 kg, friction of 2 N; and 100 N m/rad about the hand.
    """
    agent, q, speed, kinds = make_agent(policy, ()), 0.0, 0.0, []
    agent.reset({"ee_pose": np.zeros(6), "wrench": np.zeros(6)})
    wrench = np.zeros(6)
    for _ in range(periods):
        pose = door(q)
        command = agent.act({"ee_pose": pose, "wrench": wrench}).action
        slope = (door(q + 1e-5) - pose)[:3] / 1e-5
        metric, force = math.hypot(*slope), 2000.0 * (command - pose)[:3]
        slope = slope / metric
        spring = float(force @ slope)
        for _ in range(10):
            pulled = spring - 250.0 * speed
            friction = -2.0 * math.tanh(speed / 1e-3)
            speed += 1e-3 * (pulled + friction) / 8.0
            q += 1e-3 * speed / metric
            stop = (q <= 0.0 and speed <= 0.0) or (q >= last and speed >= 0.0)
            if stop:
                q, speed, friction = min(max(q, 0.0), last), 0.0, -pulled
        across = force - spring * slope
        turns = Rotation.from_rotvec(np.array([command[3:], pose[3:]]))
        moment = -100.0 * (turns[0] * turns[1].inv()).as_rotvec()
        wrench = np.concatenate([friction * slope - across, moment])
        kinds.append([q, np.linalg.norm(across), friction])
    return np.array(kinds).T


@pytest.mark.parametrize(
    ("door", "last", "enough", "force"),
    [
        (hinged(0.4), 0.64, 60.0 / 92.0, 1.5),
        (hinged(0.4, Y), 0.64, 60.0 / 92.0, 1.5),
        (folding, 1.5, 0.95, 6.0),
        (parallel, 0.8, 0.95, 10.0),
        (helix, 0.7, 60.0 / 90.0, 5.0),
        (four_bar, 0.67, 60.0 / 92.0, 1.5),
    ],
)
def test_doors_of_many_kinds_are_opened_within_a_force(door, last, enough, force):
    q, across, along = opened("mechanism-fit", door, last)
    assert (q > enough * last).sum() > 50
    assert across.max() < force
    assert np.abs(along[-100:]).max() < 25.1
