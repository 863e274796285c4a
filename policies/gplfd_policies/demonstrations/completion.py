"""How much of a task is done at each sample of a demonstration.

Equation numbers refer to Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from gplfd_env.spatial.se3 import pose_steps
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.denoising import denoised_steps

_NOISY_LENGTH_RATIO = 1.1


@dataclass(frozen=True, kw_only=True, slots=True)
class Completion:
    """The task completion index of one demonstration, Eq. (16)."""

    index: Float[np.ndarray, " N"]
    """ζ at each sample: 0 at the first, 1 at the last, never falling."""
    length_ratio: float
    """Length of the recorded path over its length without the noise, about 1 if it is
    clean."""


def task_completion_index(
    demonstration: Demonstration, rotation_weight: float = 0.5, denoise: bool = True
) -> Float[np.ndarray, " N"]:
    """Return ζ: the part of the path's length covered up to each sample, Eq. (16).

    Note:
        Cumulated raw, as printed, ζ measures the noise: 1 mm of it at 1000 samples
        shifts the phase by several per cent. By default the noise's share is removed:
        `test_phase_error_with_noise_stays_below`.

    Args:
        demonstration: The motion.
        rotation_weight: ω₁ of Eq. (17), within [0, 1].
        denoise: Whether to remove the noise's share of the length.

    Returns:
        Completion from 0 to 1, (N,), never falling.

    Raises:
        ValueError: If nothing moves that the weight counts.

    Warns:
        UserWarning: If the raw path is more than 1.1 times as long as the denoised one.
    """
    completion = measure_completion(demonstration, rotation_weight, denoise)
    warn_of_noise([completion], denoise)
    return completion.index


def measure_completion(
    demonstration: Demonstration, rotation_weight: float, denoise: bool
) -> Completion:
    """Return ζ with the length ratio that tells how noisy the recording is.

    Args:
        demonstration: The motion.
        rotation_weight: ω₁ of Eq. (17), within [0, 1].
        denoise: Whether ζ is made of the denoised steps.

    Returns:
        The completion.

    Raises:
        ValueError: If nothing moves that the weight counts.
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
        # Nothing rises above the noise; the raw path is all there is to go by.
        clean, clean_length = raw, raw_length
    steps = clean if denoise else raw
    index = np.concatenate([[0.0], np.cumsum(steps)])
    index /= index[-1]
    return Completion(index=index, length_ratio=raw_length / clean_length)


def warn_of_noise(completions: Sequence[Completion], denoise: bool) -> None:
    """Warn once if recorded paths are much longer than their denoised ones.

    Args:
        completions: One per demonstration.
        denoise: Whether the noise was removed.

    Warns:
        UserWarning: If a length ratio exceeds 1.1.
    """
    ratios = [completion.length_ratio for completion in completions]
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
