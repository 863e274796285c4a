"""Step lengths of a noisy path.

Sensor noise makes every step of a path longer, most of all where the hand rests, so
the length of a densely sampled path is mostly noise.
"""

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from gplfd_env.se3 import pose_distance

__all__ = ["denoised_steps"]

_BANDWIDTH = 0.02
"""Standard deviation of the smoother, as a share of the demonstration. A tenth of a
second in five: below what a hand does on purpose, above what a sensor and its filters
do by accident. It costs 0.1 % of phase on clean minimum-jerk motion."""

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
    bandwidth = _BANDWIDTH * len(poses)
    margin = min(int(_REACH * bandwidth) + 1, len(poses) - 1)
    # Continued by point reflection at the ends, which keeps them where they are.
    before = 2.0 * poses[0] - poses[margin:0:-1]
    after = 2.0 * poses[-1] - poses[-2 : -margin - 2 : -1]
    extended = np.concatenate([before, poses, after])
    smooth = gaussian_filter1d(extended, bandwidth, axis=0, truncate=_REACH)
    smooth = smooth[margin : margin + len(poses)]
    return pose_distance(smooth[1:], smooth[:-1], rotation_weight)
