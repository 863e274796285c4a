"""Errors of forecasts: what is still to come, wherever the robot stands."""

import math

import numpy as np
import pytest

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.episodes.forecast_error import (
    PROGRESS,
    forecast_errors,
    handle_path,
    squared_distances,
)
from gplfd_experiments.episodes.metrics import episode_metrics

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
            forecast_phase=PHASES,
            forecast_mean=np.stack([arc] * times.size),
            forecast_std=np.ones((times.size, 101, 6)),
            **changes,
        )

    return log


def test_a_policy_that_knows_the_door_makes_no_error(forecasting):
    errors = forecast_errors(forecasting(0.5), ANGLE)
    assert len(errors) == len(PROGRESS)
    # The path of straight pieces between a hundred points cuts the corners.
    assert max(errors) < 1e-4


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
    assert metrics.forecast_error_mm == pytest.approx(expected)
    assert metrics.forecast_error_mm[0] > 5.0


def test_only_what_is_to_come_is_judged(forecasting):
    errors = forecast_errors(forecasting(0.5, aside=1.0), ANGLE)
    assert min(errors[:4]) > 0.02
    assert max(errors[5:]) < 1e-4


def test_a_door_that_stops_has_no_forecasts_beyond(forecasting):
    angle = 0.5 * forecasting(0.5).door_angle
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


def test_policies_without_forecasts_have_no_errors(make_log):
    names = ("forecast_times", "forecast_phase")
    curves = ("forecast_mean", "forecast_std")
    silent = make_log(
        **dict.fromkeys(names, np.empty(0)),
        **dict.fromkeys(curves, np.empty((0, 0, 6))),
    )
    metrics = episode_metrics(silent).as_json()
    assert metrics["forecast_progress"] == list(PROGRESS)
    assert metrics["forecast_error_mm"] == [None] * 10


def test_the_arc_lies_as_the_handle_does(make_log):
    """A robot that stands askew by 3 degrees, with the bar off the hand's middle."""
    turn = math.radians(3.0)
    angle = 0.1 + make_log().door_angle
    pose = np.array([handle_pose_on_arc(0.5, phi) for phi in angle])
    x, z = pose[:, 0].copy(), pose[:, 2].copy()
    pose[:, 0] = math.cos(turn) * x + math.sin(turn) * z + 0.004
    pose[:, 2] = math.cos(turn) * z - math.sin(turn) * x - 0.002
    pose[:, 1] = 0.01
    path = handle_path(make_log(door_angle=angle, handle_pose=pose), angle)
    np.testing.assert_allclose(path, pose[:, :3], atol=1e-12)


def test_distance_from_a_path_is_that_from_its_nearest_piece():
    path = np.array([[0.0, 0, 0], [1, 0, 0], [1, 0, 0], [1, 1, 0]])
    points = np.array([[0.5, -0.2, 0], [2, 2, 0], [-3, 0, 4], [1.5, 0.5, 0]])
    distances = np.sqrt(squared_distances(points, path))
    assert distances == pytest.approx([0.2, math.sqrt(2.0), 5.0, 0.5])


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
    np.testing.assert_allclose(handle_path(log, ahead), expected, atol=1e-9)
