"""Step lengths of a noisy path.

Sensor noise makes every step of a path longer, most of all where the hand rests, so
the length of a densely sampled path is mostly noise.
"""

import numpy as np
from jaxtyping import Float
from scipy.fft import irfft, next_fast_len, rfft

from gplfd_env.spatial.se3 import pose_steps

_BANDWIDTH = 0.015
"""Standard deviation of the smoother, as a share of the demonstration. A tenth of a
second in seven: below what a hand does on purpose, above what a sensor and its filters
do by accident. It costs 0.1 % of phase on clean minimum-jerk motion, and half a per
cent where a clean hand stops abruptly."""

_REACH = 4.0
"""Where the smoother's weights are cut off, in standard deviations."""


def denoised_steps(
    poses: Float[np.ndarray, "N 6"], rotation_weight: float
) -> Float[np.ndarray, " N-1"]:
    """Return the distances between successive poses, Eq. (17), of the smoothed path.

    The smoother has a fixed share of the demonstration as its width. Rules that
    estimate the noise from neighbouring samples resolve white noise better, but motion
    capture filters its output: its noise looks like motion to such rules, and they
    leave it in (`test_phase_error_with_filtered_noise_stays_below`).

    Args:
        poses: Continuous poses [m, rad], (N, 6).
        rotation_weight: ω₁ of Eq. (17).

    Returns:
        Step lengths, (N - 1,), not negative.
    """
    return pose_steps(_smoothed(poses), rotation_weight)


def _smoothed(poses: Float[np.ndarray, "N 6"]) -> Float[np.ndarray, "N 6"]:
    """Return the path after a Gaussian smoother that keeps both ends in place."""
    size = len(poses)
    bandwidth = _BANDWIDTH * size
    reach = int(_REACH * bandwidth + 0.5)
    if reach == 0:
        return poses
    path = np.ascontiguousarray(poses.T)
    # Continued by point reflection at the ends, which keeps them where they are.
    before = 2.0 * path[:, :1] - path[:, reach:0:-1]
    after = 2.0 * path[:, -1:] - path[:, -2 : -reach - 2 : -1]
    extended = np.concatenate([before, path, after], axis=1)
    # Through the spectrum: the weights reach over an eighth of the demonstration, so
    # that summing directly would cost O(N²).
    length = next_fast_len(extended.shape[1], real=True)
    half = np.exp(-0.5 * (np.arange(reach + 1) / bandwidth) ** 2)
    weights = np.zeros(length)
    weights[: reach + 1] = half
    weights[-reach:] = half[:0:-1]
    weights /= weights.sum()
    # The weights are even, so their spectrum is real.
    spectrum = rfft(extended, length) * rfft(weights).real
    smooth: np.ndarray = irfft(spectrum, length)[:, reach : reach + size]
    return smooth.T
