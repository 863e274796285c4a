"""Circle fit to a hand's path, which locates the hinge after a few centimetres.

The hand starts at the origin. In axes E = [t, a, n] (columns: pulling direction, hinge
axis, and direction away from the hinge) a point p of its path has coordinates q = Eᵀ p.
It lies on the circle of curvature κ about the hinge -n/κ if

    radial:  r = (|u| - 1)/κ = 0,  u = (κ q_t, κ q_n + 1),
    across:  q_a = 0.

These are geometric distances [m]: the noise of a short arc does not shrink the circle
(as it does in Kåsa's fit), and a straight line is the regular case κ = 0: r = (κ(q_t² +
q_n²) + 2 q_n)/(|u| + 1). With E = E₀ exp(ω), the estimate is the most probable one,

    min over ω, κ:  Σ_i ρ(‖(r_i, q_a,i)‖/σ) + Σ_j (ω_j/σ_j)² + ((κ - κ₀)/σ_κ)²,

with ρ(e) = c² log(1 + e²/c²), by Gauss-Newton with weights 1/(1 + e²/c²). If the fit is
continued with every new point, one step is enough.

N. Chernov, *Circular and Linear Regression*, 2010, ch. 4-6; P. J. Huber, *Robust
Statistics*, 1981.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_env.doors.geometry import DoorGeometry
from gplfd_policies.arrays.shapes import Float

Points = Float[np.ndarray, "N 3"]
Parameters = Float[np.ndarray, " 4"]

_LOWEST: Final = np.array([-0.5, -0.5, -0.5, 0.2])
_HIGHEST: Final = np.array([0.5, 0.5, 0.5, 10.0])
"""Bounds of (ω, κ) [rad, 1/m]: the angles are small, as the prior assumes; a radius of
five metres represents a straight line."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CirclePrior:
    """Prior of the circle before the hand moves: means and standard deviations."""

    axes: Float[np.ndarray, "3 3"]
    """E₀."""
    radius: float = 0.5
    """1/κ₀ [m]."""
    curvature_std: float = 1.0
    """σ_κ [1/m]: radii from a third of a metre to one metre lie within one σ_κ."""
    heading_std: float = 0.05
    """Standard deviation of the heading ω_a [rad]."""
    tilt_std: float = 0.01
    """Standard deviation of the tilt of the hinge axis, ω_t and ω_n [rad]."""
    noise: float = 1e-3
    """σ: standard deviation of a point of the path [m]."""
    far: float = 3.0
    """c: residual, in standard deviations, with half of the weight. Tuned."""

    @property
    def mean(self) -> Parameters:
        """Prior mean of (ω, κ)."""
        return np.array([0.0, 0.0, 0.0, 1.0 / self.radius])

    @property
    def information(self) -> Parameters:
        """Inverse prior variances of (ω, κ)."""
        tilt, heading = self.tilt_std**-2.0, self.heading_std**-2.0
        return np.array([tilt, heading, tilt, self.curvature_std**-2.0])


UPRIGHT: Final = CirclePrior(axes=np.eye(3))
"""Prior for an upright door in front of the robot, in the task frame."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Circle:
    """An estimate of the circle."""

    prior: CirclePrior
    """The prior of this estimate."""
    parameters: Parameters
    """(ω, κ) [rad, 1/m]."""

    @classmethod
    def expected(cls, prior: CirclePrior) -> Circle:
        """Return the estimate before the hand moves."""
        return cls(prior=prior, parameters=prior.mean)

    @property
    def axes(self) -> Float[np.ndarray, "3 3"]:
        """E."""
        return np.asarray(self.prior.axes @ _rotation(*self.parameters[:3].tolist()))

    @property
    def curvature(self) -> float:
        """κ [1/m]."""
        return float(self.parameters[3])

    def door(self) -> DoorGeometry:
        """Return the door whose handle moves on this circle."""
        axes = self.axes
        return DoorGeometry(hinge=-axes[:, 2] / self.curvature, axis=axes[:, 1])

    def updated(self, points: Points, steps: int = 1) -> Circle:
        """Return the estimate after some Gauss-Newton steps from this one."""
        prior, information, circle = self.prior, self.prior.information, self
        for _ in range(steps):
            local = (points @ circle.axes).T
            distances, slopes = _distances(local, circle.curvature)
            squares = np.add.reduce(distances**2, axis=0) / prior.noise**2
            weights = 1.0 / (prior.noise**2 * (1.0 + squares / prior.far**2))
            weighted, flat = (weights * slopes).reshape(4, -1), slopes.reshape(4, -1)
            gradient = information * (circle.parameters - prior.mean)
            gradient += weighted @ distances.ravel()
            step = np.linalg.solve(np.diag(information) + weighted @ flat.T, gradient)
            # Rotations are small: the rotation of a step may be added.
            parameters = circle.parameters - step
            bounded = np.minimum(np.maximum(parameters, _LOWEST), _HIGHEST)
            circle = Circle(prior=prior, parameters=bounded)
        return circle


def fit_circle(points: Points, prior: CirclePrior = UPRIGHT) -> Circle:
    """Return the most probable circle through the origin and along points."""
    if not np.isfinite(points).all():
        raise ValueError("points of a path must be finite; leave out missing points")
    return Circle.expected(prior).updated(points, steps=15)


def _distances(
    points: Float[np.ndarray, "3 N"], kappa: float
) -> tuple[Float[np.ndarray, "2 N"], Float[np.ndarray, "4 2 N"]]:
    """Return r and q_a of points (q_t, q_a, q_n), and their derivatives.

    The derivatives are by a small rotation δ, E exp(δ), which moves q by -δ × q, and by
    κ.
    """
    t, a, n = points
    square, across = t * t + n * n, kappa * n + 1.0
    # At the hinge itself, the direction away from it is not defined.
    length = np.maximum(np.hypot(kappa * t, across), 1e-9)
    radial = (kappa * square + 2.0 * n) / (length + 1.0)
    by_t, by_n = kappa * t / length, across / length
    by_length = (kappa * t * t + n * across) / length
    slopes = np.zeros((4, 2, t.size))
    slopes[0] = -by_n * a, n
    slopes[1, 0] = by_n * t - by_t * n
    slopes[2] = by_t * a, -t
    slopes[3, 0] = (square - radial * by_length) / (length + 1.0)
    return np.stack([radial, a]), slopes


def _rotation(x: float, y: float, z: float) -> Float[np.ndarray, "3 3"]:
    """Return exp of a rotation vector; SciPy's takes as long as the rest of a step."""
    angle = max(math.sqrt(x * x + y * y + z * z), 1e-12)
    cross = np.array([[0.0, -z, y], [z, 0.0, -x], [-y, x, 0.0]])
    bend = (math.sin(angle / 2.0) / (angle / 2.0)) ** 2 / 2.0
    rotation = np.eye(3) + math.sin(angle) / angle * cross + bend * (cross @ cross)
    return np.asarray(rotation)
