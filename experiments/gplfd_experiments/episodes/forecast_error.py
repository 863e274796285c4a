"""Error of a policy's forecast of the handle's path during an opening."""

import math
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gplfd_env.doors.geometry import DoorGeometry
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray

PROGRESS: Final = (0.05, 0.15, 0.25, 0.35, 0.45, 0.55, 0.65, 0.75, 0.85, 0.95)
"""Door angles at which forecasts are scored, as shares of the demonstrated angle."""

_LATEST: Final = 0.1
"""Largest delay of a valid forecast, as a share of the demonstrated angle."""

_ARC_POINTS: Final = 100


def forecast_errors(
    log: EpisodeLog, demonstrated_angle: float
) -> tuple[float | None, ...]:
    """Return the error of the forecast made at each progress of `PROGRESS`.

    The truth is the handle's arc from its present angle to the demonstrated angle, even
    if the episode ended before. The error is the rms distance of points on this arc
    from the path of the forecast's mean; timing is ignored.
    """
    shares = [progress * demonstrated_angle for progress in PROGRESS]
    return tuple(_error(log, angle, demonstrated_angle) for angle in shares)


def _error(log: EpisodeLog, angle: float, demonstrated_angle: float) -> float | None:
    reached = log.opening.door_angle >= angle
    if not reached.any():
        return None
    # Half a microsecond of tolerance, because both times are sums of steps.
    asked = log.forecasts.times >= log.times[np.argmax(reached)] - 5e-7
    if not asked.any():
        return None
    forecast = int(np.argmax(asked))
    start = float(
        np.interp(log.forecasts.times[forecast], log.times, log.opening.door_angle)
    )
    if start >= min(angle + _LATEST * demonstrated_angle, demonstrated_angle):
        return None
    rest = handle_path(log, np.linspace(start, demonstrated_angle, _ARC_POINTS))
    squared = squared_distances(rest, log.forecasts.mean[forecast, :, :3])
    return math.sqrt(float(squared.mean()))


def handle_path(log: EpisodeLog, angles: FloatArray) -> FloatArray:
    """Return the handle's positions (N, 3) [m] at opening angles (N,) [rad].

    The arc is rotated and shifted to the logged handle: the robot may be misplaced.
    """
    door = DoorGeometry.of(log.config)
    logged = _plane(door.hand_poses(log.opening.door_angle, log.opening.handle_angle))
    seen = _plane(log.opening.handle_pose[:, :3])
    turn = np.vdot(logged - logged[0], seen - seen[0])
    placed = seen[0] + turn / abs(turn) * (_plane(door.hand_poses(angles)) - logged[0])
    height = np.full(angles.shape, log.opening.handle_pose[0, 1])
    return np.stack([placed.real, height, placed.imag], axis=1)


def _plane(positions: FloatArray) -> NDArray[np.complex128]:
    """Positions seen from above, as x + iz."""
    return positions[:, 0] + 1j * positions[:, 2]


def squared_distances(points: FloatArray, path: FloatArray) -> FloatArray:
    """Return squared distances of points (N, 3) from a path with corners (M, 3)."""
    start, step = path[:-1], np.diff(path, axis=0)
    length = np.maximum((step**2).sum(axis=1), np.finfo(float).tiny)
    offset = points[:, None] - start
    share = np.clip((offset * step).sum(axis=2) / length, 0.0, 1.0)
    gap = offset - share[..., None] * step
    return np.asarray((gap**2).sum(axis=2).min(axis=1))
