"""Size and heading of the path that is seen, relative to the demonstrated one.

Doors of different radius are paths of different size, and a robot that stands askew
sees the whole motion turned about the vertical. Both change the direction in which the
hand is seen from its start, as progress does. The path so far distinguishes them: a
heading error turns all of it, size says how fast it bends, and progress goes along it.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field, replace
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_env.validation.fields import quantity
from gplfd_policies.arrays.records import Settings
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.normalised import normalised

_STEPS: Final = np.linspace(-2.5, 2.5, 61)
"""Sizes that are compared, in prior standard deviations of the logarithm of size."""
_SMOOTHING: Final = 20
"""Samples on either side over which the demonstrations' variance is averaged."""
_MOST: Final = 15
"""Sizes that a forecast mixes, at most."""
_LIKELY: Final = 1e-4
"""Share of the probability below which a size is left out of a forecast."""
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
    scale_weight: float = quantity(8.0, above=0.0)
    """ν: number of positions that the stated errors are worth; more positions decide
    themselves how large these are. Tuned."""
    spacing: float = quantity(0.004, above=0.0, unit="m")
    """Distance between two positions that are used [m]."""
    least_wobble: float = quantity(1e-3, above=0.0, unit="m")
    """Least smooth deviation across the path of demonstrations of equal size [m]."""
    wobble_scale: float = quantity(0.3, above=0.0)
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
    path: Float[np.ndarray, " M"]
    """Mean path of the demonstrations, of one size and heading, complex [m]."""
    wobble: Phases
    """σ: standard deviation across it of demonstrations of equal size [m]."""
    log_sizes: Sizes
    """Logarithms of the sizes that are compared."""
    heading_std: float
    """τ: what the heading errs by before the path is seen [rad]."""
    _distances: Phases = field(repr=False)
    _first_phases: Phases = field(repr=False)
    _angles: Phases = field(repr=False)
    _first_wobble: Phases = field(repr=False)

    @classmethod
    def of(
        cls,
        aligned: AlignedDemonstrations,
        config: SimilarityConfig = SimilarityConfig(),
    ) -> SimilarityModel:
        """Return the model of demonstrations, of whose handle's axis where one turns."""
        similar = normalised(aligned)
        poses, count = similar.aligned.poses, len(aligned.poses)
        level = poses[..., 0] - 1j * poses[..., 2]
        path = level.mean(axis=0)
        wobble = np.full(len(path), config.least_wobble)
        if count > 1:
            # Across the mean path as seen from the start; one degree of freedom less.
            across = (level * np.exp(-1j * np.angle(path))).imag
            variance = (across**2).sum(axis=0) * (1.0 + 1.0 / count) / (count - 1)
            padded = np.pad(variance, _SMOOTHING, mode="edge")
            window = np.full(2 * _SMOOTHING + 1, 1.0 / (2 * _SMOOTHING + 1))
            smooth = np.sqrt(np.convolve(padded, window, "valid"))
            wobble = np.maximum(smooth, config.least_wobble)
        scatter = float((similar.log_sizes**2).sum())
        variance = config.size_weight * config.size_std**2 + scatter
        variance *= (1.0 + 1.0 / count) / (config.size_weight + count - 1)
        # Where a path comes back nearer to its start, the way out counts.
        furthest, first = np.unique(
            np.maximum.accumulate(np.abs(path)), return_index=True
        )
        moved = furthest > _NEAREST
        first = first[moved]
        angles = np.unwrap(np.angle(path[first]))
        return cls(
            config=config,
            phases=aligned.times,
            path=path,
            wobble=wobble,
            log_sizes=math.sqrt(variance) * _STEPS,
            heading_std=config.heading_std,
            _distances=np.append(0.0, furthest[moved]),
            _first_phases=np.append(aligned.times[0], aligned.times[first]),
            _angles=np.append(angles[:1], angles) if angles.size else np.zeros(1),
            _first_wobble=np.append(config.least_wobble, wobble[first]),
        )

    def unseen(self) -> PathSimilarity:
        """Return what is known before any of the path is seen."""
        rate = self.rate
        covariance = np.zeros((3, 3, _STEPS.size))
        covariance += np.diag([self.heading_std**2, 1.0, rate**2])[:, :, None]
        return PathSimilarity(
            model=self,
            log_variance=np.zeros(_STEPS.size),
            surprise=np.zeros(_STEPS.size),
            count=0,
            mean=np.zeros((3, _STEPS.size)),
            covariance=covariance,
            phase=np.full(_STEPS.size, self._first_phases[0]),
            due=self.config.spacing,
            angle=np.zeros(_STEPS.size),
            angle_variance=np.full(_STEPS.size, self.heading_std**2),
        )

    def at(
        self, phases: Phases
    ) -> tuple[Float[np.ndarray, " M"], Float[np.ndarray, " M"]]:
        """Return the mean path at phases, and σ over the distance from its start."""
        path: np.ndarray = np.interp(phases, self.phases, self.path)
        wobble = np.interp(phases, self.phases, self.wobble)
        return path, wobble / np.maximum(np.abs(path), _NEAR)

    @property
    def rate(self) -> float:
        """√3 over the length-scale of the Matérn kernel of f [1/phase]."""
        return math.sqrt(3.0) / self.config.wobble_scale


