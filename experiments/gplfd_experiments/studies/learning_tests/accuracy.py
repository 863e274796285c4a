"""Errors, densities and coverage of a prediction of left-out demonstrations."""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_policies.demonstrations.aligned import FINEST
from gplfd_policies.movements.trajectory import GaussianTrajectory

FloatArray = NDArray[np.float64]

_LEVELS: Final = (0.50, 0.90, 0.95)


def rms_distance(poses: FloatArray, truth: FloatArray) -> float:
    """Root mean square of the distances between positions [m]; poses (M, 6)."""
    return root_mean_square(np.linalg.norm(poses[:, :3] - truth[:, :3], axis=1))


def rms_rotation(poses: FloatArray, truth: FloatArray) -> float:
    """Root mean square of the angles between orientations [rad], Eq. (18)."""
    return root_mean_square(rotation_distance(poses[:, 3:], truth[:, 3:]))


def root_mean_square(values: FloatArray | Sequence[float]) -> float:
    """Return the root of the mean of the squares."""
    return math.sqrt(float(np.mean(np.square(values))))


def spread_followed(std: FloatArray, poses: FloatArray) -> float | None:
    """Return the correlation of a standard deviation and the demonstrations' spread.

    Args:
        std: Predicted at the phases of the demonstrations, (M, 6); NaN for a method
            without any.
        poses: The demonstrations, (K, M, 6), at least two.

    Returns:
        Correlation over the phases of their logarithms, mean of the outputs whose
        spread varies: 1 for a copy, 0 for one level throughout; None for a method
        without standard deviations, or where no spread varies.
    """
    spread = poses.std(axis=0, ddof=1)
    if not np.isfinite(std).all():
        return None
    logs = [np.log(np.maximum(each, FINEST)) for each in (std, spread)]
    got, true = (each - each.mean(axis=0) for each in logs)
    varies = np.sum(true**2, axis=0) > 0.0
    if not varies.any():
        return None
    scale = np.sqrt(np.sum(got**2, axis=0) * np.sum(true**2, axis=0))
    followed = np.sum(got * true, axis=0) / np.where(scale > 0.0, scale, 1.0)
    return float(np.mean(followed[varies]))


def accuracy(
    predicted: GaussianTrajectory, truth: FloatArray, scored: FloatArray | None = None
) -> Mapping[str, float | None]:
    """Score a prediction.

    Quantiles are those of a normal distribution for every method. For a method that
    states intervals of its own, wider with few demonstrations, ``coverage_95_stated``
    is their coverage.

    Args:
        predicted: Prediction at the phases of the truth.
        truth: Poses that were left out, (M, 6) [m, rad].
        scored: The same with NaN where density and coverage leave numbers out; None
            scores all.
    """
    scored = truth if scored is None else scored
    stated = None
    if predicted.degrees_of_freedom is not None:
        stated = predicted.coverage(scored)
    return {
        "rmse_position_m": rms_distance(predicted.mean, truth),
        "rmse_rotation_rad": rms_rotation(predicted.mean, truth),
        "nlpd": known(predicted.nlpd(scored)),
        **{
            f"coverage_{100 * level:.0f}": known(
                predicted.coverage(scored, level, normal=True)
            )
            for level in _LEVELS
        },
        "coverage_95_stated": stated,
    }


def known(number: float) -> float | None:
    """Return a number, or None for the NaN of a method without standard deviations."""
    return None if math.isnan(number) else number


def averaged(scores: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Average scores of the same names; None where there is none at all.

    Errors, named ``rmse_...``, are averaged as squares.
    """
    means: dict[str, float | None] = {}
    for name in scores[0]:
        values = [value for each in scores if (value := each[name]) is not None]
        mean = root_mean_square if name.startswith("rmse_") else np.mean
        means[name] = float(mean(values)) if values else None
    return means
