"""Logs of episodes and their measures, forecast errors included, on logs by formula."""

import json
import math

import numpy as np
import pytest
from numpy.testing import assert_allclose
from scipy.signal import savgol_filter

from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.episodes.log import PARTS, EpisodeLog, arrays_of
from gplfd_experiments.episodes.metrics import (
    PROGRESS,
    door_acceleration,
    episode_metrics,
    forecast_errors,
    handle_path,
    late_decisions,
    log_dimensionless_jerk,
    opening_motion,
    squared_distances,
    sustained,
    work_on_door,
)
from gplfd_experiments.files.arrays import smoothed


def test_round_trip_is_exact(tmp_path, make_log):
    log = make_log(predicted_std=np.full((601, 6), np.nan))
    log.save(tmp_path / "log.npz")
    loaded = EpisodeLog.load(tmp_path / "log.npz")
    assert (repr(loaded), loaded.door_config) == (repr(log), log.door_config)
    assert loaded.times.tobytes() == log.times.tobytes()
    for part, record in PARTS.items():
        for name in arrays_of(record):
            saved, read = (getattr(getattr(of, part), name) for of in (log, loaded))
            assert saved.dtype == read.dtype, name
            assert saved.tobytes() == read.tobytes(), name
    (tmp_path / "log.npz").write_bytes(b"\x89PNG\r\n\x1a\n")
    with pytest.raises(ValueError, match=r"log\.npz cannot be read as"):
        EpisodeLog.load(tmp_path / "log.npz")


def test_wrong_shape_names_the_array(make_log):
    with pytest.raises(ValueError, match=r"EpisodeLog\.forecasts\.mean has shape"):
        make_log(forecast_mean=np.zeros((3, 20, 6)))


DT = 0.01


def test_work_is_force_times_arc_length_and_the_energy_of_a_spring(make_log):
    angle = math.radians(66.0)
    assert episode_metrics(make_log())["work"] == pytest.approx(8.0 * 0.5 * angle)
    spring = 4.0 * make_log().opening.door_angle / 0.5  # 4 N m/rad at the hinge
    log = make_log(force_tangential=spring)
    assert episode_metrics(log)["work"] == pytest.approx(0.5 * 4.0 * angle**2, rel=1e-4)


def test_work_on_a_lever_is_done_where_the_hand_is(make_log):
    """3 cm from its end, and nearer to the hinge than its axis."""
    door = {"radius": 0.5, "handle": "lever", "lockset": {"handle_length": 0.12}}
    log = make_log(force_tangential=np.full(601, 10.0), door_config=door)
    turned = log.opening.door_angle[-1] - log.opening.door_angle[0]
    assert work_on_door(log) == pytest.approx(10.0 * 0.41 * turned)


def test_prediction_error_is_bias_squared_plus_variance_of_the_opening(make_log):
    """Section IV-B: E[ε²] = (E[f*] - f)² + var f*; before and after do not count."""
    log = make_log()
    std, opening = np.ones((601, 6)), opening_motion(log)
    std[opening] = log.decisions.predicted_std[opening]
    metrics = episode_metrics(make_log(predicted_std=std))
    expected = 3 * (0.003**2 + 0.004**2)
    assert metrics["prediction_error_position"] == pytest.approx(expected)
    assert metrics["prediction_error_rotation"] == pytest.approx(expected)
    ends = np.degrees(log.opening.door_angle[[opening.start, opening.stop - 1]])
    assert ends == pytest.approx([1.0, 65.0], abs=0.2)


def test_policies_without_predictions_or_stiffness_have_no_metrics_of_them(make_log):
    names = ("predicted_mean", "predicted_std", "stiffness", "stability_margin")
    forecasts = {
        **dict.fromkeys(("forecast_times", "forecast_phases"), np.empty(0)),
        **dict.fromkeys(("forecast_mean", "forecast_std"), np.empty((0, 0, 6))),
    }
    nothing = dict.fromkeys(names, np.full((601, 6), np.nan))
    metrics = episode_metrics(make_log(**nothing, **forecasts))
    for name in ("prediction_error_position", "stiffness_min", "stiffness_max"):
        assert metrics[name] is None
    assert metrics["stability_margin_translation"] is None
    assert metrics["forecast_error_mm"] == [None] * len(PROGRESS)
    assert json.loads(json.dumps(metrics, allow_nan=False)) == metrics


