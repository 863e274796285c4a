"""Errors, densities and coverage of a prediction of left-out demonstrations."""

import math
from collections.abc import Mapping, Sequence

import numpy as np

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import FINEST
from gplfd_policies.movements.movement import GaussianTrajectory


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
    """Correlation of a standard deviation (M, 6) and demonstrations' spread (K, M, 6).

    It is computed from the logarithms over the phases and averaged over the outputs
    with a varying spread: 1 for a copy, 0 for a constant. None if the standard
    deviations are NaN, or if no spread varies.
    """
    spread = poses.std(axis=0, ddof=1)
    if not np.isfinite(std).all():
        return None
    logs = [np.log(np.maximum(values, FINEST)) for values in (std, spread)]
    got, true = (values - values.mean(axis=0) for values in logs)
    varies = np.sum(true**2, axis=0) > 0.0
    if not varies.any():
        return None
    scale = np.sqrt(np.sum(got**2, axis=0) * np.sum(true**2, axis=0))
    followed = np.sum(got * true, axis=0) / np.where(scale > 0.0, scale, 1.0)
    return float(np.mean(followed[varies]))


def accuracy(
    predicted: GaussianTrajectory, truth: FloatArray, scored: FloatArray | None = None
) -> Mapping[str, float | None]:
    """Score a prediction of poses (M, 6) [m, rad] that were left out.

    Quantiles are those of a normal distribution for every method. Density and coverage
    exclude numbers where ``scored`` is NaN.
    """
    scored = truth if scored is None else scored
    coverage = {
        f"coverage_{percent}": none_if_nan(
            predicted.coverage(scored, percent / 100, normal=True)
        )
        for percent in (50, 90, 95)
    }
    return {
        "rmse_position_m": rms_distance(predicted.mean, truth),
        "rmse_rotation_rad": rms_rotation(predicted.mean, truth),
        "nlpd": none_if_nan(predicted.nlpd(scored)),
        **coverage,
    }


def none_if_nan(number: float) -> float | None:
    """Return a number, or None for the NaN of a method without standard deviations."""
    return None if math.isnan(number) else number


def averaged(scores: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Average scores of the same names; None if all are missing.

    Errors, named ``rmse_...``, are averaged as squares.
    """
    means: dict[str, float | None] = {}
    for name in scores[0]:
        values = [value for score in scores if (value := score[name]) is not None]
        mean = root_mean_square if name.startswith("rmse_") else np.mean
        means[name] = float(mean(values)) if values else None
    return means
