"""Task completion index: share of a task completed at each sample of a demonstration.

Equation numbers refer to Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979.
"""

import warnings
from collections.abc import Sequence
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.se3 import pose_steps
from gplfd_policies.arrays.shapes import Float
from gplfd_policies.demonstrations.demonstration import Demonstration

_NOISY_LENGTH_RATIO: Final = 1.1
"""Length of a path over its denoised length above which a warning is issued."""
_BANDWIDTH: Final = 0.015
"""Standard deviation of the filter, as a share of the demonstration: 0.1 s in 7 s. This
is shorter than intended motions of a hand and longer than noise of sensors and their
filters. It causes a phase error of 0.1 % on clean minimum-jerk motion, and of 0.5 %
where a clean motion stops abruptly."""
_REACH: Final = 4.0
"""Half-width at which the filter's weights are cut off, in standard deviations."""


def task_completion_index(
    demonstration: Demonstration, rotation_weight: float = 0.5, denoise: bool = True
) -> Float[np.ndarray, " N"]:
    """Return ζ: the share of the path's length covered up to each sample, Eq. (16).

    Computed from the raw path, as printed, ζ measures mainly noise; therefore the noise
    is removed first (`test_phase_error_with_noise_stays_below`).
    """
    index, length_ratio = measure_completion(demonstration, rotation_weight, denoise)
    warn_of_noise([length_ratio], denoise)
    return index


def measure_completion(
    demonstration: Demonstration, rotation_weight: float, denoise: bool
) -> tuple[Float[np.ndarray, " N"], float]:
    """Return ζ, and the length of the path over its length without noise.

    The ratio is about 1 for a clean recording.
    """
    poses = demonstration.poses
    raw = pose_steps(poses, rotation_weight)
    raw_length = float(np.sum(raw))
    if raw_length <= 0.0:
        raise ValueError(
            "the demonstration does not move under rotation_weight="
            f"{rotation_weight}: 0 counts translation only and 1 rotation only; "
            "choose a weight between"
        )
    clean = denoised_steps(poses, rotation_weight)
    clean_length = float(np.sum(clean))
    if clean_length <= 0.0:
        # Nothing exceeds the noise: only the raw path can be used.
        clean, clean_length = raw, raw_length
    steps = clean if denoise else raw
    index = np.concatenate([[0.0], np.cumsum(steps)])
    index /= index[-1]
    return index, raw_length / clean_length


def warn_of_noise(ratios: Sequence[float], denoise: bool) -> None:
    """Warn once if recorded paths are more than 1.1 times as long as denoised ones."""
    noisy = sum(ratio > _NOISY_LENGTH_RATIO for ratio in ratios)
    if not noisy:
        return
    if denoise:
        done = "The task completion index was computed from the denoised path."
    else:
        done = (
            "The task completion index was computed from the raw path and mostly "
            "follows the clock where the hand is slow; pass denoise=True."
        )
    warnings.warn(
        f"sensor noise: {noisy} of {len(ratios)} demonstrations have a raw path more "
        f"than {_NOISY_LENGTH_RATIO} times as long as the denoised one (up to "
        f"{max(ratios):.2f} times). {done}",
        UserWarning,
        stacklevel=3,
    )


def denoised_steps(
    poses: Float[np.ndarray, "N 6"], rotation_weight: float
) -> Float[np.ndarray, " N-1"]:
    """Return the distances between successive poses, Eq. (17), of the smoothed path.

    The filter is Gaussian, and its width is a fixed share of the demonstration. Rules
    that estimate the noise from neighbouring samples do not remove noise that motion
    capture has filtered (`test_phase_error_with_filtered_noise_stays_below`).
    """
    size = len(poses)
    bandwidth = _BANDWIDTH * size
    reach = int(_REACH * bandwidth + 0.5)
    if reach == 0:
        return pose_steps(poses, rotation_weight)
    path = np.ascontiguousarray(poses.T)
    # Extended by point reflection at the ends, which keeps the ends in place.
    before = 2.0 * path[:, :1] - path[:, reach:0:-1]
    after = 2.0 * path[:, -1:] - path[:, -2 : -reach - 2 : -1]
    extended = np.concatenate([before, path, after], axis=1)
    # By Fourier transform: the weights cover an eighth of the demonstration, so a
    # direct sum would cost O(N²).
    length = scipy.fft.next_fast_len(extended.shape[1], real=True)
    half = np.exp(-0.5 * (np.arange(reach + 1) / bandwidth) ** 2)
    weights = np.zeros(length)
    weights[: reach + 1] = half
    weights[-reach:] = half[:0:-1]
    weights /= weights.sum()
    # The weights are even, so their spectrum is real.
    spectrum = scipy.fft.rfft(extended, length) * scipy.fft.rfft(weights).real
    smooth = scipy.fft.irfft(spectrum, length)[:, reach : reach + size]
    return pose_steps(smooth.T, rotation_weight)