def test_times_to_angles_are_those_of_the_minimum_jerk_profile(make_log):
    to_60_degrees = make_log().opening.door_angle * (60.0 / 66.0)
    metrics = episode_metrics(make_log(door_angle=to_60_degrees + 1e-9))
    assert metrics["time_to_30_deg"] == pytest.approx(3.0)  # half way at half time
    assert metrics["time_to_60_deg"] == pytest.approx(6.0, abs=0.05)
    assert metrics["final_angle_deg"] == pytest.approx(60.0)
    halved = episode_metrics(make_log(door_angle=0.5 * to_60_degrees + 1e-9))
    assert halved["time_to_15_deg"] == pytest.approx(3.0)
    assert halved["time_to_60_deg"] is None


def test_log_dimensionless_jerk_of_a_minimum_jerk_motion():
    """∫ jerk² = 720 L²/T⁵ and v_peak = 15 L/(8 T), whatever L and T."""
    for length, duration in ((0.3, 2.0), (1.1, 6.0)):
        dt = 0.01
        s = np.arange(0.0, duration + dt / 2, dt) / duration
        path = np.outer(length * s**3 * (10 - 15 * s + 6 * s**2), [0.6, 0.0, 0.8])
        expected = -math.log(720.0 * (8.0 / 15.0) ** 2)
        assert log_dimensionless_jerk(path, dt) == pytest.approx(expected, abs=1e-3)
        shaky = path + 1e-4 * np.sin(40.0 * duration * s)[:, None]
        assert log_dimensionless_jerk(shaky, dt) < expected - 1.0
    assert log_dimensionless_jerk(np.zeros((10, 3)), 0.01) is None
    assert log_dimensionless_jerk(np.zeros((100, 3)), 0.01) is None


def test_forces_use_magnitudes(make_log):
    radial = np.concatenate([[-30.0], np.linspace(0.0, 10.0, 600)])
    metrics = episode_metrics(make_log(force_radial=radial))
    assert metrics["force_radial_peak"] == 30.0
    expected = np.percentile(np.abs(radial), 95)
    assert metrics["force_radial_p95"] == pytest.approx(expected)
    assert metrics["force_tangential_peak"] == metrics["force_tangential_p95"] == 8.0


def test_stiffness_margin_latency_and_slip(make_log):
    stiffness = np.tile([300.0, 200.0, 100.0, 1.0, 1.0, 1.0], (601, 1))
    stiffness[7, 2] = 450.0
    margin = np.full((601, 6), 80.0)
    margin[5, 1], margin[9, 4] = -4.0, -2.0
    latency = np.linspace(0.0, 2e-3, 601)
    latency[np.arange(601) % 10 > 0] = np.nan  # not measured
    metrics = episode_metrics(
        make_log(stiffness=stiffness, stability_margin=margin, latency_s=latency)
    )
    assert metrics["stiffness_min"] == [300.0, 200.0, 100.0]
    assert metrics["stiffness_max"] == [300.0, 200.0, 450.0]
    assert metrics["stability_margin_translation"] == -4.0
    assert metrics["stability_margin_rotation"] == -2.0
    assert metrics["latency_median_ms"] == pytest.approx(1.0)
    assert metrics["latency_p95_ms"] == pytest.approx(1.9)
    assert metrics["slip_max_mm"] == pytest.approx(2.0)
    assert metrics["duration"] == pytest.approx(6.0)


def test_late_decisions_are_counted_by_wall_time(make_log):
    late, in_time = (
        episode_metrics(make_log(latency_wall_s=np.full(601, seconds)))
        for seconds in (0.02, 0.002)
    )
    assert late_decisions([in_time]) == ""
    assert "in 1 of 2 episodes (median 20.0 ms" in late_decisions([late, in_time])


