"""Which phase does an observed pose belong to?

The policy of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, is a function of time, but a compliant robot lags
behind the clock. Conditioning on "at clock time t the hand is here" makes the policy
believe in its own lag. Progress is therefore told from the path: the phase of an
observation is the one at which the *demonstrations* come nearest to it.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float, Int

from policies.aligned import AlignedDemonstrations
from policies.members import EVERY_MEMBER, Members, Numbers
from policies.movement import Predictor

Poses = Float[np.ndarray, "*N 6"]
Phases = Float[Numbers, "*N"]

_GRID: Final = np.linspace(0.0, 1.0, 201)
_POINTS: Final = _GRID.tolist()
_SPACING: Final = float(_GRID[1])
_LEAST_STD: Final = 0.003
_LARGEST_STD: Final = 0.1
_FAR: Final = 1e100
"""Deviation of the direction, and less than the cost, outside the grid."""


@dataclass(frozen=True, kw_only=True, slots=True)
class PhaseNoise:
    """Errors of an observed pose that no demonstration shows."""

    position: float = 2e-3
    """Compliance and slip of the grasp [m]."""

    rotation: float = 0.15
    """Turning of the hand on the bar [rad]. A friction grasp transmits a few tenths of
    a newton metre: under load the hand turns before the door does, and a phase that
    trusted its rotation would run ahead of a door that has not moved."""


@runtime_checkable
class PhaseRule(Protocol):
    """Tells the phases of the observed poses of N members; keeps no memory."""

    @property
    def settings(self) -> object:
        """What rules of different members must share to be stacked."""

    @classmethod
    def stacked(cls, rules: Sequence[Any]) -> PhaseRule:
        """Return the rule of all members of rules with equal settings."""

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> tuple[Phases, Phases]:
        """Return the phases of observed poses and their standard deviations.

        Args:
            poses: Hand poses of these members, task frame [m, rad].
            previous: Phases of their last observations, 0 at the start of the task.
            command: Phases of their set-points.
            members: Whose they are.
        """

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return dμ/ds of these members' demonstrations at phases, (A, 6)."""


