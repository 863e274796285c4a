"""The synthetic human: each effect does what it says and leaves the rest alone."""

import dataclasses
import math
from typing import Any

import numpy as np
import pytest
import scipy
from numpy.testing import assert_allclose, assert_array_equal
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_experiments.data.teacher import (
    DEMONSTRATED_RADII,
    ROOM_RADII,
    TIDY,
    Habits,
    Teacher,
    TeacherConfig,
    doors_like,
)
from gplfd_experiments.data.teacher.motion import (
    Press,
    coloured_noise,
    draw_press,
    handle_angles,
    irregular_timing,
    lose_samples,
    minimum_jerk,
    smooth_functions,
)
from gplfd_experiments.studies.tasks import noisy_teacher

NOISELESS: dict[str, float] = noisy_teacher(0.0)
QUIET: dict[str, float] = {
    **NOISELESS,
    **dict.fromkeys(("duration_std", "angle_std", "timing_std"), 0.0),
}


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def quiet(**changes: float) -> Any:
    """A demonstration with these effects alone."""
    return Teacher(TeacherConfig(**(QUIET | changes))).demonstrate(0.5, rng())


def test_without_disturbances_the_hand_follows_the_closed_form_arc() -> None:
    shown, config = quiet(), TeacherConfig()
    phi = config.angle_mean * minimum_jerk(shown.times / config.duration_mean)
    zero = np.zeros_like(phi)
    arc = [0.5 * np.sin(phi), zero, -0.5 * (1 - np.cos(phi)), zero, phi, zero]
    assert_allclose(shown.poses, np.stack(arc, axis=1), atol=1e-12)


def test_more_doors_or_demonstrations_leave_the_earlier_ones_alone() -> None:
    """The same seed gives the same bits, and every effect draws independently."""
    few = Teacher().demonstrate_doors([0.35, 0.5], 2, rng=rng())
    more = Teacher().demonstrate_doors([0.35, 0.5, 0.65], 3, rng=rng())
    for kept, index in zip(few, (0, 1, 3, 4), strict=True):
        assert kept.times.tobytes() == more[index].times.tobytes()
        assert kept.poses.tobytes() == more[index].poses.tobytes()
    silent = quiet(grasp_offset_std=0.01)
    noisy = quiet(grasp_offset_std=0.01, noise_position_std=1e-6)
    assert_allclose(silent.poses, noisy.poses, atol=1e-5)


def test_timing_is_uneven_and_never_goes_back() -> None:
    angle, even = quiet(timing_std=0.5).poses[:, 4], quiet().poses[:, 4]
    assert np.all(np.diff(angle) >= 0.0)
    assert angle[-1] == pytest.approx(even[-1], abs=1e-12)
    assert np.abs(angle - even).max() > math.radians(2.0)


def test_grasp_offset_changes_the_apparent_arc_by_the_rotated_offset() -> None:
    poses, arc = quiet(grasp_offset_std=0.01).poses, quiet().poses
    turn = Rotation.from_rotvec(np.array(arc[:, 3:])).as_matrix() - np.eye(3)
    # (R - 1) offset = difference, for one offset over all samples.
    difference = (poses - arc)[:, :3].reshape(-1)
    offset, residual, *_ = np.linalg.lstsq(turn.reshape(-1, 3), difference, rcond=None)
    assert np.all(residual < 1e-20)
    assert 1e-3 < np.linalg.norm(offset[[0, 2]]) < 0.05


def test_smooth_functions_have_the_stated_covariance() -> None:
    times = np.array([0.0, 0.5, 1.0, 2.0])
    values = smooth_functions(times, 1.0, 20_000, rng())
    sample = values @ values.T / values.shape[1]
    expected = np.exp(-0.5 * (times[:, None] - times) ** 2)
    assert_allclose(sample, expected, atol=0.03)
    # They do not depend on the sampling.
    coarse = smooth_functions(np.array([0.0, 1.0]), 1.0, 2, rng())
    fine = smooth_functions(np.array([0.0, 0.5, 1.0]), 1.0, 2, rng())
    assert_array_equal(coarse, fine[::2])


