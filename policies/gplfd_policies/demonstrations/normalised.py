"""Demonstrations without their differences of size and heading."""

from dataclasses import replace

import numpy as np

from gplfd_policies.arrays.shapes import Float
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

_STILL = 1e-3
"""Root mean square displacement below which a motion has no size [m]."""


def normalised(
    aligned: AlignedDemonstrations,
) -> tuple[AlignedDemonstrations, Float[np.ndarray, " K"]]:
    """Return demonstrations without their differences of size and heading.

    The size of a demonstration is the root mean square of its displacement from the
    start. Its heading is the rotation about the vertical that fits the mean to it by
    least squares.

    Returns:
        The demonstrations, scaled about the start and rotated about the vertical, and
        the logarithms of the original sizes, with a mean of zero.
    """
    positions = aligned.poses[..., :3]
    lengths = np.sqrt((positions**2).sum(axis=2).mean(axis=1))
    log_sizes = np.log(np.maximum(lengths, _STILL))
    log_sizes -= log_sizes.mean()
    # In the horizontal plane a rotation about the vertical is a complex factor.
    level = (positions[..., 0] - 1j * positions[..., 2]) / np.exp(log_sizes)[:, None]
    mean = level.mean(axis=0)
    headings = np.zeros(len(level))
    # The mean becomes sharper as headings are removed; a few iterations are enough.
    for _ in range(5):
        headings = np.angle((level * mean.conj()).sum(axis=1))
        headings -= headings.mean()
        mean = (level * np.exp(-1j * headings)[:, None]).mean(axis=0)
    level *= np.exp(-1j * headings)[:, None]
    poses = aligned.poses.copy()
    poses[..., 0], poses[..., 2] = level.real, -level.imag
    poses[..., 1] /= np.exp(log_sizes)[:, None]
    return replace(aligned, poses=poses), log_sizes
