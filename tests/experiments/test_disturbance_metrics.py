"""Measures of gentleness and of what follows a disturbance, on logs by formula."""

import math

import numpy as np
import pytest

from gplfd_experiments.episodes.metrics import (
    door_acceleration,
    episode_metrics,
    release,
    sustained,
)

DT = 0.01


def test_acceleration_of_a_parabola_is_constant():
    times = DT * np.arange(100)
    assert door_acceleration(0.3 * times - 0.7 * times**2, DT) == pytest.approx(
        np.full(100, -1.4)
    )
    assert door_acceleration(times[:20], DT) is None


def test_indicators_of_a_minimum_jerk_opening(make_log):
    """Its greatest acceleration is 10 / √3 · φ / T², at a share of 0.211 of T."""
    metrics = episode_metrics(make_log())
    angle = math.radians(66.0)
    expected = 10.0 / math.sqrt(3.0) * angle / 6.0**2
    assert metrics.door_acceleration_peak == pytest.approx(expected, rel=0.01)
    # ∫ φ̈² dt = 120/7 φ² / T³ of the quintic.
    square = 120.0 / 7.0 * angle**2 / 6.0**3 / DT
    assert metrics.door_smoothness == pytest.approx(1 / math.sqrt(square), rel=0.02)
    assert metrics.time_to_move == pytest.approx(0.74)
    assert metrics.force_handle_peak == pytest.approx(math.hypot(8.0, 3.0))
    # Undisturbed, it has nothing to recover from.
    assert metrics.person_force_peak == metrics.stop_force_sustained == 0.0
    assert metrics.push_displacement_mm is None
    assert metrics.release_speed is None
    assert metrics.recovery_time is None


def test_only_what_lasts_half_a_second_is_sustained():
    force = np.zeros(300)
    force[20:60] = 100.0
    assert sustained(force, DT) == 0.0
    force[100:160] = 30.0
    force[120] = 20.0
    assert sustained(force, DT) == 20.0
    force[200:250] = 50.0
    assert sustained(force, DT) == 50.0


def test_recovery_begins_when_the_last_disturbance_ends(make_log):
    held, energy = np.zeros(601), np.linspace(0.0, 3.0, 601)
    held[50:150] = np.linspace(1.0, 40.0, 100)
    log = make_log(person_force=held, person_energy=energy)
    metrics = episode_metrics(log)
    assert release(log) == 150
    assert metrics.person_force_peak == 40.0
    assert metrics.person_force_sustained == pytest.approx(np.linspace(1, 40, 100)[50])
    assert metrics.person_energy == 3.0
    speed = np.gradient(log.door_angle, DT)
    assert metrics.release_speed == speed[150:250].max() < speed[150:].max()
    later = log.times[log.door_angle >= log.door_angle[150] + math.radians(5.0)][0]
    assert metrics.recovery_time == pytest.approx(later - log.times[150])
    # Still held at the end: there was no release.
    assert release(make_log(person_force=np.ones(601))) is None
    stuck = np.minimum(log.door_angle, log.door_angle[150])
    metrics = episode_metrics(make_log(stop_force=held, door_angle=stuck))
    assert metrics.recovery_time is None


def test_push_displacement_is_the_change_beside_the_path(make_log):
    log = make_log()
    pushed, pose = np.zeros(601), np.array(log.ee_pose)
    pushed[100:130] = 15.0
    pose[:, 1] += 0.02  # beside the path all the time: not the push's doing
    pose[110:140, 2] += 0.005
    pose[300:, 0] += 0.1
    metrics = episode_metrics(make_log(push_force=pushed, ee_pose=pose))
    assert metrics.push_displacement_mm == pytest.approx(5.0)
    # Without a predicted path the command is the path.
    nothing = np.full((601, 6), np.nan)
    again = make_log(push_force=pushed, ee_pose=pose, desired=nothing)
    assert episode_metrics(again).push_displacement_mm == pytest.approx(5.0)
