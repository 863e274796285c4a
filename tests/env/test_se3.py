"""Rotation vectors against SciPy's Rotation, and the rules SciPy does not have."""

from functools import partial
from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions, unwrap_rotvecs
from gplfd_env.spatial.se3 import (
    canonical_rotvec,
    compose_rotvecs,
    pose_distance,
    pose_steps,
    relative_poses,
    rotation_distance,
)

rotvecs = arrays(np.float64, 3, elements=st.floats(-7.0, 7.0))
paths = arrays(np.float64, (6, 3), elements=st.floats(-7.0, 7.0))


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (Rotation.from_rotvec(a).inv() * Rotation.from_rotvec(b)).magnitude()


def turning_path(n_samples: int, turns: float) -> np.ndarray:
    """A rotation whose axis wanders while its angle grows through π."""
    angle = np.linspace(0.1, 2 * np.pi * turns, n_samples)
    axis = np.column_stack([0.3 * np.sin(angle), np.ones(n_samples), 0.2 * angle])
    return angle[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)


# --- The canonical form --------------------------------------------------------------


@given(rotvec=rotvecs)
def test_eq8_canonical_form_is_the_same_rotation_within_the_ball(rotvec):
    canonical = canonical_rotvec(rotvec)
    assert np.linalg.norm(canonical) <= np.pi + 1e-12
    assert angle_between(rotvec, canonical) < 1e-11
    assert_allclose(canonical_rotvec(canonical), canonical, atol=1e-12)


@pytest.mark.parametrize(
    "axis",
    [
        *((0, 0, 1), (0, 1, 0), (1, 0, 0), (-0.6, -0.64, 0.48), (-0.6, 0.8, 0)),
        (0.6, 0.8, -1e-17),  # rounding error is not a sign
    ],
)
def test_eq9_fixes_the_axis_at_pi(axis):
    half_turn = np.pi * np.array(axis, dtype=float)
    # Three half turns are the same rotation.
    for times in (1, -1, 3, -3) if axis[2] != -1e-17 else (1, 3):
        assert_allclose(canonical_rotvec(times * half_turn), half_turn, atol=1e-12)


def test_canonical_form_keeps_small_rotations_exactly_and_batches():
    batch = np.array([[[1e-300, 0, 0], [0, 0, 0]], [[0, 3.0, 0], [0, 4.0, 0]]])
    canonical = canonical_rotvec(batch)
    assert_array_equal(canonical[0], batch[0])
    assert_array_equal(canonical[1, 0], batch[1, 0])
    assert_allclose(canonical[1, 1], [0, 4.0 - 2 * np.pi, 0], atol=1e-15)


# --- Distances -----------------------------------------------------------------------


@given(a=rotvecs, b=rotvecs)
def test_eq18_distance_matches_scipy(a, b):
    distance = rotation_distance(a, b)
    assert_allclose(distance, angle_between(a, b), atol=1e-12)
    assert_allclose(distance, rotation_distance(b, a), atol=1e-14)


@given(a=rotvecs, b=rotvecs)
def test_composition_matches_scipy(a, b):
    composed = compose_rotvecs(a, b)
    expected = Rotation.from_rotvec(a) * Rotation.from_rotvec(b)
    assert angle_between(composed, expected.as_rotvec()) < 1e-12
    assert np.linalg.norm(composed) <= np.pi + 1e-12


@pytest.mark.parametrize("angle", [1e-12, 1e-9, 1e-4, 1.0, np.pi - 1e-9])
def test_eq18_resolves_angles_where_arccos_cannot(angle):
    axis = np.array([0.48, -0.6, 0.64])
    a, b = 0.7 * axis, (0.7 + angle) * axis
    half_a, half_b = 0.35, (0.7 + angle) / 2
    cosine = np.cos(half_a) * np.cos(half_b) + np.sin(half_a) * np.sin(half_b)
    printed = 2 * np.arccos(min(abs(cosine), 1.0))
    if angle < 1e-8:
        assert abs(printed - angle) > 0.9 * angle  # zero or rounding noise
    assert_allclose(rotation_distance(a, b), angle, atol=3e-16, rtol=1e-15)


def test_eq18_is_exact_at_zero_and_pi():
    rotvec = np.array([0.3, -1.1, 2.0])
    assert rotation_distance(rotvec, rotvec) == 0.0
    half_turn = rotation_distance(np.zeros(3), [0, np.pi, 0])
    assert half_turn == pytest.approx(np.pi, abs=1e-15)
    turn = rotvec * (1 + 2 * np.pi / np.linalg.norm(rotvec))
    assert rotation_distance(rotvec, turn) < 1e-14


def test_eq17_weights_rotation_and_translation():
    a, b = np.zeros(6), np.array([3.0, 0, 4.0, 0, 1.2, 0])
    for weight in (0.0, 0.25, 1.0):
        expected = np.sqrt(weight * 1.2**2 + (1.0 - weight) * 25)
        assert pose_distance(a, b, weight) == pytest.approx(expected)


