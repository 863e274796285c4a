"""Random functions of time for human motion and its measurement."""

import math
from typing import Final

import numpy as np
from scipy.signal import butter, sosfilt

from gplfd_experiments.files.arrays import FloatArray

_N_COSINES: Final = 64
"""Number of terms of a smooth random function; its values are nearly Gaussian."""
_TIMING_GRID: Final = 400  # Number of points for the integration of the uneven timing.


def minimum_jerk(progress: FloatArray) -> FloatArray:
    """Minimum-jerk profile 10 s³ - 15 s⁴ + 6 s⁵, constant outside [0, 1]."""
    s = np.clip(progress, 0.0, 1.0)
    return s**3 * (10.0 + s * (6.0 * s - 15.0))


def smooth_functions(
    times: FloatArray,
    correlation_time: float,
    n_functions: int,
    rng: np.random.Generator,
) -> FloatArray:
    """Draw smooth random functions with mean 0 and standard deviation 1, (N, n).

    A sum of cosines with Gaussian frequencies and uniform phases, whose covariance is
    exp(-Δt² / (2 ``correlation_time``²)). It is a function of time, not of the
    samples: the same ``rng`` gives the same motion at every sampling rate.
    """
    frequency = rng.standard_normal((n_functions, _N_COSINES)) / correlation_time
    phase = rng.uniform(0.0, 2.0 * np.pi, (n_functions, _N_COSINES))
    cosines = np.cos(times[:, None, None] * frequency + phase)
    values: FloatArray = np.sqrt(2.0 / _N_COSINES) * cosines.sum(axis=-1)
    return values


def coloured_noise(
    n_samples: int, bandwidth: float, n_signals: int, rng: np.random.Generator
) -> FloatArray:
    """Draw stationary noise with mean 0 and standard deviation 1, (N, n).

    It is low-passed by a second-order Butterworth filter whose cut-off is given in
    cycles per sample; at or above 0.5 the noise stays white.
    """
    if bandwidth >= 0.5:
        return rng.standard_normal((n_samples, n_signals))
    sections = butter(2, 2.0 * bandwidth, output="sos")
    settling = math.ceil(4.0 / bandwidth)
    impulse = np.zeros(settling)
    impulse[0] = 1.0
    gain = float(np.linalg.norm(sosfilt(sections, impulse)))
    white = rng.standard_normal((settling + n_samples, n_signals))
    noise: FloatArray = sosfilt(sections, white, axis=0)[settling:] / gain
    return noise


def uneven_timing(
    clock: FloatArray, timing_std: float, rng: np.random.Generator
) -> FloatArray:
    """Draw a monotone map of [0, 1] onto itself whose log-speed is a smooth function.

    Its standard deviation is given; 0 gives the identity. Outside [0, 1] the clock is
    clamped.
    """
    grid = np.linspace(0.0, 1.0, _TIMING_GRID)
    speed = np.exp(timing_std * smooth_functions(grid, 0.2, 1, rng)[:, 0])
    elapsed = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    warped: FloatArray = np.interp(clock, grid, elapsed / elapsed[-1])
    return warped
