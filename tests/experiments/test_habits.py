"""Untidy recordings: each habit does what it says and leaves the rest alone."""

import dataclasses
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from gplfd_experiments.data.teacher import MESSY, TIDY, Habits, Teacher, TeacherConfig
from gplfd_experiments.data.teacher.habits import lose_samples, untidy_clock
from gplfd_policies import align

CLEAN = TeacherConfig(
    wobble_position_std=0.0, wobble_rotation_std=0.0, noise_position_std=0.0,
    noise_rotation_std=0.0, vertical_drift_std=0.0, grasp_offset_std=0.0,
)  # fmt: skip


def angles(habits: Habits, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return times and door angles of a recording without noise."""
    shown = Teacher(CLEAN, habits).demonstrate(0.5, np.random.default_rng(seed))
    return shown.times, shown.poses[:, 4]


def test_without_habits_the_teacher_is_as_ever():
    rng = (np.random.default_rng(3) for _ in range(2))
    plain, tidy = (
        Teacher(habits=h).demonstrate(0.5, next(rng)) for h in (TIDY, Habits())
    )
    assert_array_equal(plain.poses, tidy.poses)
    # Habits draw from a generator of their own: the motion is the same one.
    times, still = angles(TIDY)
    later, rested = angles(Habits(longest_rest=1.0))
    assert later.size > times.size
    rest = later.size - times.size
    assert_allclose(rested[:rest], 0.0, atol=1e-5)
    assert rested[-1] == pytest.approx(still[-1])


@pytest.mark.parametrize("seed", range(8))
def test_pauses_stop_the_motion_for_as_long_as_they_last(seed):
    habits = Habits(pauses=3, longest_pause=0.8)
    rng = np.random.default_rng(seed)
    times, clock, back = untidy_clock(habits, 6.0, 1000.0, rng)
    paused = np.diff(clock) <= 1e-12
    moving = np.diff(clock)[~paused]
    assert np.all(np.diff(clock) >= -1e-12)
    assert np.count_nonzero(paused) / 1000.0 == pytest.approx(times[-1] - 6.0, abs=0.01)
    assert 3 * 0.16 <= times[-1] - 6.0 <= 3 * 0.8 + 0.01
    assert_allclose(np.median(moving), 1e-3 / 6.0, rtol=1e-6)
    assert clock[0] == 0.0
    assert clock[-1] == pytest.approx(1.0, abs=1e-3)
    assert_array_equal(back, 0.0)


def test_in_a_pause_the_door_goes_back_and_forth():
    habits = Habits(pauses=1, longest_pause=2.0, backward=0.2)
    for seed in range(20):
        _, angle = angles(habits, seed)
        _, straight = angles(Habits(pauses=1, longest_pause=2.0), seed)
        gone_back = straight - angle
        assert np.all(gone_back > -1e-9)
        assert gone_back.max() <= 0.2 + 1e-9
        assert np.all(angle > -1e-9)
        assert angle[-1] == pytest.approx(straight[-1])
    assert gone_back.max() > 0.01


def test_haste_scales_durations_within_its_factor():
    rng = np.random.default_rng(0)
    habits = Habits(haste=2.0)
    durations = [untidy_clock(habits, 6.0, 100.0, rng)[0][-1] for _ in range(1000)]
    assert 3.0 <= min(durations) < 3.05
    assert 11.9 < max(durations) <= 12.01
    assert np.median(durations) == pytest.approx(6.0, rel=0.1)


def test_a_cut_recording_ends_early():
    ends = [angles(Habits(cut=0.2), seed)[1][-1] for seed in range(20)]
    whole = [angles(TIDY, seed)[1][-1] for seed in range(20)]
    missing = np.subtract(whole, ends)
    assert missing.min() >= 0.0
    assert missing.max() > math.radians(2.0)


def test_samples_are_lost_and_misplaced_as_told():
    poses = np.zeros((1000, 6))
    kept, seen = lose_samples(
        Habits(dropped=0.2, outliers=3, outlier_distance=0.3), poses,
        np.random.default_rng(0),
    )  # fmt: skip
    assert 0.2 <= np.mean(~kept) < 0.206
    assert kept[0]
    assert kept[-1]
    away = np.linalg.norm(seen[:, :3], axis=1)
    assert_allclose(away[away > 0], 0.3)
    assert np.count_nonzero(away[kept]) == 3
    assert_array_equal(seen[:10], 0.0)
    lengths = np.diff(np.flatnonzero(np.diff(kept.astype(int))))[::2]
    assert lengths.max() > 1, "in bursts"
    # Few samples, and all the same nothing breaks.
    kept, _ = lose_samples(
        Habits(dropped=0.5, outliers=20), poses[:3], np.random.default_rng(0)
    )
    assert kept.sum() >= 2


@pytest.mark.filterwarnings("ignore:rests")
def test_messy_recordings_can_be_learned_from():
    shown = Teacher(habits=MESSY).demonstrate_doors(
        (0.35, 0.5), 2, rng=np.random.default_rng(1)
    )
    assert max(np.diff(one.times).max() for one in shown) > 2.5 / 60.0
    # The outlier's way there and back is no part of the task.
    with pytest.warns(UserWarning, match="4 of 4 demonstrations have a raw path"):
        aligned = align(shown)
    assert np.isfinite(aligned.poses).all()


@pytest.mark.parametrize("field", dataclasses.fields(Habits), ids=lambda f: f.name)
def test_what_is_impossible_is_refused(field):
    with pytest.raises(ValueError, match=f"Habits.{field.name} = "):
        Habits(**{field.name: -1})
