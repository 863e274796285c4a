"""Heading error: the angle between the demonstrated and the actual door.

A robot that stands askew sees the whole motion turned about the vertical by one unknown
angle ψ, its heading error. A phase estimate from the direction of the hand's
displacement would take ψ for progress: on a door, whose chord turns half as fast as its
leaf, for 2ψ of it. The path so far distinguishes the two: a heading error turns all of
it, progress bends it.
"""

from __future__ import annotations

import copy
import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

_SIZES: Final = np.linspace(-2.5, 2.5, 41)
"""Sizes that are compared, in standard deviations of the logarithm of size."""

_NEAREST: Final = 1e-9
"""A distance [m] that divides."""


@dataclass(frozen=True, kw_only=True, slots=True)
class HeadingConfig:
    """How the heading error is estimated."""

    size_std: float = quantity(0.25, low=0.0)
    """Standard deviation of the logarithm of size in addition to the demonstrations'
    own. Tuned."""
    spacing: float = quantity(1.0 / 16.0, above=0.0)
    """Distance between two directions that are used, over the demonstrated distance.
    Nearer ones share the errors of the hand's place on the bar, and count as one."""
    least_std: float = quantity(math.radians(0.5), low=0.0, unit="rad")
    """What the demonstrations' own heading is known to at best [rad]. Tuned."""

    def __post_init__(self) -> None:
        check_quantities(self)


class Heading:
    """Estimates heading errors from paths, compared up to a similarity of the plane.

    A path is the demonstrated one turned by ψ and enlarged by c, both unknown. At the
    distance d from its start it lies in the direction

        α(d) = a(d/c) + ψ + e,    e ~ N(0, 2 n²/d² + ς²),

    where a is the demonstrated direction by distance, n the error of either end of the
    chord and ς the spread of directions. A priori ψ ~ N(0, τ²) and log c ~ N(0, γ²).
    Given c the model is linear and ψ has the closed form

        ψ | c ~ N(τ² S₁/(1 + τ² S₀), τ²/(1 + τ² S₀)),
        -2 log p(α | c) = S₂ - τ² S₁²/(1 + τ² S₀) + const,
        S_k = Σ (α - a(d/c))^k / var e,

    so that sums at a few values of c are all that is kept of a path; over these the
    posterior is a mixture, of which mean and variance are used.

    Args:
        aligned: The demonstrations, for a, ς and γ.
        phases: Where they are compared, from 0 to 1, (G,).
        prior_std: τ, what the heading errs by before the path is seen [rad]; 0 for a
            heading that is trusted.
        position_std: n, error of a position [m].
        config: How the heading error is estimated.
    """

    def __init__(
        self,
        aligned: AlignedDemonstrations,
        phases: Float[np.ndarray, " G"],
        *,
        prior_std: float,
        position_std: float,
        config: HeadingConfig = HeadingConfig(),
    ) -> None:
        level = np.hypot(*_positions(aligned, phases)[..., [0, 2]].T).T
        direction, variances = directions(aligned, phases)
        # Where a path comes back nearer to its start, the way out counts.
        distances = np.maximum.accumulate(level.mean(axis=0))
        self._distances, first = np.unique(distances, return_index=True)
        angles = np.arctan2(-direction[first, 2], direction[first, 0])
        self._angles, self._variances = np.unwrap(angles), variances[first]
        sizes = np.log(np.maximum(level.max(axis=1), _NEAREST))
        spread = math.hypot(np.std(sizes, ddof=min(1, sizes.size - 1)), config.size_std)
        self._shrinking = np.exp(-spread * _SIZES)
        self._prior, self._position_variance = prior_std**2, position_std**2
        self._least = min(config.least_std, prior_std) ** 2
        self._spacing = max(float(self._distances[-1]) * config.spacing, _NEAREST)
        self.reset()

    def reset(self) -> None:
        """Forget the path."""
        self.yaw = 0.0
        """Mean of ψ [rad]."""
        self.variance = self._prior
        """Its variance [rad²]."""
        self._due = self._spacing
        self._weight = 0.0
        self._sums: Float[np.ndarray, "2 C"] = np.zeros((2, _SIZES.size))

    def afresh(self) -> Heading:
        """Return an estimator of the same demonstrations with a path of its own."""
        another = copy.copy(self)
        another.reset()
        return another

    def update(self, distance: float, angle: float) -> None:
        """Update the estimate if the hand has come far enough since the last time.

        Args:
            distance: From the start of the path, in the horizontal plane [m].
            angle: Its direction about the vertical there [rad].
        """
        if distance < self._due:
            return
        self._due = distance + self._spacing
        spread = float(np.interp(distance, self._distances, self._variances))
        weight = 1.0 / (2.0 * self._position_variance / distance**2 + spread)
        expected = np.interp(distance * self._shrinking, self._distances, self._angles)
        error = np.remainder(angle - expected + math.pi, 2.0 * math.pi) - math.pi
        self._weight += weight
        self._sums[0] += weight * error
        self._sums[1] += weight * error**2
        # Mean and variance of the mixture over sizes, from the sums so far.
        gain = self._prior / (1.0 + self._prior * self._weight)
        yaws = gain * self._sums[0]
        surprise = self._sums[1] - gain * self._sums[0] ** 2 + _SIZES**2
        likely = np.exp(-0.5 * (surprise - surprise.min()))
        likely /= likely.sum()
        self.yaw = float((likely * yaws).sum())
        between = float((likely * (yaws - self.yaw) ** 2).sum())
        self.variance = min(gain + between + self._least, self._prior)


def directions(
    aligned: AlignedDemonstrations, phases: Float[np.ndarray, " G"]
) -> tuple[Float[np.ndarray, "G 3"], Float[np.ndarray, " G"]]:
    """Return the demonstrations' mean direction of displacement, and its spread.

    Args:
        aligned: The demonstrations.
        phases: Where along the task.

    Returns:
        Means of unit vectors from the start, shorter than one where they differ, and
        the variance of directions about them [rad²].
    """
    positions = _positions(aligned, phases)
    length = np.linalg.norm(positions, axis=2, keepdims=True)
    # A displacement of a millimetre has no direction yet.
    unit = positions / np.maximum(length, 1e-3)
    mean = unit.mean(axis=0)
    spread = ((unit - mean) ** 2).sum(axis=2).mean(axis=0) / 2.0
    return mean, spread + (1e-3 / np.maximum(length[..., 0].min(axis=0), 1e-3)) ** 2


def _positions(
    aligned: AlignedDemonstrations, phases: Float[np.ndarray, " G"]
) -> Float[np.ndarray, "K G 3"]:
    """Return the demonstrated positions at phases."""
    return np.stack(
        [
            np.stack(
                [np.interp(phases, aligned.times, curve) for curve in pose.T[:3]],
                axis=1,
            )
            for pose in aligned.poses
        ]
    )
