"""Errors of forecasts: what is still to come, wherever the robot stands."""

import math
from collections.abc import Callable
from typing import Any

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
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics

MakeLog = Callable[..., EpisodeLog]
ANGLE = math.radians(66.0)


def forecasting(make_log: MakeLog, radius: float, period: float = 0.05) -> EpisodeLog:
    """An opening of 0.5 m during which the policy expects some radius."""
    times = np.arange(0.0, 6.0 + 1e-9, period)
    phases = np.linspace(0.0, 1.0, 101)
    arc = np.array([handle_pose_on_arc(radius, ANGLE * phase) for phase in phases])
    return make_log(
        forecast_times=times,
        forecast_phase=phases,
        forecast_mean=np.stack([arc] * times.size),
        forecast_std=np.ones((times.size, 101, 6)),
    )


def test_a_policy_that_knows_the_door_makes_no_error(make_log):
    errors = forecast_errors(forecasting(make_log, 0.5), ANGLE)
    assert len(errors) == len(PROGRESS)
    # The path of straight pieces between a hundred points cuts the corners.
    assert max(errors) < 1e-4


def test_error_of_a_wrong_radius_is_the_distance_of_the_arcs(make_log):
    error = forecast_errors(forecasting(make_log, 0.4), ANGLE)[0]
    phi = np.linspace(0.05 * ANGLE, ANGLE, 2000)
    # Both arcs begin at the handle: their hinges are 0.1 m apart.
    x, z = 0.5 * np.sin(phi), -0.5 * (1.0 - np.cos(phi))
    radial = np.abs(np.hypot(x, z + 0.4) - 0.4)
    end = handle_pose_on_arc(0.4, ANGLE)
    beyond = np.arctan2(x, z + 0.4) > ANGLE
    radial[beyond] = np.hypot(x - end[0], z - end[2])[beyond]
    assert error == pytest.approx(math.sqrt(np.mean(radial**2)), rel=0.03)


def test_only_what_is_to_come_is_judged(make_log):
    log = forecasting(make_log, 0.5)
    mean = np.array(log.forecast_mean)
    mean[:, :50, 1] += 1.0
    changed = make_log(
        **{
            name: getattr(log, name)
            for name in ("forecast_times", "forecast_phase", "forecast_std")
        },
        forecast_mean=mean,
    )
    errors = forecast_errors(changed, ANGLE)
    assert min(errors[:4]) > 0.02
    assert max(errors[5:]) < 1e-4


def test_when_the_policy_expects_to_be_where_does_not_matter(make_log):
    log = forecasting(make_log, 0.4)
    uneven = np.linspace(0.0, 1.0, 101) ** 2
    arc = np.array([handle_pose_on_arc(0.4, ANGLE * phase) for phase in uneven])
    hurried = make_log(
        forecast_times=log.forecast_times,
        forecast_phase=log.forecast_phase,
        forecast_mean=np.stack([arc] * log.forecast_times.size),
        forecast_std=log.forecast_std,
    )
    assert forecast_errors(hurried, ANGLE) == pytest.approx(
        forecast_errors(log, ANGLE), rel=1e-2
    )


def test_a_door_that_stops_has_no_forecasts_beyond(make_log):
    log = forecasting(make_log, 0.5)
    names = ("forecast_times", "forecast_phase", "forecast_mean", "forecast_std")
    angle = 0.5 * log.door_angle
    pose = np.array([handle_pose_on_arc(0.5, phi) for phi in angle])
    stopped = make_log(
        door_angle=angle,
        handle_pose=pose,
        **{name: getattr(log, name) for name in names},
    )
    errors = forecast_errors(stopped, ANGLE)
    assert all(error is not None for error in errors[:5])
    assert errors[5:] == (None,) * 5


def test_a_forecast_that_comes_too_late_does_not_count(make_log):
    errors = forecast_errors(forecasting(make_log, 0.5, period=1.5), ANGLE)
    # At 1.5, 3 and 4.5 s the door is open by 0.10, 0.5 and 0.90 of its angle.
    known = [share for share, error in zip(PROGRESS, errors, strict=True) if error]
    assert known == [0.05, 0.45, 0.85]


def test_policies_without_forecasts_have_no_errors(make_log):
    silent = make_log(
        forecast_times=np.empty(0),
        forecast_phase=np.empty(0),
        forecast_mean=np.empty((0, 0, 6)),
        forecast_std=np.empty((0, 0, 6)),
    )
    metrics = episode_metrics(silent).as_json()
    assert metrics["forecast_progress"] == list(PROGRESS)
    assert metrics["forecast_error_mm"] == [None] * 10


def test_metrics_have_the_errors_in_millimetres(make_log):
    log = forecasting(make_log, 0.4)
    metrics = episode_metrics(log, demonstrated_angle=ANGLE)
    expected = [1e3 * error for error in forecast_errors(log, ANGLE) if error]
    assert metrics.forecast_error_mm == pytest.approx(expected)
    assert metrics.forecast_error_mm[0] > 5.0


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
    distances: Any = np.sqrt(squared_distances(points, path))
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
