"""How gentle an episode was to door and people, and what it did when disturbed.

Acceleration and smoothness of the door are those of the EUROBENCH project's benchmark
of robots at doors, with its filter: a local parabola over 0.2 s. Forces on people are
compared with ISO/TS 15066, which limits what is borne for more than half a second and,
at twice that, what is borne for an instant.
"""

import math
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import minimum_filter1d
from scipy.signal import savgol_filter

from gplfd_experiments.episodes.log import EpisodeLog

FloatArray = NDArray[np.float64]

SUSTAINED: Final = 0.5
"""What is borne for this long is no longer an instant [s]."""

_FILTER_TIME: Final = 0.2
_MOVED: Final = math.radians(1.0)
_RECOVERED: Final = math.radians(5.0)
_AFTER: Final = 1.0


def disturbance_metrics(log: EpisodeLog) -> dict[str, Any]:
    """Return the measures of `EpisodeMetrics` that this module computes, by name."""
    acceleration = door_acceleration(log.door_angle, log.dt)
    forces = log.force_tangential, log.force_radial, log.force_vertical
    moved = np.abs(log.door_angle - log.door_angle[0]) >= _MOVED
    released = release(log)
    return {
        "force_handle_peak": float(np.linalg.norm(forces, axis=0).max()),
        "door_acceleration_peak": _greatest(acceleration),
        "door_smoothness": _smoothness(acceleration),
        "time_to_move": float(log.times[np.argmax(moved)]) if moved.any() else None,
        "person_force_peak": float(log.person_force.max()),
        "person_force_sustained": sustained(log.person_force, log.dt),
        "person_energy": float(log.person_energy[-1]),
        "stop_force_peak": float(log.stop_force.max()),
        "stop_force_sustained": sustained(log.stop_force, log.dt),
        "push_displacement_mm": push_displacement_mm(log),
        "release_speed": None if released is None else _release_speed(log, released),
        "recovery_time": None if released is None else _recovery_time(log, released),
    }


def door_acceleration(angle: FloatArray, dt: float) -> FloatArray | None:
    """Second derivative of the door's angle by local parabolas over 0.2 s [rad/s²].

    Args:
        angle: Of the door, (N,) [rad].
        dt: Sampling period [s].

    Returns:
        (N,), or None if there are fewer samples than the window has.
    """
    window = 2 * round(0.5 * _FILTER_TIME / dt) + 1
    if angle.size < window:
        return None
    acceleration: FloatArray = savgol_filter(angle, window, 2, deriv=2, delta=dt)
    return acceleration


def sustained(force: FloatArray, dt: float) -> float:
    """Return the greatest force that lasted for `SUSTAINED` without a break [N].

    Args:
        force: Magnitudes, (N,) [N].
        dt: Sampling period [s].
    """
    window = round(SUSTAINED / dt)
    return float(minimum_filter1d(force, window, mode="constant").max())


def release(log: EpisodeLog) -> int | None:
    """Return the row in which the last push, person or stop has gone; None if none.

    A stop goes when it lets the door pass, that is after its last force.
    """
    disturbed = (log.push_force > 0) | (log.person_force > 0) | (log.stop_force > 0)
    rows = np.flatnonzero(disturbed)
    if rows.size == 0 or rows[-1] + 1 == disturbed.size:
        return None
    return int(rows[-1]) + 1


def push_displacement_mm(log: EpisodeLog) -> float | None:
    """Greatest change of the hand's distance from the policy's path under a push [mm].

    The path is the policy's mean; of policies without one, their command.
    """
    pushed = np.flatnonzero(log.push_force > 0)
    if pushed.size == 0:
        return None
    path = np.where(np.isfinite(log.desired), log.desired, log.action)
    beside = (log.ee_pose - path)[max(pushed[0] - 1, 0) : pushed[-1] + 2, :3]
    return 1e3 * float(np.linalg.norm(beside - beside[0], axis=1).max())


def _release_speed(log: EpisodeLog, released: int) -> float:
    stop = released + round(_AFTER / log.dt)
    speeds = np.gradient(log.door_angle, log.dt)[released:stop]
    return float(np.abs(speeds).max())


def _recovery_time(log: EpisodeLog, released: int) -> float | None:
    further = log.door_angle[released:] >= log.door_angle[released] + _RECOVERED
    return float(np.argmax(further) * log.dt) if further.any() else None


def _greatest(values: FloatArray | None) -> float | None:
    return None if values is None else float(np.abs(values).max())


def _smoothness(acceleration: FloatArray | None) -> float | None:
    if acceleration is None or not acceleration.any():
        return None
    return 1.0 / math.sqrt(float(np.sum(acceleration**2)))
