"""Phase rules: estimation of the phase of an observed pose.

The policy of Arduengo et al., arXiv:2002.09979, is a function of time, but a compliant
robot lags behind the clock, and a policy conditioned on clock times learns its own lag.
Therefore the phase of an observation is the one at which the *demonstrations* are
nearest to it, corrected for the heading error estimated from the path so far.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Float, Int
from gplfd_policies.demonstrations.path_similarity import (
    SimilarityConfig,
    SimilarityModel,
    SizePosterior,
    normalised,
    posteriors,
    size_and_heading,
    updated,
)
from gplfd_policies.demonstrations.turned_handle import TurnedHandle, turned_handle
from gplfd_policies.movements.movement import Movement

_GRID: Final = np.linspace(0.0, 1.0, 201)
_POINTS: Final = _GRID.tolist()
_SPACING: Final = float(_GRID[1])
_FAR: Final = 1e100
"""Standard deviation of the direction outside the grid; the cost there is greater."""

_FEATURES: Final = 6  # number of features of a pose
POSE_ERROR: Final = (2e-3, 0.15)
"""Errors of an observed pose that no demonstration shows: position [m], compliance and
slip of the grasp; rotation [rad], of the hand on the bar, which precedes the door's."""


@dataclass(frozen=True, slots=True)
class PhaseEstimate:
    """Estimated phases of observed poses, one number of each kind per pose."""

    phase: PerRow
    """Phases of the poses, 0..1, and their standard deviations."""
    std: PerRow
    misfit: PerRow
    """Root mean square of the features' errors over their standard deviations near
    these phases: about 1 or less is as expected; NaN for a rule without comparison."""
    inferred: Sequence[float] | Float[np.ndarray, " 4 *N"] = (math.nan,) * 4
    """Size of the paths so far, σ of its logarithm, heading and its σ [rad]."""
    posteriors: Sequence[SizePosterior] = ()
    weights: Float[np.ndarray, "A K"] | None = None
    """Likely sizes given the paths, and their weights given also the present poses."""

    def sizes(self, index: int) -> SizePosterior | None:
        """Return the likely sizes of a path and its present pose, if there are any."""
        if self.weights is None:
            return None
        return replace(self.posteriors[index], weights=self.weights[index])


@runtime_checkable
class PhaseRule(Protocol):
    """Estimates the phases of the observed poses of N rows."""

    settings: Any
    """Settings that must be equal for rules to be stacked."""

    @classmethod
    def stacked(cls, rules: Sequence[Any]) -> PhaseRule:
        """Return one rule for the rows of several rules with equal settings."""

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the paths of these rows and begin at the start of the task."""

    def update(
        self, poses: Axes, previous: PerRow, command: PerRow, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the phases of observed poses, and their uncertainty.

        Poses [m, rad] are in the task frame; ``previous`` are the phases of their last
        observations, 0 at the start of the task, ``command`` those of their set-points.
        """

    def rate(self, phases: PerRow, rows: Rows = ALL_ROWS) -> Axes:
        """Return dμ/ds of these rows' demonstrations at phases, (A, 6)."""


class ClockPhase:
    """The phase of an observation is that of the command, as in the paper."""

    settings: object = ()

    @classmethod
    def stacked(cls, rules: Sequence[ClockPhase]) -> ClockPhase:
        """Return a clock."""
        return cls()

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Do nothing: a clock has no memory."""

    def update(
        self, poses: Axes, previous: PerRow, command: PerRow, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the command phases, treated as certain."""
        certain = np.zeros_like(command)
        return PhaseEstimate(command, certain, np.full_like(command, np.nan))

    def rate(self, phases: PerRow, rows: Rows = ALL_ROWS) -> Axes:
        """Return zero: the phase is treated as certain."""
        return np.zeros((*phases.shape, 6))


