"""Size and heading of the observed path, relative to the demonstrated path.

Doors of different radius give paths of different size, and a robot with a heading error
observes the motion rotated about the vertical. The path so far distinguishes both from
progress: a heading error rotates all of it, size determines its curvature.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Complex, Float, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

_STEPS: Final = np.linspace(-2.5, 2.5, 31)
"""Grid of sizes, in prior standard deviations of the logarithm of size."""
_SMOOTHING: Final = 20
"""Samples on each side over which the demonstrations' variance is averaged."""
_SIZES: Final = 19  # number of likely sizes
_OVERLAP: Final = 0.6
"""σ of the sizes that one likely size represents, in distances to the next."""
_REACH: Final = 3.0  # range of likely sizes on each side, in standard deviations
_NEAR, _NEAREST = 1e-3, 1e-6  # least distances from the start used as divisors [m]
_STILL: Final = 1e-3
"""Root mean square displacement below which a motion has no size [m]."""

Sizes = Float[np.ndarray, " C"]
Likely = Float[np.ndarray, " K"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SimilarityConfig(Quantities):
    """How size and heading are estimated."""

    size_std: float = quantity(0.35, low=0.0)
    """Standard deviation of the logarithm of size expected before any demonstration."""
    size_weight: float = quantity(12.0, above=0.0)
    """Weight of this prior, in demonstrations."""
    heading_std: float = quantity(math.radians(3.0), low=0.0, unit="rad")
    """Heading error of the robot at the door [rad]: rotation about the vertical."""
    position_std: float = quantity(3e-3, above=0.0, unit="m")
    """Independent error of each position across the path [m]."""
    rotation_std: float = quantity(0.15, above=0.0, unit="rad")
    """Error of an observed rotation [rad]."""
    scale_weight: float = quantity(40.0, above=0.0)
    """ν: weight of the stated errors, in positions; with more, data determine them."""
    spacing: float = quantity(0.004, above=0.0, unit="m")
    """Distance between two used positions [m]."""
    least_std: float = quantity(1e-3, above=0.0, unit="m")
    """Least smooth deviation across the path of demonstrations of equal size [m]."""
    lateral_length_scale: float = quantity(0.5, above=0.0)
    """Length-scale of this deviation, in phase."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SimilarityModel:
    """The demonstrated path of mean size, and the deviations of other paths from it.

    Positions are complex numbers x - iz in the horizontal plane [m], so that a factor
    c exp(iψ) scales by c and rotates about the vertical by ψ.
    """

    config: SimilarityConfig
    phases: Times
    path: Complex[np.ndarray, " M"]
    """Mean path of the demonstrations with equal size and heading, complex [m]."""
    lateral_std: Times
    """σ: standard deviation of demonstrations of equal size across the path [m]."""
    lag: Times
    """Standard deviation of demonstrations of equal size along the path [m]."""
    log_sizes: Sizes
    """Logarithms of the grid of sizes; 0 if the path shows no size."""
    rate: float
    """√3 over the length-scale of the Matérn kernel of f [1/phase]."""
    least_scale: float
    """Share of the stated variances caused by the error of the mean path."""
    outward: Float[np.ndarray, "4 F"]
    """First point of the mean path at each distance from its start: distance [m],
    phase, direction about the vertical [rad] and `lateral_std` [m]."""

    @classmethod
    def of(
        cls,
        aligned: AlignedDemonstrations,
        config: SimilarityConfig = SimilarityConfig(),
    ) -> SimilarityModel:
        """Return the model of demonstrations; for a turning handle, of its axis."""
        similar, log_sizes = normalised(aligned)
        poses, count = similar.poses, len(log_sizes)
        level = poses[..., 0] - 1j * poses[..., 2]
        path = level.mean(axis=0)
        lateral_std = lag = np.full(len(path), config.least_std)
        if count > 1:
            # Across: perpendicular to the direction from the start.
            tangent = np.gradient(path)
            tangent /= np.maximum(np.abs(tangent), _NEAREST)
            along = ((level - path) * tangent.conj()).real
            across = (level * np.exp(-1j * np.angle(path))).imag
            # The standard deviations of a repetition, averaged along the task [m].
            smooth, width = [], 2 * _SMOOTHING + 1
            for deviations in (along, across):
                # Deviations from their own mean have one degree of freedom less.
                variance = (deviations**2).sum(axis=0) * (1.0 + 1.0 / count)
                padded = np.pad(variance / (count - 1), _SMOOTHING, mode="edge")
                mean = np.convolve(padded, np.full(width, 1.0 / width), "valid")
                smooth.append(np.maximum(np.sqrt(mean), config.least_std))
            lag, lateral_std = smooth
        scatter = float((log_sizes**2).sum())
        size_variance = config.size_weight * config.size_std**2 + scatter
        size_variance *= (1.0 + 1.0 / count) / (config.size_weight + count - 1)
        visible = size_visibility(poses[:, aligned.times <= aligned.end], config)
        # If a path returns towards its start, only the way out is used.
        distances = np.maximum.accumulate(np.abs(path))
        furthest, first = np.unique(distances, return_index=True)
        moved = furthest > _NEAREST
        first = first[moved]
        angles = np.unwrap(np.angle(path[first]))
        direction = float(angles[0]) if angles.size else 0.0
        start = [[0.0], [aligned.times[0]], [direction], [config.least_std]]
        out = [furthest[moved], aligned.times[first], angles, lateral_std[first]]
        return cls(
            config=config,
            phases=aligned.times,
            path=path,
            lateral_std=lateral_std,
            lag=lag,
            log_sizes=math.sqrt(size_variance) * visible * _STEPS,
            rate=math.sqrt(3.0) / config.lateral_length_scale,
            least_scale=1.0 / (count + 1),
            outward=np.hstack([start, out]),
        )

    def prior(self) -> PathSimilarity:
        """Return the estimate before any position of the path is observed."""
        variances = [self.config.heading_std**2, 1.0, self.rate**2]
        covariance = np.zeros((3, 3, _STEPS.size))
        covariance += np.diag(variances)[:, :, None]
        zero = np.zeros(_STEPS.size)
        return PathSimilarity(
            model=self,
            log_variance=zero,
            squared_innovations=zero,
            count=0,
            mean=np.zeros((3, _STEPS.size)),
            covariance=covariance,
            phase=zero + self.outward[1, 0],
            due=self.config.spacing,
            angle=zero,
            angle_variance=zero + self.config.heading_std**2,
        )


@dataclass(frozen=True, kw_only=True)
class PathSimilarity:
    """Estimate of size and heading from the path so far, for a grid of sizes.

    A path is the demonstrated one of mean size, scaled by c and rotated by ψ. At the
    distance d from its start, where the demonstrations have the phase s(d/c) and the
    direction a(d/c), it has the direction α(d) and deviates across their path by

        r(d) = d (α(d) - a(d/c)) = d ψ + c σ(s) f(s) + e,    e ~ N(0, n²),

    with σ the standard deviation of the demonstrations across the path and f a Gaussian
    process of unit variance with the Matérn kernel of smoothness 3/2. A priori
    ψ ~ N(0, τ²), and log c is normal; its variance combines `SimilarityConfig.size_std`
    and the demonstrations' own sizes (conjugate prior). Given c the model is linear:
    (ψ, f, df/ds) has a Kalman filter along the path, whose innovations give
    p(c | path). The state at the last observed position determines the forecast.
    """

    model: SimilarityModel
    log_variance: Sizes
    """Sum of the logarithms of the innovation variances."""
    squared_innovations: Sizes
    """δ²: sum of squared innovations divided by their variances."""
    count: int
    """n: number of positions used."""
    mean: Float[np.ndarray, "3 C"]
    """Mean of (ψ [rad], f, df/ds) given each size."""
    covariance: Float[np.ndarray, "3 3 C"]
    phase: Sizes
    """Phase of the last position for every size."""
    due: float
    """Distance after which the next position is used [m]."""
    angle: Sizes
    """Angle of the path relative to the demonstrated path of each size at the same
    distance, due to heading and deviation [rad]."""
    angle_variance: Sizes


def updated(
    paths: Sequence[PathSimilarity], places: Sequence[tuple[float, float]]
) -> list[PathSimilarity]:
    """Return R estimates, each with one more position that is far enough from its last.

    A position's distance from the start is in the horizontal plane [m], at least the
    path's `due`; its angle is its direction about the vertical [rad]. Settings agree.
    """
    models, config = [path.model for path in paths], paths[0].model.config
    place: Float[np.ndarray, "2 R 1"] = np.array(places).T[..., None]
    distance, angle = place
    sizes = np.exp(np.array([model.log_sizes for model in models]))
    curves = [
        [np.interp(far, model.outward[0], curve) for curve in model.outward[1:]]
        for model, far in zip(models, distance / sizes, strict=True)
    ]
    phase, expected, lateral_std = np.array(curves).swapaxes(0, 1)
    error = np.remainder(angle - expected + math.pi, 2.0 * math.pi) - math.pi
    before = np.array([path.phase for path in paths])
    phase = np.maximum(phase, before)
    mean, covariance = advance(
        np.array([path.mean for path in paths]).swapaxes(0, 1),
        np.moveaxis(np.array([path.covariance for path in paths]), 0, 2),
        phase - before,
        models[0].rate,
    )
    # r = H (ψ, f, df/ds) + e.
    lateral_std = sizes * lateral_std
    gain = distance * covariance[0] + lateral_std * covariance[1]
    explained = distance * gain[0] + lateral_std * gain[1]
    variance = explained + config.position_std**2
    innovation = distance * error - (distance * mean[0] + lateral_std * mean[1])
    mean += gain * (innovation / variance)
    covariance -= gain[:, None] * (gain / variance)
    left = explained * (1.0 - explained / variance)
    misfit, surprise = np.log(variance), innovation**2 / variance
    turned = mean[0] + lateral_std / distance * mean[1]
    angle_variance = left / distance**2
    return [
        PathSimilarity(
            model=path.model,
            log_variance=path.log_variance + misfit[row],
            squared_innovations=path.squared_innovations + surprise[row],
            count=path.count + 1,
            mean=mean[:, row],
            covariance=covariance[:, :, row],
            phase=phase[row],
            due=place[0] + config.spacing,
            angle=turned[row],
            angle_variance=angle_variance[row],
        )
        for row, (path, place) in enumerate(zip(paths, places, strict=True))
    ]


def posteriors(paths: Sequence[PathSimilarity]) -> list[SizePosterior]:
    """Return the likely sizes given each of R paths, on a finer grid of each."""
    config, rows = paths[0].model.config, np.arange(len(paths))[:, None]
    grid = np.array([path.model.log_sizes for path in paths])
    counts = [(path.count, path.model.least_scale) for path in paths]
    count, least = np.array(counts).T[..., None]
    # (ν + δ²)/(ν + n), at least the mean's share: factor on the covariances, with
    # which p(c, path) is a Student-t density.
    free = config.scale_weight + count
    squared = np.array([path.squared_innovations for path in paths])
    scale = np.maximum((config.scale_weight + squared) / free, least)
    log_variance = np.array([path.log_variance for path in paths])
    log_weights = -0.5 * (_STEPS**2 + log_variance + free * np.log(scale))
    weights = _normalised(log_weights)
    centre = np.add.reduce(weights * grid, axis=-1, keepdims=True)
    variance = np.add.reduce(weights * (grid - centre) ** 2, axis=-1, keepdims=True)
    first, last, spacing = grid[:, :1], grid[:, -1:], grid[:, 1:2] - grid[:, :1]
    reach = _REACH * np.maximum(np.sqrt(variance), 0.5 * spacing)
    low, high = np.maximum(centre - reach, first), np.minimum(centre + reach, last)
    sizes = low + np.arange(_SIZES) * ((high - low) / (_SIZES - 1))
    sizes[:, -1:] = high
    # All curves are smooth in log c: cubic interpolation through four sizes.
    position = (sizes - first) / np.maximum(spacing, _NEAREST)
    left = np.maximum(np.minimum(position.astype(np.int64) - 1, _STEPS.size - 4), 0)
    u = position - left
    cubic = np.array(
        [
            -(u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0,
            u * (u - 2.0) * (u - 3.0) / 2.0,
            -u * (u - 1.0) * (u - 3.0) / 2.0,
            u * (u - 1.0) * (u - 2.0) / 6.0,
        ]
    )
    curves = np.empty((16, *grid.shape))
    curves[0] = log_weights
    for row, path in enumerate(paths):
        curves[1, row], curves[2, row] = path.phase, path.angle
        np.multiply(scale[row], path.angle_variance, out=curves[3, row])
        curves[4:7, row] = path.mean
        curves[7:, row] = (scale[row] * path.covariance).reshape(9, -1)
    four = left + np.arange(4)[:, None, None]
    refined = np.add.reduce(curves[:, rows, four] * cubic, axis=1)
    weights = _normalised(refined[0])
    angle, size_std = refined[2], _OVERLAP * (sizes[:, 1:2] - sizes[:, :1])
    angle_variance = np.maximum(refined[3], 0.0) + (_OVERLAP * gradient(angle)) ** 2
    features = np.array(
        [
            np.log(np.maximum(weights, 1e-300)),
            np.exp(sizes),
            np.broadcast_to(size_std**2, sizes.shape),
            np.cos(angle),
            np.sin(angle),
            angle_variance,
            sizes,
            *refined[[4, 7]],
        ]
    )
    scale = np.add.reduce(scale[rows, four] * cubic, axis=0)
    return [
        SizePosterior(
            model=path.model,
            log_sizes=sizes[row],
            weights=weights[row],
            phase=refined[1, row],
            mean=refined[4:7, row],
            covariance=refined[7:, row].reshape(3, 3, -1),
            scale=scale[row],
            features=features[:, row],
        )
        for row, path in enumerate(paths)
    ]


def _normalised(log_weights: Float[np.ndarray, "R C"]) -> Float[np.ndarray, "R C"]:
    # Contiguous rows are added in the order in which each alone would be.
    logs = np.ascontiguousarray(log_weights)
    weights = np.exp(logs - np.maximum.reduce(logs, axis=-1, keepdims=True))
    return np.asarray(weights / np.add.reduce(weights, axis=-1, keepdims=True))


@dataclass(frozen=True, kw_only=True, slots=True)
class SizePosterior:
    """Posterior of the size of a path, and of the other quantities given K sizes."""

    model: SimilarityModel
    log_sizes: Likely
    """Logarithms of the sizes, log c."""
    weights: Likely
    """p(c | path)."""
    phase: Likely
    """Phase of the last position; mean and covariance as in `PathSimilarity`."""
    mean: Float[np.ndarray, "3 K"]
    covariance: Float[np.ndarray, "3 3 K"]
    scale: Likely
    """Factor on the variance of f, estimated from the innovations."""
    features: Float[np.ndarray, "9 K"]
    """What the estimate of the phase needs: log weight, c, and the variance of log c
    among the sizes that one represents; cosine and sine of the angle of
    `PathSimilarity`, its variance over these sizes; log c, mean and variance of ψ."""


def forecasts(
    sizes: Sequence[SizePosterior], phases: Times
) -> tuple[Complex[np.ndarray, "R M K"], Float[np.ndarray, "R M K"]]:
    """Return R paths, expected for each likely size, at increasing phases.

    Means are complex, x - iz [m]; variances are of rotation about the start [rad²].
    """
    models, rate = [path.model for path in sizes], sizes[0].model.rate
    path = np.array([np.interp(phases, x.phases, x.path) for x in models])[..., None]
    std = np.array([np.interp(phases, x.phases, x.lateral_std) for x in models])
    turning = std[..., None] / np.maximum(np.abs(path), _NEAR)
    # Of each path and size, for all phases: (R, 1, K).
    last, scale, log_sizes, turn, f, slope = np.array(
        [(x.phase, x.scale, x.log_sizes, *x.mean) for x in sizes]
    ).swapaxes(0, 1)[:, :, None]
    left = np.array([x.covariance for x in sizes])[..., None, :]
    # f at phases s from (f, df/ds) at the last phase: a f + b df/ds + remainder.
    step = phases[:, None] - last
    apart = rate * np.abs(step)
    decay = np.exp(-apart)
    a, b = decay * (1.0 + apart), decay * step
    square = a * a
    variance = scale * (1.0 - square - (rate * b) ** 2)
    variance += square * left[:, 1, 1] + b * b * left[:, 2, 2]
    variance += 2.0 * a * b * left[:, 1, 2]
    both = a * left[:, 0, 1] + b * left[:, 0, 2]
    variance = left[:, 0, 0] + turning * (2.0 * both + turning * variance)
    angle = turn + turning * (a * f + b * slope)
    means = path * np.exp(log_sizes + 1j * angle)
    return means, np.maximum(variance, 0.0)


def normalised(
    aligned: AlignedDemonstrations,
) -> tuple[AlignedDemonstrations, Float[np.ndarray, " K"]]:
    """Return demonstrations of equal size and heading, and their sizes' logarithms.

    The size of a demonstration is the root mean square of its displacement from the
    start, its heading the rotation about the vertical that fits the mean to it by least
    squares. The logarithms have a mean of zero.
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


def size_visibility(
    poses: Float[np.ndarray, "D M 6"], config: SimilarityConfig = SimilarityConfig()
) -> float:
    """Return how well size and phase of a path can be distinguished, 0 to 1.

    A change of size of a path c p(s), θ(s) displaces its poses by (p, 0), a change of
    phase by (p', θ'). For a straight path without rotation both are parallel, and its
    size is not observable. It is observable by the distance of the mean from a straight
    line and by its rotation, each divided by the deviation of another repetition, σ² +
    n², with σ that of the demonstrations and n the error of observation. Up to one root
    mean square it is 0, from two on 1. Demonstrations have one size and heading.
    """
    positions, rotations = poses[..., :3], poses[..., 3:]
    path = positions.mean(axis=0)
    line = np.linalg.eigh(path.T @ path)[1][:, -1]
    across = positions - (positions @ line)[..., None] * line
    ratios = []
    errors = config.position_std, config.rotation_std
    for deviations, error in zip((across, rotations), errors, strict=True):
        variance = error**2
        if len(poses) > 1:
            variance += deviations.var(axis=0, ddof=1).sum(axis=1).mean()
        square = (deviations.mean(axis=0) ** 2).sum(axis=1).mean()
        ratios.append(math.sqrt(square / variance))
    return min(max(max(ratios) - 1.0, 0.0), 1.0)


def size_and_heading(
    weights: Float[np.ndarray, "*N K"], features: Float[np.ndarray, "9 *N K"]
) -> Float[np.ndarray, " 4 *N"]:
    """Return size, σ of its logarithm, heading, and its σ [rad], of weighted sizes."""
    means = np.add.reduce(weights * features[6:8], axis=-1)
    squares = (features[6:8] - means[..., None]) ** 2
    squares[1] += features[8]
    stds = np.sqrt(np.maximum(np.add.reduce(weights * squares, axis=-1), 0.0))
    # NumPy's exponential differs from that of `math`.
    size, heading = means
    sizes = np.reshape([math.exp(x) for x in np.ravel(size).tolist()], size.shape)
    return np.array([sizes, stds[0], heading, stds[1]])


def gradient(values: np.ndarray) -> np.ndarray:
    """Return `numpy.gradient` along the last axis (..., N), in a tenth of the time."""
    slopes = np.empty_like(values)
    slopes[..., 1:-1] = (values[..., 2:] - values[..., :-2]) / 2.0
    slopes[..., 0] = values[..., 1] - values[..., 0]
    slopes[..., -1] = values[..., -1] - values[..., -2]
    return slopes


def advance(
    mean: Float[np.ndarray, "3 ..."],
    covariance: Float[np.ndarray, "3 3 ..."],
    step: Float[np.ndarray, "*C"],
    rate: float,
) -> tuple[Float[np.ndarray, "3 ..."], Float[np.ndarray, "3 3 ..."]]:
    """Propagate means and covariances of states (b, f, df/ds) by steps >= 0.

    b is constant, and f is a process of unit variance with the Matérn kernel of
    smoothness 3/2, (1 + λ|Δ|) exp(-λ|Δ|) with the rate λ.
    """
    decay = np.exp(-rate * step)
    # f and df/ds follow from both: columns of the transition matrix, p and q.
    p = np.array([decay * (1.0 + rate * step), -decay * rate**2 * step])
    q = np.array([decay * step, decay * (1.0 - rate * step)])
    by_p, by_q = p[:, None], q[:, None]
    moved, spread = np.empty_like(mean), np.empty_like(covariance)
    moved[0], spread[0, 0] = mean[0], covariance[0, 0]
    moved[1:] = p * mean[1] + q * mean[2]
    spread[0, 1:] = covariance[0, 1] * p + covariance[0, 2] * q
    spread[1:, 0] = p * covariance[1, 0] + q * covariance[2, 0]
    smooth = by_p * (covariance[1, 1] - 1.0) * p + by_p * covariance[1, 2] * q
    smooth += by_q * covariance[2, 1] * p
    spread[1:, 1:] = smooth + by_q * (covariance[2, 2] - rate**2) * q
    spread[1, 1] += 1.0
    spread[2, 2] += rate**2
    return moved, spread