def test_coloured_noise_has_unit_variance_and_no_power_above_its_bandwidth() -> None:
    for bandwidth in (0.05, 0.13, 0.6):
        noise = coloured_noise(20, bandwidth, 20_000, rng())
        assert_allclose(noise[[0, -1]].std(axis=1), 1.0, atol=0.03)
    noise = coloured_noise(4096, 0.05, 8, rng())
    power = np.mean(np.abs(np.fft.rfft(noise, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(4096)
    assert power[frequency > 0.2].mean() < 0.01 * power[frequency < 0.03].mean()
    sections = scipy.signal.butter(2, 0.1, output="sos")
    white = scipy.signal.sosfilt(
        sections, rng().standard_normal((80 + 4096, 8)), axis=0
    )
    impulse = scipy.signal.sosfilt(sections, np.eye(80)[0])
    assert_array_equal(noise, white[80:] / np.linalg.norm(impulse))


@pytest.mark.parametrize(
    ("call", "message"),
    [
        (lambda: TeacherConfig(duration_mean=0), r"Config\.duration_mean = 0.*\["),
        (lambda: TeacherConfig(sampling_rate=math.nan), r"sampling_rate = nan.*\["),
        (lambda: Teacher().demonstrate(-1.0, rng()), r"radius = -1\.0 is outside"),
        (lambda: Teacher().demonstrate_doors([], rng=rng()), "0 doors, per_door = 2"),
        (lambda: Teacher().demonstrate_doors([0.5], 0, rng=rng()), "per_door = 0"),
    ],
)
def test_wrong_requests_are_refused(call: Any, message: str) -> None:
    with pytest.raises(ValueError, match=message):
        call()


def angles(habits: Habits, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Return times and door angles of a recording without noise."""
    teacher = Teacher(TeacherConfig(**NOISELESS), habits)
    shown = teacher.demonstrate(0.5, rng(seed))
    return shown.times, shown.poses[:, 4]


def test_habits_draw_from_a_generator_of_their_own() -> None:
    times, still = angles(TIDY)
    later, rested = angles(Habits(longest_rest=1.0))
    rest = later.size - times.size
    assert rest > 0
    assert_allclose(rested[:rest], 0.0, atol=1e-5)
    assert rested[-1] == pytest.approx(still[-1])


@pytest.mark.parametrize("seed", range(4))
def test_pauses_stop_the_motion_for_as_long_as_they_last(seed: int) -> None:
    habits = Habits(pauses=3, longest_pause=0.8)
    times, clock, back = irregular_timing(habits, 6.0, 1000.0, rng(seed))
    paused = np.diff(clock) <= 1e-12
    assert np.all(np.diff(clock) >= -1e-12)
    assert np.count_nonzero(paused) / 1000.0 == pytest.approx(times[-1] - 6.0, abs=0.01)
    assert 3 * 0.16 <= times[-1] - 6.0 <= 3 * 0.8 + 0.01
    assert_allclose(np.median(np.diff(clock)[~paused]), 1e-3 / 6.0, rtol=1e-6)
    assert clock[0] == 0.0
    assert clock[-1] == pytest.approx(1.0, abs=1e-3)
    assert_array_equal(back, 0.0)


def test_in_a_pause_the_door_goes_back_and_forth() -> None:
    most = []
    for seed in range(6):
        _, angle = angles(Habits(pauses=1, longest_pause=2.0, backward=0.2), seed)
        _, straight = angles(Habits(pauses=1, longest_pause=2.0), seed)
        gone_back = straight - angle
        assert min(gone_back.min(), angle.min()) > -1e-9
        assert angle[-1] == pytest.approx(straight[-1])
        most.append(gone_back.max())
    assert 0.01 < max(most) <= 0.2 + 1e-9


def test_samples_are_lost_and_misplaced_as_told() -> None:
    poses = np.zeros((1000, 6))
    habits = Habits(dropped=0.2, outliers=3, outlier_distance=0.3)
    kept, seen = lose_samples(habits, poses, rng())
    assert 0.2 <= np.mean(~kept) < 0.206
    assert kept[[0, -1]].all()
    away = np.linalg.norm(seen[:, :3], axis=1)
    assert_allclose(away[away > 0], 0.3)
    assert np.count_nonzero(away[kept]) == 3
    assert_array_equal(seen[:10], 0.0)
    lengths = np.diff(np.flatnonzero(np.diff(kept.astype(int))))[::2]
    assert lengths.max() > 1, "in bursts"
    # Few samples, and all the same nothing breaks.
    kept, _ = lose_samples(Habits(dropped=0.5, outliers=20), poses[:3], rng())
    assert kept.sum() >= 2


LEVER = DoorConfig(radius=0.65, handle="lever", latch="spring")
KINDS = [
    dataclasses.replace(LEVER, handle=handle, swing=swing, hinge_side=side)
    for handle in ("lever", "knob")
    for swing in ("pull", "push")
    for side in ("right", "left")
]


def shown(door: DoorConfig, seed: int = 0) -> np.ndarray:
    return Teacher(TeacherConfig(**NOISELESS)).demonstrate(door, rng(seed)).poses


def angles_of(door: DoorConfig, poses: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Opening and handle angle of poses: R = exp(φ a) exp(θ t) with a ⟂ t."""
    geometry = DoorGeometry.of(door)
    assert geometry.turn is not None
    axis, turn = np.array(geometry.axis), np.array(geometry.turn)
    rotations = Rotation.from_rotvec(poses[:, 3:].copy())
    # φ from where t goes, θ from the rest.
    image = rotations.apply(turn)
    opened = np.arctan2(np.cross(turn, image) @ axis, image @ turn)
    rest = Rotation.from_rotvec(-opened[:, None] * axis) * rotations
    moved = rest.apply(axis)
    turned = np.arctan2(-moved @ np.cross(axis, turn), moved @ axis)
    # The hand turns by half of the leaf where it pushes a knob.
    share = 0.5 if (door.handle, door.swing) == ("knob", "push") else 1.0
    return opened / share, turned


@pytest.mark.parametrize("door", KINDS, ids=lambda d: "-".join(d.kind.values()))
def test_the_hand_follows_handle_and_door(door: DoorConfig) -> None:
    poses = shown(door)
    opened, turned = angles_of(door, poses)
    # The positions are those of a hand that holds the handle rigidly.
    expected = DoorGeometry.of(door).hand_poses(opened, turned)
    assert_allclose(poses[:, :3], expected[:, :3], atol=1e-9)
    assert opened[-1] == pytest.approx(np.radians(67.0), abs=np.radians(4.0))
    assert np.all(np.diff(opened) > -1e-9)
    # Nobody opens a latched door: it begins to move where the handle has gone most of
    # its travel, and the handle is nearly back when the door is half open.
    begins = np.flatnonzero(opened > np.radians(0.2))[0]
    assert turned[begins] > 0.8 * door.handle_travel
    assert turned.max() <= door.handle_travel + 1e-9
    resting = 0.2 * turned.max()
    assert_allclose(turned[opened > np.radians(26.0)], resting, atol=1e-9)


def test_a_left_door_is_the_mirror_of_a_right_one() -> None:
    right = shown(LEVER)
    left = shown(dataclasses.replace(LEVER, hinge_side="left"))
    mirrored = right * np.array([1.0, 1.0, -1.0, -1.0, -1.0, 1.0])
    assert_allclose(left, mirrored, atol=1e-12)


def test_nobody_turns_a_handle_beyond_its_stop() -> None:
    draws = rng()
    presses = [draw_press(LEVER, draws) for _ in range(200)]
    assert max(press.angle for press in presses) <= LEVER.handle_travel
    assert min(press.time for press in presses) >= 0.4
    angles = np.radians([0.0, 8.0, 16.5, 25.0, 60.0])
    back = handle_angles(Press(time=1.0, angle=0.8), np.ones(5), angles)
    assert_allclose(back, [0.8, 0.8, 0.48, 0.16, 0.16], atol=1e-12)


def test_doors_of_a_kind_are_demonstrated() -> None:
    plain = doors_like(DoorConfig(radius=0.42, hinge_friction=2.0))
    assert plain == tuple(DoorConfig(radius=radius) for radius in DEMONSTRATED_RADII)
    heavy = dataclasses.replace(LEVER, hinge_friction=2.0, swing="push")
    rooms = doors_like(heavy)
    assert [door.radius for door in rooms] == list(ROOM_RADII)
    assert all(door.kind == heavy.kind for door in rooms)
    assert all(door.hinge_friction == DoorConfig().hinge_friction for door in rooms)
