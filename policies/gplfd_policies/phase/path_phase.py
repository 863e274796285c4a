"""The phase of an observed pose, told by the path.

The agent of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, dates its observations by the clock; here the phase of
an observation is the one at which the *demonstrations* come nearest to it, seen from
the heading that the path so far tells.
"""

from __future__ import annotations

import copy
import math
from collections.abc import Sequence
from typing import Final

import numpy as np
from jaxtyping import Float, Int

from gplfd_policies.arrays.members import EVERY_MEMBER, Members, Numbers
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.turned_handle import (
    TurnedHandle,
    seen_at,
    turned_handle,
)
from gplfd_policies.movements.movement import Predictor
from gplfd_policies.phase.heading import Heading, directions
from gplfd_policies.phase.phase_rule import PhaseEstimate, PhaseNoise, Phases, Poses

Observed = Float[np.ndarray, "*E"]
"""ρ, θ, u and the variance of u, of N poses: (8, *N)."""

_GRID: Final = np.linspace(0.0, 1.0, 201)
_POINTS: Final = _GRID.tolist()
_SPACING: Final = float(_GRID[1])
_LEAST_STD: Final = 0.003
_LARGEST_STD: Final = 0.1
_FAR: Final = 1e100
"""Deviation of the direction, and less than the cost, outside the grid."""

_FEATURES: Final = 6
"""Numbers that a pose has."""

_LOST: Final = 3.0
"""Misfit from which the phase is looked for everywhere."""

_CLEARER: Final = 0.5
"""Share of the misfit at most that a phase elsewhere must leave to be believed."""