@dataclass(frozen=True, kw_only=True, slots=True)
class PathPhaseConfig:
    """Settings of the estimation of the phase from the path."""

    position_noise: float = quantity(POSE_ERROR[0], low=0.0, unit="m")
    """n_v: error of the observed position beyond the demonstrations' spread [m]."""
    rotation_noise: float = quantity(POSE_ERROR[1], low=0.0, unit="rad")
    """n_θ: that of the observed rotation [rad]."""
    similarity: SimilarityConfig = field(default_factory=SimilarityConfig)
    """Estimation of size and heading error."""
    distance_share: float = quantity(0.03, low=0.0)
    """κ: further σ of the distance from the start, as a share of it. Tuned."""
    window: tuple[float, float] = (0.02, 0.05)
    """Greatest change of the phase per observation: backward, forward."""
    least_std: float = quantity(0.003, above=0.0)
    """Least standard deviation of a phase. Tuned."""
    largest_std: float = quantity(0.1, above=0.0)
    """Greatest standard deviation of a phase. Tuned."""
    lost_misfit: float = quantity(3.0, low=0.0)
    """Misfit above which the phase is searched along the whole task. Tuned."""
    clearer_share: float = quantity(0.5, low=0.0, high=1.0)
    """A phase elsewhere needs a misfit of less than this share of the nearby one."""

    def __post_init__(self) -> None:
        check_quantities(self)
        if len(self.window) != 2 or not all(0.0 <= w < math.inf for w in self.window):
            raise ValueError(
                "PathPhaseConfig.window must be two finite phases >= 0, backward and "
                f"forward, got {self.window}"
            )


