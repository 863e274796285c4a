"""Random and irregular motion of a person, and its irregular recording."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_experiments.files.arrays import FloatArray

_LONGEST_BURST: Final = 6  # Largest number of consecutive lost samples.
_N_COSINES: Final = 64  # Terms of a smooth random function, which is nearly Gaussian.
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

    A sum of cosines whose covariance is exp(-Δt² / (2 ``correlation_time``²)). It does
    not depend on the samples: it is the same motion at every sampling rate.
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

    Its second-order Butterworth filter has a cut-off in cycles per sample; at or above
    0.5 the noise stays white.
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
    """Draw a monotone map of [0, 1] onto itself with a deviation of its log-speed."""
    grid = np.linspace(0.0, 1.0, _TIMING_GRID)
    speed = np.exp(timing_std * smooth_functions(grid, 0.2, 1, rng)[:, 0])
    elapsed = np.concatenate([[0.0], np.cumsum(0.5 * (speed[1:] + speed[:-1]))])
    warped: FloatArray = np.interp(clock, grid, elapsed / elapsed[-1])
    return warped


@dataclass(frozen=True, kw_only=True, slots=True)
class Habits(Quantities):
    """Irregularities of the motion and its recording; by default none."""

    haste: float = quantity(1.0, unit="", low=1.0, high=4.0)
    """Each motion is up to this factor faster or slower than the teacher's (uniform in
    the logarithm)."""
    pauses: int = quantity(0, unit="pauses", low=0, high=20)
    longest_pause: float = quantity(1.0, unit="s", low=0.1, high=10.0)
    """Number of pauses in the motion, at uniformly drawn places, and the longest; the
    shortest is a fifth of it."""
    backward: float = quantity(0.0, unit="rad", low=0.0, high=0.3)
    """Largest angle by which the door goes back and forward again in a pause."""
    longest_rest: float = quantity(0.0, unit="s", low=0.0, high=10.0)
    """Longest rest before the motion."""
    cut: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Largest share of the motion's duration that is missing at the end."""
    dropped: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Share of the samples that are lost, in bursts of up to six."""
    outliers: int = quantity(0, unit="outliers", low=0, high=20)
    outlier_distance: float = quantity(0.1, unit="m", low=0.0, high=1.0)
    """Number of outliers, samples in which the hand is elsewhere, and how far away."""


TIDY: Final = Habits()
"""The teacher without irregularities."""

MESSY: Final = Habits(
    haste=2.0,
    pauses=2,
    longest_pause=1.0,
    backward=math.radians(3.0),
    longest_rest=1.0,
    cut=0.05,
    dropped=0.05,
    outliers=1,
)
"""An ordinary recording without corrections."""


def irregular_timing(
    habits: Habits, duration: float, rate: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw the timing of a motion of a duration [s], with pauses and motions back.

    Returns times [s], the motion's clock in [0, 1], which stops in pauses, and the
    angle by which the door has gone back [rad], each (N,).
    """
    duration *= habits.haste ** rng.uniform(-1.0, 1.0)
    rest = habits.longest_rest * rng.uniform()
    places = np.sort(rng.uniform(0.1, 0.9, habits.pauses))
    lengths = habits.longest_pause * rng.uniform(0.2, 1.0, habits.pauses)
    depths = habits.backward * rng.uniform(0.0, 1.0, habits.pauses)
    end = rest + (1.0 - habits.cut * rng.uniform()) * duration + lengths.sum()
    times = np.arange(math.ceil(end * rate) + 1) / rate
    starts = rest + places * duration + np.cumsum(lengths) - lengths
    inside = np.clip((times[:, None] - starts) / lengths, 0.0, 1.0)
    clock = (times - rest - (lengths * inside).sum(axis=1)) / duration
    back = (depths * np.sin(np.pi * inside) ** 2).sum(axis=1)
    return times, np.clip(clock, 0.0, 1.0), back


def lose_samples(
    habits: Habits, poses: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Return the mask of the remaining samples, (N,), and poses with outliers, (N, 6).

    The first and the last sample are kept. The first ten samples have no outlier,
    because a recording is relative to its first sample.
    """
    n = len(poses)
    kept = np.ones(n, dtype=bool)
    lost = min(round(habits.dropped * n), n - 2)
    while np.count_nonzero(~kept) < lost:
        start, length = rng.integers(1, n - 1), rng.integers(1, _LONGEST_BURST + 1)
        kept[start : min(start + length, n - 1)] = False
    poses = poses.copy()
    candidates = np.flatnonzero(kept)[10:-1]
    for index in rng.choice(candidates, min(habits.outliers, candidates.size), False):
        direction = rng.standard_normal(3)
        distance = np.linalg.norm(direction)
        poses[index, :3] += habits.outlier_distance * direction / distance
    return kept, poses
