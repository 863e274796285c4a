"""What nobody moved in is no part of a demonstration."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from numpy.testing import assert_array_equal

from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_policies import Demonstration, align
from gplfd_policies.demonstrations.alignment import without_rests

MOVING = 5.0
FINAL_ANGLE = np.radians(67.0)


def minimum_jerk(progress):
    progress = np.clip(progress, 0.0, 1.0)
    return progress**3 * (10.0 - 15.0 * progress + 6.0 * progress**2)


def opening(
    *, before=0.0, after=0.0, pause=0.0, rate=120.0, noise=0.0, seed=0, radius=0.5
):
    """An opening of 5 s with rests at both ends and one in the middle."""
    times = np.arange(round((before + MOVING + pause + after) * rate) + 1) / rate
    moved = times - before
    if pause:
        # Two strokes, each of which starts and stops gently.
        half = 0.5 * MOVING
        first, second = moved / half, (moved - half - pause) / half
        progress = 0.5 * (minimum_jerk(first) + minimum_jerk(second))
    else:
        progress = minimum_jerk(moved / MOVING)
    poses = handle_pose_on_arc(radius, FINAL_ANGLE * progress)
    errors = np.random.default_rng(seed).normal(size=poses.shape)
    poses += noise * np.repeat([1.0, 4.0], 3) * errors
    return Demonstration(times=times, poses=poses)


@settings(max_examples=60, deadline=None)
@given(
    before=st.floats(0.6, 2.0),
    after=st.floats(0.6, 2.0),
    rate=st.sampled_from([60.0, 120.0, 240.0]),
    noise=st.sampled_from([0.0, 3e-4, 1e-3]),
    seed=st.integers(0, 99),
)
def test_rests_at_the_ends_are_left_out_at_any_rate_and_noise(
    before, after, rate, noise, seed
):
    recorded = opening(before=before, after=after, rate=rate, noise=noise, seed=seed)
    left, rests = without_rests(recorded)
    assert left.times[-1] - left.times[0] == pytest.approx(MOVING, abs=0.35)
    first, last = rests[0], rests[-1]
    assert first.start == 0.0
    assert first.end == pytest.approx(before, abs=0.25)
    assert last.end == recorded.times[-1]
    assert last.start == pytest.approx(before + MOVING, abs=0.25)


@settings(max_examples=40, deadline=None)
@given(
    rate=st.sampled_from([60.0, 120.0, 240.0]),
    noise=st.sampled_from([0.0, 3e-4, 1e-3]),
    seed=st.integers(0, 99),
    radius=st.floats(0.3, 0.65),
)
def test_a_gentle_start_is_no_rest(rate, noise, seed, radius):
    recorded = opening(rate=rate, noise=noise, seed=seed, radius=radius)
    left, rests = without_rests(recorded)
    assert rests == ()
    assert left is recorded


@pytest.mark.parametrize("noise", [0.0, 3e-4, 1e-3])
def test_a_rest_in_the_middle_carries_no_progress(noise):
    recorded = opening(pause=1.5, noise=noise)
    left, (rest,) = without_rests(recorded)
    # What is slow around a pause are an end and a beginning, each 6 % of a stroke.
    assert rest.start == pytest.approx(0.5 * MOVING, abs=0.2)
    assert rest.end == pytest.approx(0.5 * MOVING + 1.5, abs=0.2)
    assert left.times[-1] == pytest.approx(MOVING, abs=0.3)
    assert np.all(np.diff(left.times) > 0.0)
    # The poses are those of the recording, and the clock is closed over the gap.
    kept = (recorded.times < rest.start) | (recorded.times >= rest.end)
    assert_array_equal(left.poses, recorded.poses[kept])
    assert np.diff(left.times).max() < 2.0 / 120.0


def test_alignment_says_what_it_left_out():
    recorded = [opening(before=1.0, after=1.0), opening()]
    with pytest.warns(UserWarning, match=r"rests: 1 of 2 .* of 12 s were left out"):
        aligned = align(recorded)
    assert [len(rests) for rests in aligned.rests] == [2, 0]
    assert aligned.duration == pytest.approx(MOVING, abs=0.1)
    whole = align(recorded, trim_rests=False)
    assert whole.rests == ()
    assert whole.duration == pytest.approx(MOVING + 1.0)


@pytest.mark.parametrize("creep", [0.02, 0.01])
def test_a_slow_hand_that_gets_somewhere_does_not_rest(creep):
    """Some millimetres of unlatching in four seconds, then a pull of 0.6 m in two."""
    times = np.linspace(0.0, 6.0, 720)
    poses = np.zeros((720, 6))
    pull = np.clip((times - 4.0) / 2.0, 0.0, 1.0)
    poses[:, 0] = 0.25 * creep * np.minimum(times, 4.0) + 0.6 * pull**2 * (
        3.0 - 2.0 * pull
    )
    kept, rests = without_rests(Demonstration(times=times, poses=poses))
    assert rests == ()
    assert kept.poses[0, 0] == 0.0