class ClockPhase:
    """The phase of an observation is that of the command: the paper's time.

    Note:
        A hand that lags behind its command teaches the policy its lag; see
        `PathPhase`.
    """

    @property
    def settings(self) -> object:
        """One clock is like the other."""
        return ()

    @classmethod
    def stacked(cls, rules: Sequence[ClockPhase]) -> ClockPhase:
        """Return a clock."""
        return cls()

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> tuple[Phases, Phases]:
        """Return the command phases, as if they were certain."""
        return command, np.zeros_like(command)

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return zero: a certain phase makes no via-point weaker."""
        return np.zeros((*phases.shape, 6))


class PathPhase:
    """The phase at which the demonstrated distribution is nearest to a pose.

    The features are the pose itself and the direction u = v/|v| of the hand's
    displacement from the closed handle. Doors of different radius share that direction
    at equal phase, though neither x nor z: it tells progress independently of the
    radius and of how the hand lies on the bar. Nearest is meant after Mahalanobis,

        d²(s) = Σ_i (y_i - μ_i)²/(σ_i² + n_i²) + |u - û|²/(ς² + n_v²/|v|²),

    with the demonstrations' means μ(s), û(s) and variances σ(s)², ς(s)², and the
    errors n of `PhaseNoise`. The logarithms that would make it a likelihood are left
    out: they favour early phases, where the demonstrations agree, over the hand's
    progress. From the curvature of d² the phase has a standard deviation; the position
    counts twice, as pose and as direction, so it is right to a factor only.

    The distribution is the one before adaptation, so that the estimate cannot follow
    the policy's belief in the robot's own errors. The search stays near the last phase.

    Args:
        demonstrated: Predicts μ and σ: the learned movement, or for a method without
            uncertainty `policies.empirical.EmpiricalDistribution`.
        aligned: The demonstrations, for û and ς.
        noise: Errors of the observed pose beyond the demonstrations' spread.
        window: How far the phase may move per observation: backward, forward.

    Raises:
        ValueError: If the predicted mean or spread is not finite.
    """

    def __init__(
        self,
        demonstrated: Predictor,
        aligned: AlignedDemonstrations,
        *,
        noise: PhaseNoise | None = None,
        window: tuple[float, float] = (0.02, 0.05),
    ) -> None:
        noise = PhaseNoise() if noise is None else noise
        prediction = demonstrated.predict(_GRID)
        if not (
            np.isfinite(prediction.mean).all() and np.isfinite(prediction.std).all()
        ):
            raise ValueError(
                f"PathPhase needs a finite mean and spread, but "
                f"{type(demonstrated).__name__} predicts NaN or infinity; give it "
                "EmpiricalDistribution(aligned) instead"
            )
        floor = np.repeat([noise.position, noise.rotation], 3)
        precision = 1.0 / (prediction.std**2 + floor**2)
        direction, variance = _directions(aligned)
        # Long enough for any window, of which rounding may cut a point more or less.
        self._stretch = np.arange(math.ceil(sum(window) / _SPACING) + 5)
        # Features first, so that a search takes the same stretch of every one; and as
        # much on either side of the grid as a stretch may stick out, far from any pose.
        features = np.zeros((16, _GRID.size + 2 * self._stretch.size))
        features[6:9] = _FAR
        features[15] = 1.0
        features[:, self._stretch.size : -self._stretch.size] = np.vstack(
            [prediction.mean.T, direction.T, precision.T, variance]
        )
        self._features, self._rates = features, prediction.mean_rate
        self._numbers: Int[np.ndarray, "*N"] = np.zeros((), dtype=np.int64)
        self._noise, self._window = noise, window

    @property
    def settings(self) -> object:
        """Noise and window."""
        return self._noise, self._window

    @classmethod
    def stacked(cls, rules: Sequence[PathPhase]) -> PathPhase:
        """Return one rule for the members of several, in order."""
        together = copy.copy(rules[0])
        together._features = np.hstack([rule._features for rule in rules])
        together._rates = np.vstack([rule._rates for rule in rules])
        together._numbers = np.arange(len(together._rates) // _GRID.size)
        return together

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> tuple[Phases, Phases]:
        """Return the phases of observed poses and their standard deviations.

        Args:
            poses: Hand poses of these members, task frame [m, rad].
            previous: Phases of their last observations: where the search begins.
            command: Not used: the path tells, not the clock.
            members: Whose they are.
        """
        # A few numbers per member: Python's floats cost no more than NumPy's calls.
        windows = [self._search(phase) for phase in np.ravel(previous).tolist()]
        first = np.array([window[0] for window in windows], dtype=np.int64)
        first = first.reshape(previous.shape)
        costs = self._cost(poses, first, members).reshape(-1, self._stretch.size)
        found = [
            _nearest(cost[:size], start)
            for cost, (start, size) in zip(costs, windows, strict=True)
        ]
        phases, stds = np.array(found).T.reshape(2, *previous.shape)
        return phases, stds

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return dμ/ds of these members' demonstrations at phases, (A, 6)."""
        nearest = np.rint(phases / _SPACING).astype(np.int64)
        return self._rates.take(self._numbers[members] * _GRID.size + nearest, axis=0)

    def _search(self, previous: float) -> tuple[int, int]:
        """Return where on the grid a search begins, and of how many points it is."""
        backward, forward = self._window
        first = math.floor((previous - backward) / _SPACING) - 1
        return first, math.ceil((previous + forward) / _SPACING) + 2 - first

    def _cost(
        self, poses: Poses, first: Int[Numbers, "*N"], members: Members
    ) -> Float[np.ndarray, "*N W"]:
        """Return d² of every pose along the stretch of the grid that begins there."""
        features, pose = self._features_from(first, members), poses.T
        distance = np.sqrt(np.add.reduce(pose[:3] ** 2, axis=0)) + 1e-9
        observed = np.concatenate([pose, pose[:3] / distance])[..., None]
        squares = (features[:9] - observed) ** 2
        # Not `**`: of floats and of arrays it differs in the last bit.
        blur = np.float_power(self._noise.position / distance, 2.0)[..., None]
        cost: Float[np.ndarray, "*N W"] = np.add.reduce(
            squares[:6] * features[9:15], axis=0
        )
        cost += np.add.reduce(squares[6:], axis=0) / (features[15] + blur)
        return cost

    def _features_from(
        self, first: Int[Numbers, "*N"], members: Members
    ) -> Float[np.ndarray, "*F W"]:
        """Return μ, û, 1/(σ² + n²) and ς² along stretches of the grid, (16, *N, W)."""
        width = self._features.shape[1] // self._numbers.size
        column = self._numbers[members] * width + self._stretch.size + first
        if column.ndim == 0:
            return self._features[:, column : column + self._stretch.size]
        return self._features.take(column[:, None] + self._stretch, axis=1)


def _nearest(cost: Float[np.ndarray, " W"], first: int) -> tuple[float, float]:
    """Return the phase of least cost, between the points of the grid, and its std.

    Args:
        cost: d² at the points of the search, enormous outside the grid.
        first: The first of them.

    Returns:
        The vertex of a parabola through the least cost and its neighbours, and what its
        curvature says; the point itself and the largest standard deviation if a
        neighbour lies outside the search.
    """
    best = int(cost.argmin())
    point = _POINTS[min(max(first + best, 0), _GRID.size - 1)]
    if not 0 < best < cost.size - 1:
        return point, _LARGEST_STD
    before, here, after = cost[best - 1 : best + 2].tolist()
    curvature = before - 2.0 * here + after
    if not 0.0 < curvature < _FAR:
        return point, _LARGEST_STD
    std = _SPACING * math.sqrt(2.0 / curvature)
    vertex = point + 0.5 * (before - after) / curvature * _SPACING
    return vertex, min(max(std, _LEAST_STD), _LARGEST_STD)


def _directions(
    aligned: AlignedDemonstrations,
) -> tuple[Float[np.ndarray, "M 3"], Float[np.ndarray, " M"]]:
    """Mean direction of displacement, and its spread over the demonstrations [rad²]."""
    positions = np.stack(
        [
            np.stack(
                [np.interp(_GRID, aligned.times, curve) for curve in pose.T[:3]],
                axis=1,
            )
            for pose in aligned.poses
        ]
    )
    length = np.linalg.norm(positions, axis=2, keepdims=True)
    # A displacement of a millimetre has no direction yet.
    unit = positions / np.maximum(length, 1e-3)
    mean = unit.mean(axis=0)
    spread = ((unit - mean) ** 2).sum(axis=2).mean(axis=0) / 2.0
    return mean, spread + (1e-3 / np.maximum(length[..., 0].min(axis=0), 1e-3)) ** 2
