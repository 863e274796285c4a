import dataclasses
import math

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.teacher import Teacher, TeacherConfig
from gplfd_experiments.data.teacher.random_motion import (
    coloured_noise,
    minimum_jerk,
    smooth_functions,
)

QUIET = TeacherConfig(
    duration_std=0.0,
    angle_std=0.0,
    timing_std=0.0,
    wobble_position_std=0.0,
    wobble_rotation_std=0.0,
    grasp_offset_std=0.0,
    vertical_drift_std=0.0,
    noise_position_std=0.0,
    noise_rotation_std=0.0,
)


def rng(seed: int = 0) -> np.random.Generator:
    return np.random.default_rng(seed)


def test_without_disturbances_the_hand_follows_the_closed_form_arc() -> None:
    demonstration = Teacher(QUIET).demonstrate(0.5, rng())
    phi = QUIET.angle_mean * minimum_jerk(demonstration.times / QUIET.duration_mean)
    zero = np.zeros_like(phi)
    arc = [0.5 * np.sin(phi), zero, -0.5 * (1 - np.cos(phi)), zero, phi, zero]
    np.testing.assert_allclose(demonstration.poses, np.stack(arc, axis=1), atol=1e-12)


def test_defaults_are_a_sampled_suit_recording_that_starts_at_zero() -> None:
    demonstration = Teacher().demonstrate(0.5, rng())
    np.testing.assert_allclose(np.diff(demonstration.times), 1 / 60, rtol=1e-9)
    assert np.all(demonstration.poses[0] == 0.0)
    assert 4.0 < demonstration.times[-1] < 8.5
    assert math.degrees(demonstration.poses[-1, 4]) == pytest.approx(67.0, abs=6.0)


def test_same_seed_gives_the_same_bits() -> None:
    first, second = (Teacher().demonstrate_doors([0.35, 0.5], rng=rng()) for _ in "ab")
    for one, other in zip(first, second, strict=True):
        assert one.times.tobytes() == other.times.tobytes()
        assert one.poses.tobytes() == other.poses.tobytes()


def test_more_doors_or_demonstrations_leave_the_earlier_ones_alone() -> None:
    few = Teacher().demonstrate_doors([0.35, 0.5], 2, rng=rng())
    more = Teacher().demonstrate_doors([0.35, 0.5, 0.65], 3, rng=rng())
    for kept, index in zip(few, (0, 1, 3, 4), strict=True):
        assert kept.poses.tobytes() == more[index].poses.tobytes()


def test_effects_draw_independently() -> None:
    silent = dataclasses.replace(QUIET, grasp_offset_std=0.01)
    noisy = dataclasses.replace(silent, noise_position_std=1e-6, timing_std=0.0)
    one, other = (Teacher(config).demonstrate(0.5, rng()) for config in (silent, noisy))
    np.testing.assert_allclose(one.poses, other.poses, atol=1e-5)


def test_timing_is_uneven_and_never_goes_back() -> None:
    uneven = dataclasses.replace(QUIET, timing_std=0.5)
    angle = Teacher(uneven).demonstrate(0.5, rng()).poses[:, 4]
    even = Teacher(QUIET).demonstrate(0.5, rng()).poses[:, 4]
    assert np.all(np.diff(angle) >= 0.0)
    assert angle[-1] == pytest.approx(even[-1], abs=1e-12)
    assert np.abs(angle - even).max() > math.radians(2.0)


def test_grasp_offset_changes_the_apparent_arc_by_the_rotated_offset() -> None:
    config = dataclasses.replace(QUIET, grasp_offset_std=0.01)
    poses = Teacher(config).demonstrate(0.5, rng()).poses
    arc = Teacher(QUIET).demonstrate(0.5, rng()).poses
    turn = Rotation.from_rotvec(np.array(arc[:, 3:])).as_matrix() - np.eye(3)
    # (R - 1) offset = difference, for one offset over all samples.
    difference = (poses - arc)[:, :3].reshape(-1)
    offset, residual, *_ = np.linalg.lstsq(turn.reshape(-1, 3), difference, rcond=None)
    assert np.all(residual < 1e-20)
    assert 1e-3 < np.linalg.norm(offset[[0, 2]]) < 0.05


def test_drift_is_vertical_and_linear() -> None:
    config = dataclasses.replace(QUIET, vertical_drift_std=0.001)
    demonstration = Teacher(config).demonstrate(0.5, rng())
    rate = demonstration.poses[-1, 1] / demonstration.times[-1]
    np.testing.assert_allclose(
        demonstration.poses[:, 1], rate * demonstration.times, atol=1e-12
    )
    assert rate != 0.0


def test_smooth_functions_have_the_stated_covariance() -> None:
    times = np.array([0.0, 0.5, 1.0, 2.0])
    values = smooth_functions(times, 1.0, 20_000, rng())
    sample = values @ values.T / values.shape[1]
    expected = np.exp(-0.5 * (times[:, None] - times) ** 2)
    np.testing.assert_allclose(sample, expected, atol=0.03)


def test_smooth_functions_do_not_depend_on_the_sampling() -> None:
    coarse = smooth_functions(np.array([0.0, 1.0]), 1.0, 2, rng())
    fine = smooth_functions(np.array([0.0, 0.5, 1.0]), 1.0, 2, rng())
    np.testing.assert_array_equal(coarse, fine[::2])


@pytest.mark.parametrize("bandwidth", [0.05, 0.13, 0.6])
def test_coloured_noise_has_unit_variance_from_its_first_sample(
    bandwidth: float,
) -> None:
    noise = coloured_noise(20, bandwidth, 20_000, rng())
    np.testing.assert_allclose(noise[[0, -1]].std(axis=1), 1.0, atol=0.03)


def test_coloured_noise_has_no_power_above_its_bandwidth() -> None:
    noise = coloured_noise(4096, 0.05, 8, rng())
    power = np.mean(np.abs(np.fft.rfft(noise, axis=0)) ** 2, axis=1)
    frequency = np.fft.rfftfreq(4096)
    assert power[frequency > 0.2].mean() < 0.01 * power[frequency < 0.03].mean()


@pytest.mark.parametrize(
    ("field", "value"),
    [("duration_mean", 0.0), ("sampling_rate", math.nan), ("timing_std", -0.1)],
)
def test_config_names_field_value_and_range(field: str, value: float) -> None:
    with pytest.raises(ValueError, match=rf"TeacherConfig\.{field} = {value}.*\["):
        TeacherConfig(**{field: value})


def test_wrong_requests_are_refused() -> None:
    with pytest.raises(ValueError, match=r"radius = -1\.0 is outside"):
        Teacher().demonstrate(-1.0, rng())
    with pytest.raises(ValueError, match="doors is empty"):
        Teacher().demonstrate_doors([], rng=rng())
    with pytest.raises(ValueError, match="per_door = 0 must be at least 1"):
        Teacher().demonstrate_doors([0.5], 0, rng=rng())
