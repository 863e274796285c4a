"""The record of a demonstration, and what alignment and continuation refuse."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import canonical_rotvec, handle_pose_on_arc
from gplfd_policies import AlignedDemonstrations, Demonstration, align
from gplfd_policies.demonstrations.aligned import continued
from gplfd_policies.demonstrations.alignment import (
    dynamic_time_warping,
    task_completion_index,
)

SECONDS = np.linspace(0.0, 1.0, 5)
NUMBERS = st.floats(-2.0, 2.0)
LINE = np.outer(np.linspace(0.0, 0.4, 5), np.eye(6)[0])


def test_from_quaternions_gives_continuous_rotation_vectors():
    rotvecs = np.outer(np.linspace(2.8, 3.6, 30), [0.0, -0.6, 0.8])
    quaternions = Rotation.from_rotvec(rotvecs).as_quat(scalar_first=False)
    quaternions[::3] *= -1
    positions = np.random.default_rng(0).normal(size=(30, 3))
    recorded = Demonstration.from_quaternions(
        np.arange(30.0), positions, quaternions, order="xyzw"
    )
    assert_allclose(recorded.poses[:, 3:], rotvecs, atol=1e-12)
    assert_array_equal(recorded.poses[:, :3], positions)


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


# --- What is refused ---------------------------------------------------------


def shown(times=SECONDS, poses=LINE):
    return Demonstration(times=times, poses=poses)


def changed(array, index, value):
    array = array.copy()
    array[index] = value
    return array


TURNS = canonical_rotvec(np.outer(np.linspace(3.0, 3.3, 5), [0.0, 0.6, 0.8]))


def aligned(**fields):
    good = {"times": SECONDS, "poses": np.stack([LINE, LINE])}
    return AlignedDemonstrations(**(good | fields))


ARC = aligned(poses=handle_pose_on_arc(0.5, np.linspace(0.0, 0.8, 5))[None])
REFUSED = {
    r"poses\[3\] = .* is not finite": lambda: shown(poses=changed(LINE, 3, np.nan)),
    r"times\[3\] = 0.75 is not later than 0.9": lambda: shown(
        times=changed(SECONDS, 2, 0.9)
    ),
    "has 3 samples or more, not 2": lambda: shown(np.arange(2.0), np.eye(2, 6)),
    "never moves": lambda: shown(poses=np.ones((5, 6))),
    r"jump at sample 2.*from_quaternions.*unwrap_rotvecs": lambda: shown(
        poses=np.hstack([np.zeros((5, 3)), TURNS])
    ),
    r"one row per quaternion, .* for 3": lambda: Demonstration.from_quaternions(
        np.arange(3.0), np.zeros((2, 3)), np.tile([1.0, 0, 0, 0], (3, 1))
    ),
    r"not move under rotation_weight=1\.0": lambda: task_completion_index(shown(), 1.0),
    "of 20,000 and 30,000 samples": lambda: dynamic_time_warping(
        lambda row: np.zeros(30_000), 20_000
    ),
    "at least one demonstration is needed": lambda: align([]),
    "dtw.*dtw-euclidean.*inter": lambda: align([shown()], method="linear"),
    "n_samples must be at least 2, got 1": lambda: align([shown()], n_samples=1),
    r"\(4,\) and \(2, 5, 6\)": lambda: aligned(times=np.linspace(0, 1, 4)),
    "divide seconds by the duration": lambda: aligned(times=np.arange(5.0)),
    "duration positive": lambda: aligned(duration=0.0),
    "clocks must be": lambda: aligned(clocks=np.full((2, 5), 1.5)),
    "beyond must be finite and >= 0": lambda: continued(ARC, -0.1),
    "only once; got": lambda: continued(continued(ARC, 0.5), 0.5),
}


@pytest.mark.usefixtures("as_for_users")
@pytest.mark.parametrize("message", REFUSED)
def test_unusable_input_is_refused(message):
    with pytest.raises(ValueError, match=message):
        REFUSED[message]()


def test_wrenches_turn_into_the_axes_of_the_first_pose():
    rng = np.random.default_rng(3)
    poses, wrenches = rng.normal(size=(5, 6)), rng.normal(size=(5, 6))
    poses[:, 3:] *= 0.1
    recorded = Demonstration(times=np.arange(5.0), poses=poses, wrenches=wrenches)
    relative = recorded.relative_to_first()
    axes = Rotation.from_rotvec(poses[0, 3:]).as_matrix()
    assert relative.wrenches is not None
    np.testing.assert_allclose(relative.wrenches[:, :3] @ axes.T, wrenches[:, :3])
    np.testing.assert_allclose(relative.wrenches[:, 3:] @ axes.T, wrenches[:, 3:])