@given(
    path=arrays(np.float64, (5, 6), elements=st.floats(-4.0, 4.0)),
    scale=st.sampled_from([1.0, 0.1, 1e-3, 1e-9, 0.0]),
    weight=st.floats(0.0, 1.0),
)
def test_steps_of_a_path_are_distances_of_neighbours(path, scale, weight):
    path = path[0] + scale * (path - path[0])
    expected = pose_distance(path[1:], path[:-1], weight)
    assert_allclose(pose_steps(path, weight), expected, rtol=1e-9, atol=1e-15)
    assert pose_steps(path[:1], weight).shape == (0,)


@pytest.mark.parametrize("weight", [-0.1, 1.1, np.nan])
def test_eq17_weight_outside_the_unit_interval_is_refused(weight):
    with pytest.raises(ValueError, match=r"rotation_weight must lie in \[0, 1\]"):
        pose_distance(np.zeros(6), np.ones(6), weight)


def test_relative_poses_match_homogeneous_matrices():
    rng = np.random.default_rng(2)
    path = np.hstack([rng.normal(size=(50, 3)), turning_path(50, turns=0.8)])
    reference = path[3]

    def matrix(pose: np.ndarray) -> np.ndarray:
        homogeneous = np.eye(4)
        homogeneous[:3, :3] = Rotation.from_rotvec(pose[3:]).as_matrix()
        homogeneous[:3, 3] = pose[:3]
        return homogeneous

    relative = relative_poses(path, reference)
    for pose, got in zip(path, relative, strict=True):
        expected = np.linalg.inv(matrix(reference)) @ matrix(pose)
        assert_allclose(matrix(got), expected, atol=1e-12)
    assert_allclose(relative[3], 0.0, atol=1e-15)
    assert np.linalg.norm(relative[-1, 3:]) > np.pi
    assert np.abs(np.diff(relative[:, 3:], axis=0)).max() < 0.5


# --- Paths that turn far -------------------------------------------------------------


TURNS = np.linspace(0.0, 4.5 * np.pi, 91)[:, None]  # Meets 2π and 4π exactly.
FAR = [turning_path(300, 0.9), TURNS * [0.0, 0.6, -0.8], TURNS * [0.0, -0.6, 0.8]]


@pytest.mark.parametrize("path", FAR, ids=["wandering", "two turns", "back"])
def test_unwrapping_restores_a_path_through_pi(path):
    canonical = canonical_rotvec(path)
    assert np.abs(np.diff(canonical, axis=0)).max() > 3.0  # it does jump
    assert_allclose(unwrap_rotvecs(canonical), path, atol=1e-12)


def test_unwrapping_passes_the_identity_despite_rounding():
    # Samples at 2π whose axis is rounding error, and a path that crosses zero.
    around = np.array([[0, 6.2, 0], [1e-16, 0, -2e-16], [0, 6.3 - 2 * np.pi, 0]])
    unwrapped = [[0, 6.2, 0], [0, 2 * np.pi, 0], [0, 6.3, 0]]
    assert_allclose(unwrap_rotvecs(around), unwrapped)
    through_zero = np.array([[0.1, 0, 0], [1e-12, 0, 0], [0, 0, 0], [-0.1, 1e-13, 0]])
    assert_array_equal(unwrap_rotvecs(through_zero), through_zero)


@given(path=paths)
def test_unwrapping_takes_the_nearest_equivalent_and_is_idempotent(path):
    unwrapped = unwrap_rotvecs(path)
    # Near the identity an axis is rounding error, which unwrapping may replace.
    assert angle_between(path, unwrapped).max() < 2e-9
    assert_allclose(unwrap_rotvecs(unwrapped), unwrapped, atol=1e-8)
    for previous, current in pairwise(unwrapped):
        angle, distance = np.linalg.norm([current, current - previous], axis=1)
        for turns in (-1, 1) if angle >= 1e-6 else ():
            other = current * (1 + 2 * np.pi * turns / angle)
            assert distance <= np.linalg.norm(other - previous) + 1e-9


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_quaternions_become_continuous_rotation_vectors(order):
    path = turning_path(200, turns=0.8)
    quaternions = Rotation.from_rotvec(path).as_quat(scalar_first=order == "wxyz")
    rng = np.random.default_rng(1)
    quaternions *= rng.choice([-1.0, 1.0], size=(200, 1))  # flips
    quaternions *= rng.uniform(0.98, 1.02, size=(200, 1))  # not exactly unit
    assert_allclose(
        rotvecs_from_quaternions(quaternions, order=order), path, atol=1e-12
    )


ONE = [1.0, 0, 0, 0]


@pytest.mark.parametrize(
    ("rotations", "of", "message"),
    [
        (np.ones((4, 3)), "wxyz", r"\(N, 4\), got \(4, 3\)"),
        ([ONE, [np.nan, 0, 0, 1]], "wxyz", r"quaternions\[1\].*not finite"),
        ([ONE, [0.5, 0, 0, 0]], "wxyz", r"quaternions\[1\].*order='wxyz'"),
        ([ONE], "wzyx", r"'wxyz' .* or 'xyzw', got 'wzyx'"),
        ([[0.0, 0, 0], [0, np.inf, 0]], "vectors", r"rotvecs\[1\] .* is not finite"),
    ],
)
def test_unusable_rotations_are_refused(rotations, of, message):
    read = unwrap_rotvecs
    if of != "vectors":
        read = partial(rotvecs_from_quaternions, order=of)
    with pytest.raises(ValueError, match=message):
        read(np.array(rotations))