def test_a_door_that_never_moved_has_metrics(make_log):
    still = {"door_angle": np.zeros(601), "ee_pose": np.zeros((601, 6))}
    metrics = episode_metrics(make_log(**still))
    assert metrics["time_to_15_deg"] is None
    assert metrics["work"] == 0.0
    assert metrics["log_dimensionless_jerk"] is None
    # Nor was it disturbed, so that there is nothing to recover from.
    assert metrics["person_force_peak"] == metrics["stop_force_sustained"] == 0.0
    assert metrics["push_displacement_mm"] is None
    assert metrics["release_speed"] is metrics["recovery_time"] is None


def test_governed_share_counts_decisions_at_the_bound(make_log):
    free = make_log()
    steps = free.times.size
    margin, rate = np.full((steps, 6), 50.0), np.full((steps, 6), 50.0)
    margin[: steps // 4, 2], rate[: steps // 4, 2] = 0.1, 99.9
    governed = make_log(stability_margin=margin, stiffness_rate=rate)
    share = episode_metrics(governed)["governed_share"]
    assert share == pytest.approx((steps // 4) / steps)
    falling = make_log(
        stability_margin=np.full((steps, 6), 150.0),
        stiffness_rate=np.full((steps, 6), -50.0),
    )
    assert episode_metrics(falling)["governed_share"] == 0.0


def test_acceleration_of_a_parabola_is_constant():
    times = DT * np.arange(100)
    assert door_acceleration(0.3 * times - 0.7 * times**2, DT) == pytest.approx(
        np.full(100, -1.4)
    )
    assert door_acceleration(times[:20], DT) is None


@pytest.mark.parametrize("mode", ["interp", "nearest"])
def test_derivatives_are_those_of_scipy(mode):
    values = np.random.default_rng(0).standard_normal((60, 3))
    for window, order, deriv in ((5, 2, 1), (7, 5, 3), (21, 3, 0)):
        ours = smoothed(values, window, order, deriv=deriv, step=DT, mode=mode)
        options = {"deriv": deriv, "delta": DT, "axis": 0, "mode": mode}
        assert_allclose(ours, savgol_filter(values, window, order, **options))


def test_indicators_of_a_minimum_jerk_opening(make_log):
    """Its greatest acceleration is 10 / √3 · φ / T², at a share of 0.211 of T."""
    metrics = episode_metrics(make_log())
    angle = math.radians(66.0)
    expected = 10.0 / math.sqrt(3.0) * angle / 6.0**2
    assert metrics["door_acceleration_peak"] == pytest.approx(expected, rel=0.01)
    # ∫ φ̈² dt = 120/7 φ² / T³ of the quintic.
    square = 120.0 / 7.0 * angle**2 / 6.0**3 / DT
    assert metrics["door_smoothness"] == pytest.approx(1 / math.sqrt(square), rel=0.02)
    assert metrics["time_to_move"] == pytest.approx(0.74)
    assert metrics["force_handle_peak"] == pytest.approx(math.hypot(8.0, 3.0))


def test_only_what_lasts_half_a_second_is_sustained():
    force = np.zeros(300)
    force[20:60] = 100.0
    assert sustained(force, DT) == 0.0
    force[100:160] = 30.0
    force[120] = 20.0
    assert sustained(force, DT) == 20.0
    force[200:250] = 50.0
    assert sustained(force, DT) == 50.0
    # One sample decides a peak, but nothing that lasts for 20 ms.
    force[280] = 900.0
    assert sustained(force, DT, 0.02) == 100.0


def test_the_impulse_across_the_path_is_that_of_the_radial_force(make_log):
    metrics = episode_metrics(make_log())
    # 3 N all the time, of which no sample is alone.
    assert metrics["force_radial_impulse"] == pytest.approx(3.0 * 600 * DT)
    assert metrics["force_radial_20ms"] == metrics["force_radial_peak"] == 3.0


def test_recovery_begins_when_the_last_disturbance_ends(make_log):
    held, energy = np.zeros(601), np.linspace(0.0, 3.0, 601)
    held[50:150] = np.linspace(1.0, 40.0, 100)
    log = make_log(person_force=held, person_energy=energy)
    metrics = episode_metrics(log)
    assert metrics["person_force_peak"] == 40.0
    assert metrics["person_force_sustained"] == pytest.approx(
        np.linspace(1, 40, 100)[50]
    )
    assert metrics["person_energy"] == 3.0
    speed = np.gradient(log.opening.door_angle, DT)
    assert metrics["release_speed"] == speed[150:250].max() < speed[150:].max()
    later = log.times[
        log.opening.door_angle >= log.opening.door_angle[150] + math.radians(5.0)
    ][0]
    assert metrics["recovery_time"] == pytest.approx(later - log.times[150])
    # Still held at the end: there was no release.
    pushed = episode_metrics(make_log(person_force=np.ones(601)))
    assert pushed["release_speed"] is None
    stuck = np.minimum(log.opening.door_angle, log.opening.door_angle[150])
    assert (
        episode_metrics(make_log(stop_force=held, door_angle=stuck))["recovery_time"]
        is None
    )


def test_push_displacement_is_the_change_beside_the_path(make_log):
    log = make_log()
    pushed, pose = np.zeros(601), np.array(log.motion.ee_pose)
    pushed[100:130] = 15.0
    pose[:, 1] += 0.02  # beside the path all the time: not the push's doing
    pose[110:140, 2] += 0.005
    pose[300:, 0] += 0.1
    metrics = episode_metrics(make_log(push_force=pushed, ee_pose=pose))
    assert metrics["push_displacement_mm"] == pytest.approx(5.0)
    # Without a predicted path the command is the path.
    nothing = np.full((601, 6), np.nan)
    again = make_log(push_force=pushed, ee_pose=pose, desired=nothing)
    assert episode_metrics(again)["push_displacement_mm"] == pytest.approx(5.0)


ANGLE = math.radians(66.0)
PHASES = np.linspace(0.0, 1.0, 101)


@pytest.fixture
def forecasting(make_log):
    """An opening of 0.5 m during which the policy expects some radius."""

    def log(radius, *, at=PHASES, period=0.05, aside=0.0, **changes):
        times = np.arange(0.0, 6.0 + 1e-9, period)
        arc = np.array([handle_pose_on_arc(radius, ANGLE * phase) for phase in at])
        arc[:50, 1] += aside
        return make_log(
            forecast_times=times,
            forecast_phases=PHASES,
            forecast_mean=np.stack([arc] * times.size),
            forecast_std=np.ones((times.size, 101, 6)),
            **changes,
        )

    return log


def test_error_of_a_wrong_radius_is_the_distance_of_the_arcs(forecasting):
    log = forecasting(0.4)
    errors = forecast_errors(log, ANGLE)
    phi = np.linspace(0.05 * ANGLE, ANGLE, 2000)
    # Both arcs begin at the handle: their hinges are 0.1 m apart.
    x, z = 0.5 * np.sin(phi), -0.5 * (1.0 - np.cos(phi))
    radial = np.abs(np.hypot(x, z + 0.4) - 0.4)
    end = handle_pose_on_arc(0.4, ANGLE)
    beyond = np.arctan2(x, z + 0.4) > ANGLE
    radial[beyond] = np.hypot(x - end[0], z - end[2])[beyond]
    assert errors[0] == pytest.approx(math.sqrt(np.mean(radial**2)), rel=0.03)
    # When the policy expects to be where does not matter.
    hurried = forecast_errors(forecasting(0.4, at=PHASES**2), ANGLE)
    assert hurried == pytest.approx(errors, rel=1e-2)
    # Metrics have the errors in millimetres.
    metrics = episode_metrics(log, demonstrated_angle=ANGLE)
    expected = [1e3 * error for error in errors if error]
    assert metrics["forecast_error_mm"] == pytest.approx(expected)
    assert metrics["forecast_error_mm"][0] > 5.0


def test_only_what_is_to_come_is_judged(forecasting):
    """A policy that knows the door makes no error."""
    errors = forecast_errors(forecasting(0.5), ANGLE)
    assert len(errors) == len(PROGRESS)
    # The path of straight pieces between a hundred points cuts the corners.
    assert max(errors) < 1e-4
    errors = forecast_errors(forecasting(0.5, aside=1.0), ANGLE)
    assert min(errors[:4]) > 0.02
    assert max(errors[5:]) < 1e-4


def test_a_door_that_stops_has_no_forecasts_beyond(forecasting):
    angle = 0.5 * forecasting(0.5).opening.door_angle
    pose = np.array([handle_pose_on_arc(0.5, phi) for phi in angle])
    stopped = forecasting(0.5, door_angle=angle, handle_pose=pose)
    errors = forecast_errors(stopped, ANGLE)
    assert all(error is not None for error in errors[:5])
    assert errors[5:] == (None,) * 5


def test_a_forecast_that_comes_too_late_does_not_count(forecasting):
    errors = forecast_errors(forecasting(0.5, period=1.5), ANGLE)
    # At 1.5, 3 and 4.5 s the door is open by 0.10, 0.5 and 0.90 of its angle.
    known = [share for share, error in zip(PROGRESS, errors, strict=True) if error]
    assert known == [0.05, 0.45, 0.85]


def test_the_arc_lies_as_the_handle_does(make_log):
    """A robot that stands askew by 3 degrees, with the bar off the hand's middle."""
    turn = math.radians(3.0)
    angle = 0.1 + make_log().opening.door_angle
    pose = np.array([handle_pose_on_arc(0.5, phi) for phi in angle])
    x, z = pose[:, 0].copy(), pose[:, 2].copy()
    pose[:, 0] = math.cos(turn) * x + math.sin(turn) * z + 0.004
    pose[:, 2] = math.cos(turn) * z - math.sin(turn) * x - 0.002
    pose[:, 1] = 0.01
    path = handle_path(make_log(door_angle=angle, handle_pose=pose), angle)
    assert_allclose(path, pose[:, :3], atol=1e-12)


def test_distance_from_a_path_is_that_from_its_nearest_piece():
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.5, -0.2, 0], [2, 2, 0], [-3, 0, 4], [1.5, 0.5, 0]])
    distances = np.sqrt(squared_distances(points, path))
    assert distances == pytest.approx([0.2, math.sqrt(2.0), 5.0, 0.5])