class PathPhase:
    """The phase at which the demonstrated distribution is nearest to a pose.

    The features of a pose are the distance ρ = |v| of the hand from the closed handle,
    the direction u = v/|v| of that displacement, and the hand's rotation θ. If a handle
    is turned first, v is the displacement of the handle's axis, and θ is the rotation
    of the leaf plus the greatest turn of the handle so far
    (`gplfd_policies.demonstrations.turned_handle`): the handle turns back because the
    policy commands it. A path scaled by c and rotated by α_c has Mahalanobis distance

        d²(s, c) = (ρ - c ρ̄)²/(n_v² + (κ ρ̄)² + σ_ρ²) + Σ_i (θ_i - θ̄_i)²/(σ_i² + n_θ²)
                   + |R(-α_c) u - û|²/(ς² + n_v²/ρ² + v_c),

    with the demonstrations' means ρ̄(s), û(s), θ̄(s) (ρ̄ and û after normalisation to
    equal size and heading), their variances σ(s)², ς(s)² and the symbols of
    `PathPhaseConfig`. The phase has the least cost -2 log Σ_c w_c exp(-d²(s, c)/2). The
    weights w_c, angles α_c and variances v_c of the sizes are those of
    `gplfd_policies.demonstrations.path_similarity.PathSimilarity`. The logarithms that
    would make it a likelihood are left out, because they favour early phases, where the
    demonstrations agree, over the hand's progress.

    The standard deviation of the phase follows from the curvature of the cost. If the
    misfit √(E d²/6) at the best phase is above 1, it grows with it (Birge's ratio);
    above `lost_misfit` the phase is searched along the whole task.

    The distribution before adaptation is used, so that the policy's adaptation to the
    robot's own errors does not affect the estimate; it must be finite.
    """

    def __init__(
        self, movement: Movement, config: PathPhaseConfig = PathPhaseConfig()
    ) -> None:
        prediction, aligned = movement.predict(_GRID), movement.aligned
        if not np.isfinite(prediction.mean + prediction.std).all():
            raise ValueError(
                f"PathPhase needs a finite mean and spread, but "
                f"{type(movement).__name__} predicts NaN or infinity; give it "
                "EmpiricalDistribution(aligned=...) instead"
            )
        handle, means = turned_handle(aligned), prediction.mean
        if handle is not None:
            aligned, means = handle.seen(aligned), handle.axis_positions(means)
            split = map(handle.swing_twist, means[:, 3:].tolist())
            leaves, turns = zip(*split, strict=True)
            # That the handle goes back is the policy's own doing.
            most = np.maximum.accumulate(np.maximum(turns, 0.0))
            means[:, 3:] = np.array(leaves) + np.outer(most, handle.axis)
        similar, _ = normalised(aligned)
        # The mean displacement: direction and length [m], and the variances of the
        # direction out of the plane [rad²] and of the distance [m²].
        paths = [interpolated(_GRID, similar.times, p[:, :3]) for p in similar.poses]
        positions = np.stack(paths)
        mean = positions.mean(axis=0)
        length = np.sqrt((mean**2).sum(axis=1))
        least = np.maximum(length, 1e-3)
        direction = mean / least[:, None]
        off_plane = positions[..., 1].var(axis=0) / least**2 + (1e-3 / least) ** 2
        distance = (positions * direction).sum(axis=2).var(axis=0)
        # Long enough for any window; rounding may change its size by a point.
        self._stretch = np.arange(math.ceil(sum(config.window) / _SPACING) + 5)
        # Features first, so that a search reads the same range of each. The grid is
        # padded on both sides, far from any pose, for ranges that extend beyond it.
        features = np.zeros((13, _GRID.size + 2 * self._stretch.size))
        features[4:7] = _FAR
        features[11] = 1.0
        features[:, self._stretch.size : -self._stretch.size] = np.vstack(
            [
                np.sqrt(length**2),
                means[:, 3:].T,
                direction.T,
                length**2,
                1.0 / (prediction.std[:, 3:].T ** 2 + config.rotation_noise**2),
                off_plane,
                distance,
            ]
        )
        self._features, self._rates = features, prediction.mean_rate
        self._numbers: Int[np.ndarray, "*N"] = np.zeros((), dtype=np.int64)
        self._handles: list[TurnedHandle | None] = [handle]
        self._turned = [0.0]
        self.settings = config
        self._similarities = [SimilarityModel.of(aligned, config.similarity).prior()]
        self._posteriors = posteriors(self._similarities)
        self._likely = np.stack([self._posteriors[0].features], axis=1)

    @classmethod
    def stacked(cls, rules: Sequence[PathPhase]) -> PathPhase:
        """Return one rule for the rows of several, in order."""
        together = copy.copy(rules[0])
        together._features = np.hstack([rule._features for rule in rules])
        together._rates = np.vstack([rule._rates for rule in rules])
        together._numbers = np.arange(len(together._rates) // _GRID.size)
        together._turned = [0.0 for rule in rules for _ in rule._handles]
        together._handles = [handle for rule in rules for handle in rule._handles]
        together._similarities = [path for rule in rules for path in rule._similarities]
        together._posteriors = [sizes for rule in rules for sizes in rule._posteriors]
        together._likely = np.hstack([rule._likely for rule in rules])
        together.reset()
        return together

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the paths of these rows and begin at the start of the task."""
        for number in np.ravel(self._numbers[rows]).tolist():
            path = self._similarities[number] = self._similarities[number].model.prior()
            (sizes,) = posteriors([path])
            self._posteriors[number], self._likely[:, number] = sizes, sizes.features
            self._turned[number] = 0.0

    def update(
        self, poses: Axes, previous: PerRow, command: PerRow, rows: Rows = ALL_ROWS
    ) -> PhaseEstimate:
        """Return the phases of observed poses, whatever those of the commands."""
        numbers = np.ravel(self._numbers[rows]).tolist()
        if not numbers:
            return PhaseEstimate(previous, previous, previous)

        # Features (7, *N): ρ, θ, u. For few numbers Python's floats are as fast.
        observed, places = [], {}
        for number, pose in zip(numbers, poses.reshape(-1, 6).tolist(), strict=True):
            x, y, z, *rotation = pose
            handle = self._handles[number]
            if handle is not None:
                x, y, z = handle.axis_displacement(pose)
                leaf, turn = handle.swing_twist(rotation)
                most = self._turned[number] = max(self._turned[number], turn)
                pairs = zip(leaf, handle.axis, strict=True)
                rotation = [part + most * along for part, along in pairs]
            if (distance := math.hypot(x, z)) >= self._similarities[number].due:
                places[number] = distance, math.atan2(-z, x)
            far = math.sqrt(x * x + y * y + z * z) + 1e-9
            observed.append((far, *rotation, x / far, y / far, z / far))
        features = np.array(observed).T.reshape(7, *poses.shape[:-1])
        if places:
            before = [self._similarities[number] for number in places]
            moved = updated(before, list(places.values()))
            together = zip(places, moved, posteriors(moved), strict=True)
            for number, path, sizes in together:
                self._similarities[number], self._posteriors[number] = path, sizes
                self._likely[:, number] = sizes.features
        # The likely sizes (9, *N, K) given the paths so far.
        similar = self._likely[:, numbers].reshape(9, *poses.shape[:-1], -1)

        # Search near the previous phases: grid points first to first + size.
        backward, forward = self.settings.window
        windows = []
        for phase in np.ravel(previous).tolist():
            first = math.floor((phase - backward) / _SPACING) - 1
            windows.append((first, math.ceil((phase + forward) / _SPACING) + 2 - first))
        width, edge = self._features.shape[1] // self._numbers.size, self._stretch.size
        firsts = np.array([first for first, _ in windows], dtype=np.int64)
        column = self._numbers[rows] * width + edge + firsts.reshape(previous.shape)
        near = self._features.take(column[..., None] + self._stretch, axis=1)
        ranges = self._cost(near, features, similar)
        costs = [values.reshape(len(numbers), -1) for values in ranges]

        # Search the whole task if no phase near the last one fits.
        estimates, (*costs, weights) = [], costs
        for index, (number, cost, error, (first, size)) in enumerate(
            zip(numbers, *costs, windows, strict=True)
        ):
            best = self._nearest(cost[:size], error, first)
            if best[2] > self.settings.lost_misfit:
                begin = number * width + edge
                whole = self._features[:, begin - 1 : begin + _GRID.size + 1]
                pose_features = features.reshape(7, -1)[:, index]
                likely = self._likely[:, number]
                everywhere = self._cost(whole, pose_features, likely)
                anywhere = self._nearest(*everywhere[:2], -1)
                if anywhere[2] < self.settings.clearer_share * best[2]:
                    best, weights[index] = anywhere, everywhere[2]
            estimates.append(best)
        weights = weights / np.add.reduce(weights, axis=-1, keepdims=True)
        inferred = size_and_heading(weights.reshape(similar[0].shape), similar)
        phases, stds, misfits = np.array(estimates).T.reshape(3, *previous.shape)
        present = [self._posteriors[number] for number in numbers]
        return PhaseEstimate(phases, stds, misfits, inferred, present, weights)

    def rate(self, phases: PerRow, rows: Rows = ALL_ROWS) -> Axes:
        """Return dμ/ds of these rows' demonstrations at phases, (A, 6)."""
        nearest = np.rint(phases / _SPACING).astype(np.int64)
        return self._rates.take(self._numbers[rows] * _GRID.size + nearest, axis=0)

    def _nearest(
        self, cost: Float[np.ndarray, " W"], error: Float[np.ndarray, " _"], first: int
    ) -> tuple[float, float, float]:
        """Return phase, std and misfit at the vertex of a parabola, or at the edge."""
        largest = self.settings.largest_std
        best = int(cost.argmin())
        point = _POINTS[min(max(first + best, 0), _GRID.size - 1)]
        misfit = math.sqrt(float(error[best]) / _FEATURES)
        if not 0 < best < cost.size - 1:
            return point, largest, misfit
        before, here, after = cost[best - 1 : best + 2].tolist()
        curvature = before - 2.0 * here + after
        if not 0.0 < curvature < _FAR:
            return point, largest, misfit
        std = _SPACING * math.sqrt(2.0 / curvature) * max(misfit, 1.0)
        vertex = point + 0.5 * (before - after) / curvature * _SPACING
        return vertex, min(max(std, self.settings.least_std), largest), misfit

    def _cost(
        self,
        features: Float[np.ndarray, "*F W"],
        observed: Float[np.ndarray, "*E"],
        sizes: Float[np.ndarray, "9 *N C"],
    ) -> tuple[
        Float[np.ndarray, "*N W"], Float[np.ndarray, "*N W"], Float[np.ndarray, "*N C"]
    ]:
        """Return the cost of observed features (7, *N) along ranges of the grid.

        Also the expectation of d² over sizes, and the weights max_s w_c exp(-d²/2) of
        the sizes, up to a factor: the fit of a size at its best phase.
        """
        pose, along = observed[..., None], features[:, ..., None, :]
        log_weight, size, size_variance, cosine, sine, variance = sizes[:6, ..., None]
        turn = (features[1:4] - pose[1:4]) ** 2
        turning = np.add.reduce(turn * features[8:11], axis=0)
        # One term per size c: from ρ - c ρ̄, and from u rotated back by its angle.
        radial = (observed[0][..., None, None] - size * along[0]) ** 2
        share = self.settings.distance_share**2 + size_variance
        radial /= self.settings.position_noise**2 + share * along[7] + along[12]
        x, y, z = (part[..., None, None] for part in observed[4:7])
        sideways = (cosine * x - sine * z - along[4]) ** 2
        sideways += (y - along[5]) ** 2
        sideways += (sine * x + cosine * z - along[6]) ** 2
        blur = (self.settings.position_noise / observed[0][..., None, None]) ** 2
        error = radial + sideways / (along[11] + (blur + variance))
        exponent = log_weight - 0.5 * error
        highest = np.maximum.reduce(exponent, axis=-2)
        likely = np.exp(exponent - highest[..., None, :])
        total = np.add.reduce(likely, axis=-2)
        cost: Float[np.ndarray, "*N W"] = turning - 2.0 * (highest + np.log(total))
        expected = turning + np.add.reduce(likely * error, axis=-2) / total
        share = np.exp(highest - 0.5 * turning - (-0.5 * cost).max(-1, keepdims=True))
        weights = np.maximum.reduce(likely * share[..., None, :], axis=-1)
        return cost, expected, weights