@dataclass(frozen=True, kw_only=True, slots=True)
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
        phase = np.interp(shrunk, model._distances, model._first_phases)
        expected = np.interp(shrunk, model._distances, model._angles)
        error = np.remainder(angle - expected + math.pi, 2.0 * math.pi) - math.pi
        phase = np.maximum(phase, self.phase)
        mean, covariance = advance(
            self.mean, self.covariance, phase - self.phase, model.rate
        )
        # r = H (ψ, f, df/ds) + e.
        wobble = sizes * np.interp(shrunk, model._distances, model._first_wobble)
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
        """(ν + δ²)/(ν + n): factor on the covariances from the innovations so far."""
        free = self.model.config.scale_weight
        return (free + self.surprise) / (free + self.count)

    @property
    def weights(self) -> Sizes:
        """p(c | path) of every size: Student-t, as the scale is learned."""
        free = self.model.config.scale_weight
        surprise = (free + self.count) * np.log1p(self.surprise / free)
        exponent = -0.5 * (_STEPS**2 + self.log_variance + surprise)
        likely = np.exp(exponent - exponent.max())
        weights: Sizes = likely / likely.sum()
        return weights

    @property
    def log_size(self) -> tuple[float, float]:
        """Mean and standard deviation of log c."""
        weights, sizes = self.weights, self.model.log_sizes
        mean = float((weights * sizes).sum())
        return mean, math.sqrt(float((weights * (sizes - mean) ** 2).sum()))

    def forecast(
        self, phases: Phases
    ) -> tuple[
        Float[np.ndarray, " K"], Float[np.ndarray, "M K"], Float[np.ndarray, "M K"]
    ]:
        """Return the paths that are expected, for K of the likely sizes.

        Args:
            phases: Where along the task, increasing, (M,).

        Returns:
            Their weights, their means as complex numbers x - iz [m], and the variances
            of the angles by which they may be turned about the start [rad²].
        """
        model, weights = self.model, self.weights
        likely = np.flatnonzero(weights > _LIKELY)
        likely = likely[:: math.ceil(likely.size / _MOST)]
        weights = weights[likely] / weights[likely].sum()
        (turn, f, slope), covariance = self.mean[:, likely], self.covariance[..., likely]
        path, turning = model.at(phases)

        # f at phases s from (f, df/ds) at the last one: a f + b df/ds, and a remainder.
        step = phases[:, None] - self.phase[likely]
        decay = np.exp(-model.rate * np.abs(step))
        a, b = decay * (1.0 + model.rate * np.abs(step)), decay * step
        variance = 1.0 - a * a - (model.rate * b) ** 2
        variance += a * a * covariance[1, 1] + b * b * covariance[2, 2]
        variance += 2.0 * a * b * covariance[1, 2]
        both = a * covariance[0, 1] + b * covariance[0, 2]
        turning = turning[:, None]
        variance = covariance[0, 0] + turning * (2.0 * both + turning * variance)
        angle = turn + turning * (a * f + b * slope)
        sizes = np.exp(model.log_sizes[likely])
        means = path[:, None] * sizes * np.exp(1j * angle)
        return weights, means, self.scale[likely] * np.maximum(variance, 0.0)

    @property
    def table(self) -> Float[np.ndarray, "4 C"]:
        """Of every size: log p(c | path), c, and `angle` with its variance."""
        return np.array(
            [
                np.log(np.maximum(self.weights, 1e-300)),
                np.exp(self.model.log_sizes),
                self.angle,
                self.scale * self.angle_variance,
            ]
        )


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
