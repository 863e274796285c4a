"""Unwrapping and quaternions against SciPy's Rotation, and the rules it lacks."""

from itertools import pairwise

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions, unwrap_rotvecs
from gplfd_env.spatial.se3 import canonical_rotvec


def angle_between(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return (Rotation.from_rotvec(a).inv() * Rotation.from_rotvec(b)).magnitude()


def turning_path(n_samples: int, turns: float) -> np.ndarray:
    """A rotation whose axis wanders while its angle grows through π."""
    angle = np.linspace(0.1, 2 * np.pi * turns, n_samples)
    axis = np.column_stack([0.3 * np.sin(angle), np.ones(n_samples), 0.2 * angle])
    return angle[:, None] * axis / np.linalg.norm(axis, axis=1, keepdims=True)


def test_unwrapping_restores_a_path_through_pi():
    path = turning_path(300, turns=0.9)
    assert np.linalg.norm(path[-1]) > np.pi
    canonical = canonical_rotvec(path)
    assert np.abs(np.diff(canonical, axis=0)).max() > 3.0  # it does jump
    np.testing.assert_allclose(unwrap_rotvecs(canonical), path, atol=1e-12)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_unwrapping_runs_through_two_turns_about_one_axis(sign):
    angle = np.linspace(0.0, 4.5 * np.pi, 91)  # meets 2π and 4π exactly
    path = sign * angle[:, None] * np.array([0.0, 0.6, -0.8])
    np.testing.assert_allclose(unwrap_rotvecs(canonical_rotvec(path)), path, atol=1e-12)


def test_unwrapping_passes_the_identity_despite_rounding():
    # Samples at 2π whose axis is rounding error, and a path that crosses zero.
    around = np.array([[0, 6.2, 0], [1e-16, 0, -2e-16], [0, 6.3 - 2 * np.pi, 0]])
    np.testing.assert_allclose(
        unwrap_rotvecs(around), [[0, 6.2, 0], [0, 2 * np.pi, 0], [0, 6.3, 0]]
    )
    through_zero = np.array([[0.1, 0, 0], [1e-12, 0, 0], [0, 0, 0], [-0.1, 1e-13, 0]])
    np.testing.assert_array_equal(unwrap_rotvecs(through_zero), through_zero)


@given(path=arrays(np.float64, (6, 3), elements=st.floats(-7.0, 7.0)))
def test_unwrapping_keeps_rotations_and_is_idempotent(path):
    unwrapped = unwrap_rotvecs(path)
    # Near the identity an axis is rounding error, which unwrapping may replace.
    assert angle_between(path, unwrapped).max() < 2e-9
    np.testing.assert_allclose(unwrap_rotvecs(unwrapped), unwrapped, atol=1e-8)


@given(path=arrays(np.float64, (6, 3), elements=st.floats(-7.0, 7.0)))
def test_unwrapping_takes_the_nearest_equivalent(path):
    unwrapped = unwrap_rotvecs(path)
    for previous, current in pairwise(unwrapped):
        angle = np.linalg.norm(current)
        if angle < 1e-6:
            continue
        for turns in (-1, 1):
            other = current * (1 + 2 * np.pi * turns / angle)
            distance = np.linalg.norm(current - previous)
            assert distance <= np.linalg.norm(other - previous) + 1e-9


@pytest.mark.parametrize("order", ["wxyz", "xyzw"])
def test_quaternions_become_continuous_rotation_vectors(order):
    path = turning_path(200, turns=0.8)
    quaternions = Rotation.from_rotvec(path).as_quat(scalar_first=order == "wxyz")
    rng = np.random.default_rng(1)
    quaternions *= rng.choice([-1.0, 1.0], size=(200, 1))  # flips
    quaternions *= rng.uniform(0.98, 1.02, size=(200, 1))  # not exactly unit
    np.testing.assert_allclose(
        rotvecs_from_quaternions(quaternions, order=order), path, atol=1e-12
    )


@pytest.mark.parametrize(
    ("quaternions", "message"),
    [
        (np.ones((4, 3)), r"shape \(N, 4\), got \(4, 3\)"),
        (np.array([1.0, 0, 0, 0]), r"shape \(N, 4\), got \(4,\)"),
        (
            np.array([[1.0, 0, 0, 0], [np.nan, 0, 0, 1]]),
            r"quaternions\[1\].*not finite",
        ),
        (np.array([[1.0, 0, 0, 0], [0.5, 0, 0, 0]]), r"quaternions\[1\].*order='wxyz'"),
    ],
)
def test_unusable_quaternions_are_refused(quaternions, message):
    with pytest.raises(ValueError, match=message):
        rotvecs_from_quaternions(quaternions)


def test_unknown_quaternion_order_is_refused():
    with pytest.raises(ValueError, match=r"'wxyz' .* or 'xyzw' .* got 'wzyx'"):
        rotvecs_from_quaternions(np.array([[1.0, 0, 0, 0]]), order="wzyx")


def test_unusable_rotation_vectors_are_refused():
    with pytest.raises(ValueError, match=r"rotvecs must have shape \(N, 3\)"):
        unwrap_rotvecs(np.zeros((2, 4)))
    with pytest.raises(ValueError, match=r"rotvecs\[1\] .* is not finite"):
        unwrap_rotvecs(np.array([[0.0, 0, 0], [0, np.inf, 0]]))
