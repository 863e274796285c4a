"""Demonstrations in another frame."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_policies import Demonstration

NUMBERS = st.floats(-2.0, 2.0)


@given(steps=arrays(np.float64, (5, 6), elements=NUMBERS), seed=st.integers(0, 9))
def test_relative_poses_composed_with_the_first_are_the_poses(steps, seed):
    """T_0 (T_0⁻¹ T) = T, with SciPy's rotations."""
    # Small turns, so that nothing jumps, and a way to go.
    start = np.random.default_rng(seed).uniform(-1.0, 1.0, 6)
    path = np.zeros((6, 6))
    path[1:] = np.cumsum(steps, axis=0)
    path[1:, 0] += 20.0
    turned = Rotation.from_rotvec(0.1 * path[:, 3:]) * Rotation.from_rotvec(start[3:])
    recorded = Demonstration.from_quaternions(
        np.arange(6.0), path[:, :3] + start[:3], turned.as_quat(), order="xyzw"
    )

    relative = recorded.relative_to_first()

    assert_array_equal(relative.times, recorded.times)
    assert_allclose(relative.poses[0], np.zeros(6), atol=1e-12)
    # Copies: SciPy's rotations take no read-only arrays.
    first, poses = Rotation.from_rotvec(recorded.poses[0, 3:].copy()), relative.poses
    again = first.apply(poses[:, :3].copy()) + recorded.poses[0, :3]
    assert_allclose(again, recorded.poses[:, :3], atol=1e-12)
    error = (first * Rotation.from_rotvec(poses[:, 3:].copy())).inv() * turned
    assert_allclose(error.magnitude(), 0.0, atol=1e-12)


@pytest.mark.parametrize("width", [2, 3])
def test_positions_alone_are_a_demonstration(width):
    times = np.linspace(0.0, 1.0, 5)
    positions = np.random.default_rng(0).normal(size=(5, width))
    poses = Demonstration.from_positions(times, positions).poses
    assert_array_equal(poses[:, :width], positions)
    assert not poses[:, width:].any()


def test_positions_of_another_shape_are_refused():
    with pytest.raises(ValueError, match=r"\(N, 3\) or \(N, 2\), got \(5, 4\)"):
        Demonstration.from_positions(np.arange(5.0), np.zeros((5, 4)))
