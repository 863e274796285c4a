"""The circle that a hand's path lies on: where the hinge is, from a few centimetres on.

The hand starts at the origin. In axes E = [t, a, n] (columns: the direction in which
the door is pulled, the hinge axis, and away from the hinge) a point p of its path has
coordinates q = Eᵀ p, and lies on the circle of curvature κ about the hinge -n/κ if

    radial:  r = (|u| - 1)/κ = 0,  u = (κ q_t, κ q_n + 1),
    across:  q_a = 0.

These are geometric distances [m], not algebraic ones, so that the noise of a short arc
does not shrink the circle (as it does in Kåsa's fit), and a straight line is the
ordinary case κ = 0: r = (κ(q_t² + q_n²) + 2 q_n)/(|u| + 1). With E = E₀ exp(ω), the
estimate is the most probable one,

    min over ω, κ:  Σ_i ρ(‖(r_i, q_a,i)‖/σ) + Σ_j (ω_j/σ_j)² + ((κ - κ₀)/σ_κ)²,

with ρ(e) = c² log(1 + e²/c²), the logarithm of heavy tails, which takes from a wrong
point what it could do the farther it is. Gauss-Newton with weights 1/(1 + e²/c²)
converges in a few steps from anywhere near, and a fit that is continued with every new
point needs one. The prior is what an engineer knows before
touching the door: it faces the robot within a few degrees, hinges stand upright, and
a radius is half a metre, give or take. A path too short to tell leaves it so.

Sources: N. Chernov, *Circular and Linear Regression*, 2010, ch. 4-6 (geometric fit,
bias of algebraic ones, curvature as parameter); P. J. Huber, *Robust Statistics*, 1981
(M-estimates by weights).
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float

from gplfd_env.geometry import DoorGeometry
from gplfd_env.se3 import compose_rotvecs

Points = Float[np.ndarray, "N 3"]

_FAR: Final = 3.0
"""c: of residuals of so many standard deviations half the weight is left."""
_CURVATURES: Final = (0.2, 10.0)
"""Bounds of the curvature [1/m]: a straight line is a door of five metres."""
_LARGEST_TURN: Final = 0.5
"""Bound of every component of ω [rad]: the small angles that the prior speaks of."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CirclePrior:
    """What is known of the circle before the hand moves: means and deviations."""

    axes: Float[np.ndarray, "3 3"]
    """E₀: columns pull, hinge axis, away from the hinge."""
    radius: float = 0.5
    """1/κ₀ [m]."""
    curvature_std: float = 1.0
    """σ_κ [1/m]: within one of it lie radii from a third of a metre to one."""
    heading_std: float = 0.05
    """Deviation of the heading ω_a [rad]."""
    tilt_std: float = 0.01
    """Deviation of the hinge axis from upright, ω_t and ω_n [rad]."""
    noise: float = 1e-3
    """σ: of a point of the path [m]."""


UPRIGHT: Final = CirclePrior(axes=np.eye(3))
"""A door as a robot that stands before it finds it, in the task frame."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Circle:
    """An estimate: E = E₀ exp(turn) and κ."""

    prior: CirclePrior
    """What it was estimated with."""
    turn: Float[np.ndarray, " 3"]
    """ω [rad]."""
    curvature: float
    """κ [1/m]."""

    @classmethod
    def expected(cls, prior: CirclePrior) -> Circle:
        """Return what is expected before the hand moves."""
        return cls(prior=prior, turn=np.zeros(3), curvature=1.0 / prior.radius)

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """E."""
        return np.asarray(self.prior.axes @ _rotation(self.turn))

    def door(self) -> DoorGeometry:
        """Return the door whose handle moves on this circle."""
        axes = self.axes
        return DoorGeometry(hinge=-axes[:, 2] / self.curvature, axis=axes[:, 1])

    def updated(self, points: Points, steps: int = 1) -> Circle:
        """Return the estimate after some Gauss-Newton steps from this one.

        Args:
            points: All that was seen of the path, finite [m].
            steps: How many; one if this estimate is one point old.
        """
        circle = self
        for _ in range(steps):
            circle = circle._step(points)
        return circle

    def _step(self, points: Points) -> Circle:
        prior, kappa = self.prior, self.curvature
        t, a, n = (points @ self.axes).T
        residuals, jacobians = _residuals(t, a, n, kappa)
        scaled = np.hypot(*residuals) / prior.noise
        weights = 1.0 / (prior.noise**2 * (1.0 + (scaled / _FAR) ** 2))
        deviation = np.append(self.turn, kappa - 1.0 / prior.radius)
        information = (
            np.array(
                [prior.tilt_std, prior.heading_std, prior.tilt_std, prior.curvature_std]
            )
            ** -2.0
        )
        normal = np.diag(information)
        gradient = information * deviation
        for residual, jacobian in zip(residuals, jacobians, strict=True):
            weighted = weights * jacobian
            normal += weighted @ jacobian.T
            gradient += weighted @ residual
        step = np.linalg.solve(normal, gradient)
        turn = compose_rotvecs(self.turn, -step[:3])
        return Circle(
            prior=prior,
            turn=np.clip(turn, -_LARGEST_TURN, _LARGEST_TURN),
            curvature=float(np.clip(kappa - step[3], *_CURVATURES)),
        )


def fit_circle(points: Points, prior: CirclePrior = UPRIGHT) -> Circle:
    """Return the most probable circle through the origin and along points.

    Args:
        points: Of the hand's path, which starts at the origin [m].
        prior: What is known beforehand.

    Raises:
        ValueError: A point is not finite.
    """
    if not np.isfinite(points).all():
        raise ValueError("points of a path must be finite; leave out what was not seen")
    return Circle.expected(prior).updated(points, steps=15)


def _residuals(
    t: np.ndarray, a: np.ndarray, n: np.ndarray, kappa: float
) -> tuple[tuple[np.ndarray, np.ndarray], tuple[np.ndarray, np.ndarray]]:
    """Return both distances of every point, (N,), and their derivatives, (4, N).

    Derivatives by δ, of E exp(δ), and by κ: a small turn moves q by -δ × q.
    """
    square, across = t * t + n * n, kappa * n + 1.0
    # At the hinge itself there is no direction away from it.
    length = np.maximum(np.hypot(kappa * t, across), 1e-9)
    radial = (kappa * square + 2.0 * n) / (length + 1.0)
    by_t, by_n = kappa * t / length, across / length
    by_length = (kappa * t * t + n * across) / length
    zero = np.zeros_like(t)
    return (radial, a), (
        np.stack(
            [
                -by_n * a,
                by_n * t - by_t * n,
                by_t * a,
                (square - radial * by_length) / (length + 1.0),
            ]
        ),
        np.stack([n, zero, -t, zero]),
    )


def _rotation(turn: Float[np.ndarray, " 3"]) -> Float[np.ndarray, "3 3"]:
    """Return exp(turn) by Rodrigues' formula."""
    x, y, z = turn
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    angle = float(np.sqrt(x * x + y * y + z * z))
    first, second = np.sinc(angle / np.pi), 0.5 * np.sinc(0.5 * angle / np.pi) ** 2
    return np.asarray(np.eye(3) + first * cross + second * (cross @ cross))