class PathPhase:
    """The phase at which the demonstrated distribution is nearest to a pose.

    The features of a pose are the distance ρ = |v| of the hand from the closed handle,
    the direction u = v/|v| of that displacement, and the hand's rotation θ. Where a
    handle is turned first, v is the displacement of the handle's axis and θ the leaf's
    turn with the handle's greatest so far
    (`gplfd_policies.demonstrations.turned_handle`): the hand's way about the axis is no
    door's, and the way back the policy's own. Doors of different radius share u at
    equal phase, though not ρ: it tells progress independently of the radius and of how
    the hand lies on the bar. A robot that stands askew by ψ sees u turned by ψ about
    the vertical, which `Heading` estimates from the path so far, as ψ̂ with the
    variance ω². Nearest is meant after Mahalanobis,

        d²(s) = (ρ - ρ̄)²/(σ_ρ² + n_v²) + |R(-ψ̂) u - û|²/(ς² + n_v²/ρ² + ω²)
                + Σ_i (θ_i - θ̄_i)²/(σ_i² + n_θ²),

    with the demonstrations' means ρ̄(s), û(s), θ̄(s) and variances σ(s)², ς(s)², and the
    errors n of `PhaseNoise`. (ρ, u) is the position in other coordinates, so that
    nothing counts twice. The logarithms that would make it a likelihood are left out:
    they favour early phases, where the demonstrations agree, over the hand's progress.

    From the curvature of d² the phase has a standard deviation. The misfit √(d²/6) at
    the best phase is about 1 or less where errors are as expected. Where it is more,
    the standard deviation grows with it (Birge's ratio); from 3 on, the phase is looked
    for along the whole task and not only near the last one.

    The distribution is the one before adaptation, so that the estimate cannot follow
    the policy's belief in the robot's own errors. The search stays near the last phase.

    Args:
        demonstrated: Predicts μ and σ: the learned movement, or for a method without
            uncertainty `gplfd_policies.movements.movement.EmpiricalDistribution`.
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
        handle, means = turned_handle(aligned), prediction.mean
        if handle is not None:
            aligned, means = seen_at(aligned, handle), handle.places(means)
            means[:, 3:] = _most_turned(handle, means[:, 3:])
        direction, variance = directions(aligned, _GRID)
        distance = np.sqrt((means[:, :3] ** 2).sum(axis=1))
        # As of doors of different size, whose positions differ along û alone.
        radial = (np.abs(direction) * prediction.std[:, :3]).sum(axis=1)
        # Long enough for any window, of which rounding may cut a point more or less.
        self._stretch = np.arange(math.ceil(sum(window) / _SPACING) + 5)
        # Features first, so that a search takes the same stretch of every one; and as
        # much on either side of the grid as a stretch may stick out, far from any pose.
        features = np.zeros((12, _GRID.size + 2 * self._stretch.size))
        features[4:7] = _FAR
        features[11] = 1.0
        features[:, self._stretch.size : -self._stretch.size] = np.vstack(
            [
                distance,
                means[:, 3:].T,
                direction.T,
                1.0 / (radial**2 + noise.position**2),
                1.0 / (prediction.std[:, 3:].T ** 2 + noise.rotation**2),
                variance,
            ]
        )
        self._features, self._rates = features, prediction.mean_rate
        self._numbers: Int[np.ndarray, "*N"] = np.zeros((), dtype=np.int64)
        self._handles: list[TurnedHandle | None] = [handle]
        self._turned = [0.0]
        self.noise, self._window = noise, window
        self._headings = [
            Heading(
                aligned, _GRID, prior_std=noise.heading, position_std=noise.position
            )
        ]

    @property
    def settings(self) -> object:
        """Noise and window."""
        return self.noise, self._window

    @classmethod
    def stacked(cls, rules: Sequence[PathPhase]) -> PathPhase:
        """Return one rule for the members of several, in order."""
        together = copy.copy(rules[0])
        together._features = np.hstack([rule._features for rule in rules])
        together._rates = np.vstack([rule._rates for rule in rules])
        together._numbers = np.arange(len(together._rates) // _GRID.size)
        together._turned = [0.0 for rule in rules for _ in rule._handles]
        together._handles = [handle for rule in rules for handle in rule._handles]
        together._headings = [
            heading.afresh() for rule in rules for heading in rule._headings
        ]
        return together

    def reset(self, members: Members = EVERY_MEMBER) -> None:
        """Let these members forget their paths and begin at the start of the task."""
        for number in np.ravel(self._numbers[members]).tolist():
            self._headings[number].reset()
            self._turned[number] = 0.0

    def update(
        self,
        poses: Poses,
        previous: Phases,
        command: Phases,
        members: Members = EVERY_MEMBER,
    ) -> PhaseEstimate:
        """Return the phases of observed poses, and how sure they are.

        Args:
            poses: Hand poses of these members, task frame [m, rad].
            previous: Phases of their last observations: where the search begins.
            command: Not used: the path tells, not the clock.
            members: Whose they are.
        """
        observed = self._observed(poses, members)
        # A few numbers per member: Python's floats cost no more than NumPy's calls.
        windows = [self._search(phase) for phase in np.ravel(previous).tolist()]
        first = np.array([window[0] for window in windows], dtype=np.int64)
        first = first.reshape(previous.shape)
        features = self._features_from(first, members)
        costs = _cost(features, observed).reshape(-1, self._stretch.size)
        found = [
            _nearest(cost[:size], start)
            for cost, (start, size) in zip(costs, windows, strict=True)
        ]
        found = self._freed(found, observed, members)
        phases, stds, misfits = np.array(found).T.reshape(3, *previous.shape)
        return PhaseEstimate(phases, stds, misfits)

    def rate(self, phases: Phases, members: Members = EVERY_MEMBER) -> Poses:
        """Return dμ/ds of these members' demonstrations at phases, (A, 6)."""
        nearest = np.rint(phases / _SPACING).astype(np.int64)
        return self._rates.take(self._numbers[members] * _GRID.size + nearest, axis=0)

    def _observed(self, poses: Poses, members: Members) -> Observed:
        """Return ρ, θ and R(-ψ̂) u of poses, and the variance n_v²/ρ² + ω² of u."""
        numbers = np.ravel(self._numbers[members]).tolist()
        rows = []
        for number, pose in zip(numbers, poses.reshape(-1, 6).tolist(), strict=True):
            x, y, z, *rotation = pose
            handle, heading = self._handles[number], self._headings[number]
            if handle is not None:
                x, y, z = handle.place(pose)
                leaf, turn = handle.turns(rotation)
                most = self._turned[number] = max(self._turned[number], turn)
                rotation = [
                    part + most * along
                    for part, along in zip(leaf, handle.axis, strict=True)
                ]
            heading.see(math.hypot(x, z), math.atan2(-z, x))
            far = math.sqrt(x * x + y * y + z * z) + 1e-9
            cosine, sine = math.cos(heading.yaw), math.sin(heading.yaw)
            level = (cosine * x - sine * z) / far, (sine * x + cosine * z) / far
            blur = (self.noise.position / far) ** 2 + heading.variance
            rows.append((far, *rotation, level[0], y / far, level[1], blur))
        return np.array(rows).T.reshape(8, *poses.shape[:-1])

    def _search(self, previous: float) -> tuple[int, int]:
        """Return where on the grid a search begins, and of how many points it is."""
        backward, forward = self._window
        first = math.floor((previous - backward) / _SPACING) - 1
        return first, math.ceil((previous + forward) / _SPACING) + 2 - first

    def _features_from(
        self, first: Int[Numbers, "*N"], members: Members
    ) -> Float[np.ndarray, "*F W"]:
        """Return ρ̄, θ̄, û, their precisions and ς² along stretches of the grid."""
        width = self._features.shape[1] // self._numbers.size
        column = self._numbers[members] * width + self._stretch.size + first
        if column.ndim == 0:
            return self._features[:, column : column + self._stretch.size]
        return self._features.take(column[:, None] + self._stretch, axis=1)

    def _freed(
        self,
        found: list[tuple[float, float, float]],
        observed: Observed,
        members: Members,
    ) -> list[tuple[float, float, float]]:
        """Return phases that were looked for everywhere where the near one is wrong."""
        width, edge = self._features.shape[1] // self._numbers.size, self._stretch.size
        numbers = np.ravel(self._numbers[members]).tolist()
        for row, (number, near) in enumerate(zip(numbers, found, strict=True)):
            if near[2] <= _LOST:
                continue
            begin = number * width + edge
            whole = self._features[:, begin - 1 : begin + _GRID.size + 1]
            seen = observed.reshape(8, -1)[:, row]
            anywhere = _nearest(_cost(whole, seen), -1)
            if anywhere[2] < _CLEARER * near[2]:
                found[row] = anywhere
        return found


