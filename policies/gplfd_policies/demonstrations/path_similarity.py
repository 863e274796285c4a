"""Size and heading of the observed path, relative to the demonstrated path.

Doors of different radius give paths of different size, and a robot with a heading error
observes the motion rotated about the vertical. The path so far distinguishes both from
progress: a heading error rotates all of it, size determines its curvature.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
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

    def updated(self, distance: float, angle: float) -> PathSimilarity:
        """Return the estimate with another position, if the position is far enough.

        Its distance from the start is in the horizontal plane [m], the angle is the
        direction from the start, about the vertical [rad].
        """
        if distance < self.due:
            return self
        model, config = self.model, self.model.config
        sizes = np.exp(model.log_sizes)
        shrunk = distance / sizes
        distances, *curves = model.outward
        phase, expected, lateral_std = (np.interp(shrunk, distances, c) for c in curves)
        error = np.remainder(angle - expected + math.pi, 2.0 * math.pi) - math.pi
        phase = np.maximum(phase, self.phase)
        step = phase - self.phase
        mean, covariance = advance(self.mean, self.covariance, step, model.rate)
        # r = H (ψ, f, df/ds) + e.
        lateral_std = sizes * lateral_std
        gain = distance * covariance[0] + lateral_std * covariance[1]
        explained = distance * gain[0] + lateral_std * gain[1]
        variance = explained + config.position_std**2
        innovation = distance * error - (distance * mean[0] + lateral_std * mean[1])
        mean += gain * (innovation / variance)
        covariance -= gain[:, None] * (gain / variance)
        left = explained * (1.0 - explained / variance)
        return replace(
            self,
            log_variance=self.log_variance + np.log(variance),
            squared_innovations=self.squared_innovations + innovation**2 / variance,
            count=self.count + 1,
            mean=mean,
            covariance=covariance,
            phase=phase,
            due=distance + config.spacing,
            angle=mean[0] + lateral_std / distance * mean[1],
            angle_variance=left / distance**2,
        )

    @cached_property
    def posterior(self) -> SizePosterior:
        """The likely sizes given the path, on a finer grid."""
        config, grid = self.model.config, self.model.log_sizes
        # (ν + δ²)/(ν + n), at least the mean's share: factor on the covariances, with
        # which p(c, path) is a Student-t density.
        free = config.scale_weight + self.count
        scale = (config.scale_weight + self.squared_innovations) / free
        scale = np.maximum(scale, self.model.least_scale)
        misfit = free * np.log(scale)
        log_weights = -0.5 * (_STEPS**2 + self.log_variance + misfit)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        centre = float((weights * grid).sum())
        variance = float((weights * (grid - centre) ** 2).sum())
        spacing = float(grid[1] - grid[0])
        reach = _REACH * max(math.sqrt(variance), 0.5 * spacing)
        low, high = max(centre - reach, float(grid[0])), centre + reach
        sizes = np.linspace(low, min(high, float(grid[-1])), _SIZES)
        # All curves are smooth in log c: cubic interpolation through four sizes.
        position = (sizes - grid[0]) / max(spacing, _NEAREST)
        left = np.maximum(np.minimum(position.astype(np.int64) - 1, grid.size - 4), 0)
        u = position - left
        cubic = np.array(
            [
                -(u - 1.0) * (u - 2.0) * (u - 3.0) / 6.0,
                u * (u - 2.0) * (u - 3.0) / 2.0,
                -u * (u - 1.0) * (u - 3.0) / 2.0,
                u * (u - 1.0) * (u - 2.0) / 6.0,
            ]
        )
        curves = np.empty((16, grid.size))
        curves[0], curves[1], curves[2] = log_weights, self.phase, self.angle
        np.multiply(scale, self.angle_variance, out=curves[3])
        curves[4:7] = self.mean
        np.multiply(scale, self.covariance, out=curves[7:].reshape(3, 3, -1))
        four = left + np.arange(4)[:, None]
        refined = np.add.reduce(curves[:, four] * cubic, axis=1)
        weights = np.exp(refined[0] - refined[0].max())
        weights /= weights.sum()
        angle, size_std = refined[2], _OVERLAP * float(sizes[1] - sizes[0])
        angle_variance = np.maximum(refined[3], 0.0) + (_OVERLAP * gradient(angle)) ** 2
        features = [
            np.log(np.maximum(weights, 1e-300)),
            np.exp(sizes),
            np.full(sizes.size, size_std**2),
            np.cos(angle),
            np.sin(angle),
            angle_variance,
            sizes,
            *refined[[4, 7]],
        ]
        return SizePosterior(
            model=self.model,
            log_sizes=sizes,
            weights=weights,
            phase=refined[1],
            mean=refined[4:7],
            covariance=refined[7:].reshape(3, 3, -1),
            scale=np.add.reduce(scale[four] * cubic, axis=0),
            features=np.array(features),
        )


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
    """What the estimate of the phase needs: the logarithm of the weight, c, and the
    variance of log c among the sizes that one represents; cosine and sine of the angle
    of `PathSimilarity`, and its variance over these sizes; log c, and mean and variance
    of ψ."""

    def forecast(
        self, phases: Times
    ) -> tuple[Complex[np.ndarray, "M K"], Float[np.ndarray, "M K"]]:
        """Return the expected paths of the likely sizes at increasing phases.

        They are means, complex x - iz [m], and variances of rotation about the start
        [rad²].
        """
        model, covariance = self.model, self.covariance
        turn, f, slope = self.mean
        path: np.ndarray = np.interp(phases, model.phases, model.path)
        lateral_std = np.interp(phases, model.phases, model.lateral_std)
        turning = (lateral_std / np.maximum(np.abs(path), _NEAR))[:, None]
        # f at phases s from (f, df/ds) at the last phase: a f + b df/ds + remainder.
        step = phases[:, None] - self.phase
        apart = model.rate * np.abs(step)
        decay = np.exp(-apart)
        a, b = decay * (1.0 + apart), decay * step
        square = a * a
        variance = self.scale * (1.0 - square - (model.rate * b) ** 2)
        variance += square * covariance[1, 1] + b * b * covariance[2, 2]
        variance += 2.0 * a * b * covariance[1, 2]
        both = a * covariance[0, 1] + b * covariance[0, 2]
        variance = covariance[0, 0] + turning * (2.0 * both + turning * variance)
        angle = turn + turning * (a * f + b * slope)
        means = path[:, None] * np.exp(self.log_sizes + 1j * angle)
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
    mean square the result is 0, from two on 1. The demonstrations are of equal size and
    heading [m, rad].
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
    """Return the same as `numpy.gradient` for values (N,), in a tenth of the time."""
    slopes = np.empty_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / 2.0
    slopes[0], slopes[-1] = values[1] - values[0], values[-1] - values[-2]
    return slopes


def advance(
    mean: Float[np.ndarray, "3 C"],
    covariance: Float[np.ndarray, "3 3 C"],
    step: Float[np.ndarray, " C"],
    rate: float,
) -> tuple[Float[np.ndarray, "3 C"], Float[np.ndarray, "3 3 C"]]:
    """Propagate mean and covariance of C states (b, f, df/ds) by steps >= 0.

    b is constant, and f is a process of unit variance with the Matérn kernel of
    smoothness 3/2, (1 + λ|Δ|) exp(-λ|Δ|) with the rate λ.
    """
    decay = np.exp(-rate * step)
    move = np.zeros((3, 3, step.size))
    move[0, 0] = 1.0
    move[1, 1] = decay * (1.0 + rate * step)
    move[1, 2] = decay * step
    move[2, 1] = -decay * rate**2 * step
    move[2, 2] = decay * (1.0 - rate * step)
    stationary = np.diag([0.0, 1.0, rate**2])[:, :, None]
    moved = np.einsum("ijc,jc->ic", move, mean)
    spread = np.einsum("ijc,jkc,lkc->ilc", move, covariance - stationary, move)
    return moved, spread + stationary
