"""Size and heading of the path that is seen, relative to the demonstrated one.

Doors of different radius are paths of different size, and a robot that stands askew
sees the whole motion turned about the vertical. Both change the direction in which the
hand is seen from its start, as progress does. The path so far distinguishes them: a
heading error turns all of it, size says how fast it bends, and progress goes along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np

from gplfd_env.validation.fields import quantity
from gplfd_policies.arrays.records import Settings
from gplfd_policies.arrays.shapes import Complex, Float
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.normalised import normalised

_STEPS: Final = np.linspace(-2.5, 2.5, 31)
"""Sizes that are compared, in prior standard deviations of the logarithm of size."""
_SMOOTHING: Final = 20
"""Samples on either side over which the demonstrations' variance is averaged."""
_LIKELY: Final = 19
"""Number of likely sizes."""
_OVERLAP: Final = 0.6
"""Standard deviation of those that one size stands for, over the distance to the next:
together they leave no gaps."""
_REACH: Final = 3.0
"""How far they reach on either side, in standard deviations."""
_NEAR: Final = 1e-3
"""Least distance from the start by which deviations are divided [m]."""
_NEAREST: Final = 1e-6
"""A distance [m] that divides."""

Sizes = Float[np.ndarray, " C"]
Phases = Float[np.ndarray, " M"]


@dataclass(frozen=True, kw_only=True, slots=True)
class SimilarityConfig(Settings):
    """How size and heading are estimated."""

    size_std: float = quantity(0.35, low=0.0)
    """Standard deviation of the logarithm of size that is expected before any
    demonstration; they dilute it."""
    size_weight: float = quantity(12.0, above=0.0)
    """Number of demonstrations that this expectation is worth."""
    heading_std: float = quantity(math.radians(3.0), low=0.0, unit="rad")
    """Turn of the whole motion about the vertical [rad]: how askew the robot stands to
    the door. 0 trusts the heading."""
    position_std: float = quantity(3e-3, above=0.0, unit="m")
    """Error of a position across the path that the next does not share [m]."""
    rotation_std: float = quantity(0.15, above=0.0, unit="rad")
    """Error of an observed rotation [rad]."""
    scale_weight: float = quantity(40.0, above=0.0)
    """ν: number of positions that the stated errors are worth; more positions decide
    themselves how large these are. Tuned."""
    spacing: float = quantity(0.004, above=0.0, unit="m")
    """Distance between two positions that are used [m]."""
    least_wobble: float = quantity(1e-3, above=0.0, unit="m")
    """Least smooth deviation across the path of demonstrations of equal size [m]."""
    wobble_scale: float = quantity(0.5, above=0.0)
    """Length-scale of this deviation, in phase."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SimilarityModel:
    """The demonstrated path of mean size, and how others deviate from it.

    Positions are complex numbers x - iz in the horizontal plane [m], so that a factor
    c exp(iψ) enlarges by c and turns about the vertical by ψ.
    """

    config: SimilarityConfig
    """How size and heading are estimated."""
    phases: Phases
    """Where the mean path is known."""
    path: Complex[np.ndarray, " M"]
    """Mean path of the demonstrations, of one size and heading, complex [m]."""
    wobble: Phases
    """σ: standard deviation across it of demonstrations of equal size [m]."""
    lag: Phases
    """Standard deviation along it of demonstrations of equal size [m]."""
    log_sizes: Sizes
    """Logarithms of the sizes that are compared; 0 where the path shows no size."""
    least_scale: float
    """Share of the stated variances that is the mean path's own error."""
    outward: Float[np.ndarray, "4 F"]
    """Where the mean path first comes so far from its start: distance [m], phase,
    direction about the vertical [rad] and `wobble` [m]."""

    @classmethod
    def of(
        cls,
        aligned: AlignedDemonstrations,
        config: SimilarityConfig = SimilarityConfig(),
    ) -> SimilarityModel:
        """Return the model of demonstrations; of a handle that turns, of its axis."""
        similar = normalised(aligned)
        poses, count = similar.aligned.poses, len(aligned.poses)
        level = poses[..., 0] - 1j * poses[..., 2]
        path = level.mean(axis=0)
        wobble = lag = np.full(len(path), config.least_wobble)
        if count > 1:
            # Across is meant as seen from the start.
            tangent = np.gradient(path)
            tangent /= np.maximum(np.abs(tangent), _NEAREST)
            along = ((level - path) * tangent.conj()).real
            across = (level * np.exp(-1j * np.angle(path))).imag
            lag, wobble = (_smooth_std(e, config.least_wobble) for e in (along, across))
        scatter = float((similar.log_sizes**2).sum())
        variance = config.size_weight * config.size_std**2 + scatter
        variance *= (1.0 + 1.0 / count) / (config.size_weight + count - 1)
        shown = size_visibility(poses[:, aligned.times <= aligned.end], config)
        # Where a path comes back nearer to its start, the way out counts.
        furthest, first = np.unique(
            np.maximum.accumulate(np.abs(path)), return_index=True
        )
        moved = furthest > _NEAREST
        first = first[moved]
        angles = np.unwrap(np.angle(path[first]))
        direction = float(angles[0]) if angles.size else 0.0
        return cls(
            config=config,
            phases=aligned.times,
            path=path,
            wobble=wobble,
            lag=lag,
            log_sizes=math.sqrt(variance) * shown * _STEPS,
            least_scale=1.0 / (count + 1),
            outward=np.hstack(
                [
                    [[0.0], [aligned.times[0]], [direction], [config.least_wobble]],
                    [furthest[moved], aligned.times[first], angles, wobble[first]],
                ]
            ),
        )

    def unseen(self) -> PathSimilarity:
        """Return what is known before any of the path is seen."""
        variances = [self.config.heading_std**2, 1.0, self.rate**2]
        covariance = np.zeros((3, 3, _STEPS.size))
        covariance += np.diag(variances)[:, :, None]
        return PathSimilarity(
            model=self,
            log_variance=np.zeros(_STEPS.size),
            surprise=np.zeros(_STEPS.size),
            count=0,
            mean=np.zeros((3, _STEPS.size)),
            covariance=covariance,
            phase=np.full(_STEPS.size, self.outward[1, 0]),
            due=self.config.spacing,
            angle=np.zeros(_STEPS.size),
            angle_variance=np.full(_STEPS.size, self.config.heading_std**2),
        )

    def at(
        self, phases: Phases
    ) -> tuple[Complex[np.ndarray, " M"], Float[np.ndarray, " M"]]:
        """Return the mean path at phases, and σ over the distance from its start."""
        path: np.ndarray = np.interp(phases, self.phases, self.path)
        wobble = np.interp(phases, self.phases, self.wobble)
        return path, wobble / np.maximum(np.abs(path), _NEAR)

    @property
    def rate(self) -> float:
        """√3 over the length-scale of the Matérn kernel of f [1/phase]."""
        return math.sqrt(3.0) / self.config.wobble_scale


