"""How a person reaches for a handle and takes hold of it."""

from typing import Final

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.teacher.random_motion import minimum_jerk, uneven_timing
from gplfd_experiments.files.arrays import FloatArray

_DISTANCE: Final = (0.10, 0.25)
"""Least and greatest distance from which a person reaches [m]."""

_DIRECTION: Final = 0.6
"""From straight before the door, at most so far to a side, up or down [rad]."""

_TURN: Final = 0.1
"""How the hand is turned there: standard deviation per axis [rad]."""

_ARCH: Final = 0.01
"""How far the path leaves the straight line: standard deviation per axis [m]."""

_TIME: Final = (1.6, 0.2)
"""Mean and standard deviation of the time of the reach [s]."""

_GRIP: Final = (0.4, 0.1)
"""The same of the time in which the hand, at the handle, closes [s]."""


def reached(
    rate: float, timing_std: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, Rotation]:
    """Return how a hand comes to the handle and closes, ending at time 0.

    A minimum-jerk motion along a gentle arch, unevenly timed, and a rest while the hand
    closes.

    Args:
        rate: Samples per second [Hz].
        timing_std: Unevenness, see `TeacherConfig.timing_std`.
        rng: Source of randomness.

    Returns:
        Times (N,) [s], positions (N, 3) [m] from the handle, in door axes, and N
        rotations from how the hand holds it.
    """
    start, turned, arch = _drawn(rng)
    longer, slower = rng.standard_normal(2)
    reaching = max(_TIME[0] + _TIME[1] * float(longer), 0.5 * _TIME[0])
    gripping = max(_GRIP[0] + _GRIP[1] * float(slower), 0.5 * _GRIP[0])
    samples = round((reaching + gripping) * rate)
    times = np.arange(-samples, 1) / rate
    clock = np.clip((times - times[0]) / reaching, 0.0, 1.0)
    done = minimum_jerk(uneven_timing(clock, timing_std, rng))[:, None]
    positions = (1.0 - done) * start + np.sin(np.pi * done) ** 2 * arch
    return times, positions, Rotation.from_rotvec((1.0 - done) * turned)


def _drawn(rng: np.random.Generator) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw where the hand is, how it is turned, and the arch: [m], [rad], [m]."""
    distance = rng.uniform(*_DISTANCE)
    aside, above = rng.uniform(-_DIRECTION, _DIRECTION, 2)
    level = np.cos(above)
    direction = np.array([level * np.cos(aside), np.sin(above), level * np.sin(aside)])
    turned, arch = rng.standard_normal((2, 3))
    return distance * direction, _TURN * turned, _ARCH * arch