def _most_turned(
    handle: TurnedHandle, rotations: Float[np.ndarray, "G 3"]
) -> Float[np.ndarray, "G 3"]:
    """Return a leaf's turns with what the handle has been turned by at most.

    That it goes back is the policy's own doing, and says nothing of the door.
    """
    parts = [handle.turns(rotation) for rotation in rotations.tolist()]
    leaves, turns = zip(*parts, strict=True)
    most = np.maximum.accumulate(np.maximum(turns, 0.0))
    return np.asarray(np.array(leaves) + np.outer(most, handle.axis))


def _cost(
    features: Float[np.ndarray, "*F W"], observed: Observed
) -> Float[np.ndarray, "*N W"]:
    """Return d² of poses along stretches of the grid."""
    each = observed[..., None]
    squares = (features[:7] - each[:7]) ** 2
    cost: Float[np.ndarray, "*N W"] = np.add.reduce(
        squares[:4] * features[7:11], axis=0
    )
    cost += np.add.reduce(squares[4:], axis=0) / (features[11] + each[7])
    return cost


def _nearest(cost: Float[np.ndarray, " W"], first: int) -> tuple[float, float, float]:
    """Return the phase of least cost, between the points of the grid, std and misfit.

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
    misfit = math.sqrt(float(cost[best]) / _FEATURES)
    if not 0 < best < cost.size - 1:
        return point, _LARGEST_STD, misfit
    before, here, after = cost[best - 1 : best + 2].tolist()
    curvature = before - 2.0 * here + after
    if not 0.0 < curvature < _FAR:
        return point, _LARGEST_STD, misfit
    std = _SPACING * math.sqrt(2.0 / curvature) * max(misfit, 1.0)
    vertex = point + 0.5 * (before - after) / curvature * _SPACING
    return vertex, min(max(std, _LEAST_STD), _LARGEST_STD), misfit