@pytest.mark.parametrize("name", ["oven", "overhead-flap", "rising-butt"])
def test_the_path_of_a_handle_that_rises_or_sinks_is_its_own(make_log, name):
    config = DOORS[name]
    geometry, angle = DoorGeometry.of(config), np.linspace(0.0, ANGLE, 601)
    pose = geometry.hand_poses(angle) + np.array([0.01, -0.02, 0.003, 0, 0, 0])
    log = make_log(door_angle=angle, handle_pose=pose, door_config=config.as_dict())
    assert_allclose(handle_path(log, angle), pose[:, :3], atol=1e-9)


@pytest.mark.parametrize("swing", ["pull", "push"])
@pytest.mark.parametrize("side", ["right", "left"])
def test_the_path_of_a_lever_is_its_hand_s_on_every_side(make_log, swing, side):
    """The lever is turned at first, and is let back later."""
    config = {"radius": 0.65, "handle": "lever", "swing": swing, "hinge_side": side}
    geometry = DoorGeometry.of(DoorConfig(**config))
    angle = np.linspace(0.0, ANGLE, 601)
    turn = 0.8 * np.sin(np.pi * np.clip(3.0 * angle / ANGLE, 0.0, 1.0))
    pose = geometry.hand_poses(angle, turn)
    log = make_log(
        door_angle=angle, handle_angle=turn, handle_pose=pose, door_config=config
    )
    ahead = np.linspace(0.2, 1.2, 9)
    expected = geometry.hand_poses(ahead)[:, :3]
    assert_allclose(handle_path(log, ahead), expected, atol=1e-9)