@dataclass(frozen=True, kw_only=True)
class PathSimilarity:
    """What the path so far says about its size and heading, for a grid of sizes.

    A path is the demonstrated one of mean size, enlarged by c and turned by ψ. At the
    distance d from its start, where the demonstrations have the phase s(d/c) and lie in
    the direction a(d/c), it lies across theirs by

        r(d) = d (α(d) - a(d/c)) = d ψ + c σ(s) f(s) + e,    e ~ N(0, n²),

    σ the demonstrations' own deviation across the path and f a Gaussian process of unit
    variance with the Matérn kernel of smoothness 3/2. A priori ψ ~ N(0, τ²), and log c
    is normal with the conjugate mix of `SimilarityConfig.size_std` and the
    demonstrations' own sizes as its variance. Given c all is linear: (ψ, f, df/ds) has
    a Kalman filter along the path, whose innovations give p(c | path). The state at the
    end of what was seen is all that the path says about the rest.
    """

    model: SimilarityModel
    """The demonstrated path."""
    log_variance: Sizes
    """Sum of the logarithms of the innovations' variances."""
    surprise: Sizes
    """δ²: sum of squared innovations over their variances."""
    count: int
    """n: number of positions used."""
    mean: Float[np.ndarray, "3 C"]
    """Mean of (ψ [rad], f, df/ds) given every size."""
    covariance: Float[np.ndarray, "3 3 C"]
    """Its covariance."""
    phase: Sizes
    """Phase of the last position for every size."""
    due: float
    """Distance from which the next position is used [m]."""
    angle: Sizes
    """How far the path is seen turned from the demonstrated one of each size at the
    same distance, by its heading and its deviation [rad]."""
    angle_variance: Sizes
    """Variance of that [rad²]."""

    def updated(self, distance: float, angle: float) -> PathSimilarity:
        """Return the estimate with one more position, if that is far enough on.

        Args:
            distance: From the start of the path, in the horizontal plane [m].
            angle: Its direction about the vertical there [rad].
        """
        if distance < self.due:
            return self
        model, config = self.model, self.model.config
        sizes = np.exp(model.log_sizes)
        shrunk = distance / sizes
        distances, *curves = model.outward
        phase, expected, wobble = (np.interp(shrunk, distances, c) for c in curves)
        error = np.remainder(angle - expected + math.pi, 2.0 * math.pi) - math.pi
        phase = np.maximum(phase, self.phase)
        mean, covariance = advance(
            self.mean, self.covariance, phase - self.phase, model.rate
        )
        # r = H (ψ, f, df/ds) + e.
        wobble = sizes * wobble
        gain = distance * covariance[0] + wobble * covariance[1]
        explained = distance * gain[0] + wobble * gain[1]
        variance = explained + config.position_std**2
        innovation = distance * error - (distance * mean[0] + wobble * mean[1])
        mean += gain * (innovation / variance)
        covariance -= gain[:, None] * (gain / variance)
        left = explained * (1.0 - explained / variance)
        return replace(
            self,
            log_variance=self.log_variance + np.log(variance),
            surprise=self.surprise + innovation**2 / variance,
            count=self.count + 1,
            mean=mean,
            covariance=covariance,
            phase=phase,
            due=distance + config.spacing,
            angle=mean[0] + wobble / distance * mean[1],
            angle_variance=left / distance**2,
        )

    @property
    def scale(self) -> Sizes:
        """(ν + δ²)/(ν + n): factor on the covariances from the innovations so far.

        It is not less than the share of the demonstrations' mean in the deviations.
        """
        free = self.model.config.scale_weight
        scale = (free + self.surprise) / (free + self.count)
        return np.maximum(scale, self.model.least_scale)

    @cached_property
    def features(self) -> Float[np.ndarray, "6 K"]:
        """What the phase of a pose takes of the likely sizes c.

        The logarithm of the weight, c, the variance of log c, cosine and sine of the
        angle, and its variance.
        """
        likely = self.likely
        return np.array(
            [
                np.log(np.maximum(likely.weights, 1e-300)),
                np.exp(likely.log_sizes),
                np.full(likely.log_sizes.size, likely.size_std**2),
                np.cos(likely.angle),
                np.sin(likely.angle),
                likely.angle_variance,
            ]
        )

    @cached_property
    def likely(self) -> LikelySizes:
        """The sizes that the path leaves likely, finer than those that are compared."""
        config, grid = self.model.config, self.model.log_sizes
        # p(c, path): Student-t, as the scale is learned.
        scale = self.scale
        surprise = (config.scale_weight + self.count) * np.log(scale)
        log_weights = -0.5 * (_STEPS**2 + self.log_variance + surprise)
        weights = np.exp(log_weights - log_weights.max())
        weights /= weights.sum()
        centre = float((weights * grid).sum())
        variance = float((weights * (grid - centre) ** 2).sum())
        spacing = float(grid[1] - grid[0])
        reach = _REACH * max(math.sqrt(variance), 0.5 * spacing)
        sizes = np.linspace(
            max(centre - reach, float(grid[0])),
            min(centre + reach, float(grid[-1])),
            _LIKELY,
        )
        # All is smooth in log c: between the sizes, the cubic through four of them.
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
        found = np.add.reduce(curves[:, four] * cubic, axis=1)
        weights = np.exp(found[0] - found[0].max())
        return LikelySizes(
            model=self.model,
            log_sizes=sizes,
            weights=weights / weights.sum(),
            phase=found[1],
            angle=found[2],
            angle_variance=np.maximum(found[3], 0.0)
            + (_OVERLAP * gradient(found[2])) ** 2,
            size_std=_OVERLAP * float(sizes[1] - sizes[0]),
            mean=found[4:7],
            covariance=found[7:].reshape(3, 3, -1),
            scale=np.add.reduce(scale[four] * cubic, axis=0),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class LikelySizes:
    """The posterior of a path's size, and of the rest given each of K sizes."""

    model: SimilarityModel
    """The demonstrated path."""
    log_sizes: Float[np.ndarray, " K"]
    """Logarithms of the sizes, log c."""
    weights: Float[np.ndarray, " K"]
    """p(c | path)."""
    phase: Float[np.ndarray, " K"]
    """Phase of the last position."""
    angle: Float[np.ndarray, " K"]
    """How far the path is seen turned from the demonstrated one at the same distance,
    by its heading and its deviation [rad]."""
    angle_variance: Float[np.ndarray, " K"]
    """Variance of that, for all that the size stands for [rad²]."""
    size_std: float
    """Standard deviation of log c among those that one size stands for."""
    mean: Float[np.ndarray, "3 K"]
    """Mean of (ψ [rad], f, df/ds)."""
    covariance: Float[np.ndarray, "3 3 K"]
    """Its covariance."""
    scale: Float[np.ndarray, " K"]
    """Factor on the variance of f that the innovations show."""

    def weighed(self, weights: Float[np.ndarray, " K"]) -> LikelySizes:
        """Return the posterior with other weights, which need not sum to one."""
        return replace(self, weights=weights / weights.sum())

    @property
    def log_size(self) -> tuple[float, float]:
        """Mean and standard deviation of log c."""
        weights, sizes = self.weights, self.log_sizes
        mean = float((weights * sizes).sum())
        return mean, math.sqrt(float((weights * (sizes - mean) ** 2).sum()))

    @property
    def heading(self) -> tuple[float, float]:
        """Mean and standard deviation of ψ [rad]."""
        weights, turns = self.weights, self.mean[0]
        mean = float((weights * turns).sum())
        variance = self.covariance[0, 0] + (turns - mean) ** 2
        return mean, math.sqrt(max(float((weights * variance).sum()), 0.0))

    def forecast(
        self, phases: Phases
    ) -> tuple[Complex[np.ndarray, "M K"], Float[np.ndarray, "M K"]]:
        """Return the paths that are expected of the likely sizes.

        Args:
            phases: Where along the task, increasing, (M,).

        Returns:
            Their means as complex numbers x - iz [m], and the variances of the angles
            by which they may be turned about the start [rad²].
        """
        model, covariance = self.model, self.covariance
        turn, f, slope = self.mean
        path, turning = model.at(phases)
        turning = turning[:, None]
        # f at phases s from (f, df/ds) at the last one: a f + b df/ds, and a remainder.
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


def size_visibility(
    poses: Float[np.ndarray, "D M 6"],
    config: SimilarityConfig = SimilarityConfig(),
) -> float:
    """Return how far a path distinguishes its size from its phase, 0 to 1.

    A change of the size of a path c p(s), θ(s) displaces its poses by (p, 0), a change
    of its phase by (p', θ'). Where the path is straight from its start and does not
    turn, the two are parallel everywhere: the enlarged path is the same path, and its
    size is a matter of convention. Size shows in the mean's distance from a straight
    line and in its rotation. Each is divided by the deviation that one more repetition
    has, σ² + n², with σ the demonstrations' own and n the error of observation. A root
    mean square of one such deviation, along the path, is no more than chance leaves in
    the mean path, and shows nothing; from two on the size shows entirely.

    Args:
        poses: Demonstrations of one size and heading [m, rad].
        config: Errors of observation.
    """
    positions, rotations = poses[..., :3], poses[..., 3:]
    path = positions.mean(axis=0)
    line = np.linalg.eigh(path.T @ path)[1][:, -1]
    across = positions - (positions @ line)[..., None] * line
    ratios = []
    for deviations, error in (
        (across, config.position_std),
        (rotations, config.rotation_std),
    ):
        variance = error**2
        if len(poses) > 1:
            variance += deviations.var(axis=0, ddof=1).sum(axis=1).mean()
        square = (deviations.mean(axis=0) ** 2).sum(axis=1).mean()
        ratios.append(math.sqrt(square / variance))
    return min(max(max(ratios) - 1.0, 0.0), 1.0)


def gradient(values: np.ndarray) -> np.ndarray:
    """Return `numpy.gradient` of values (N,), in a tenth of its time."""
    slopes = np.empty_like(values)
    slopes[1:-1] = (values[2:] - values[:-2]) / 2.0
    slopes[0], slopes[-1] = values[1] - values[0], values[-1] - values[-2]
    return slopes


def _smooth_std(deviations: Float[np.ndarray, "D M"], least: float) -> Phases:
    """Return the standard deviation of a repetition, averaged along the task [m]."""
    count, width = len(deviations), 2 * _SMOOTHING + 1
    # The deviations are those from their own mean: one degree of freedom less.
    variance = (deviations**2).sum(axis=0) * (1.0 + 1.0 / count) / (count - 1)
    padded = np.pad(variance, _SMOOTHING, mode="edge")
    smooth = np.convolve(padded, np.full(width, 1.0 / width), "valid")
    return np.maximum(np.sqrt(smooth), least)


def advance(
    mean: Float[np.ndarray, "3 C"],
    covariance: Float[np.ndarray, "3 3 C"],
    step: Float[np.ndarray, " C"],
    rate: float,
) -> tuple[Float[np.ndarray, "3 C"], Float[np.ndarray, "3 3 C"]]:
    """Return mean and covariance of C states (b, f, df/ds) further along by steps >= 0.

    b is constant and f a process of unit variance with the Matérn kernel of smoothness
    3/2, (1 + λ|Δ|) exp(-λ|Δ|) with the rate λ.
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
