"""Frames from which a door's opening is seen: at its closed handle, and at its hinge.

They belong to `gplfd_policies.movements.baselines.tp_gmm`. A frame {A, b} sees a pose ξ
as A⁻¹ (ξ − b). The hinge is the centre c of a circle through the hand's path, after
Kåsa: |p|² = 2 pᵀc + k is linear in (c, k), so that a Gaussian over both stays one when
further points of the circle are seen.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve

from gplfd_policies.arrays.records import freeze
from gplfd_policies.movements.trajectory import ViaPoint

PLANE = [0, 2]
"""x and z, the plane in which a door turns."""
_ROUNDNESS = 0.5
"""A path is on a circle if it misses it by less than this share of what it misses the
nearest straight line by, root mean square."""
_STRONGEST = 1e-4
"""Least standard deviation of a point of a circle [m], so that demands of zero, which
contradict each other, have an answer."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Frame:
    """From where a movement is seen: ξ = A X + b."""

    basis: Float[np.ndarray, "6 6"]
    """A."""
    origin: Float[np.ndarray, " 6"]
    """b [m, rad]."""

    def __post_init__(self) -> None:
        freeze(self, "basis", "origin")

    def seen(self, poses: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 6"]:
        """X = A⁻¹ (ξ − b)."""
        return np.linalg.solve(self.basis, (poses - self.origin).T).T

    def pose(self, seen: Float[np.ndarray, "M 6"]) -> Float[np.ndarray, "M 6"]:
        """ξ = A X + b."""
        poses: np.ndarray = seen @ self.basis.T + self.origin
        return poses


HANDLE = Frame(basis=np.eye(6), origin=np.zeros(6))
"""The task frame, at the closed handle."""


def hinge_frame(hinge: Float[np.ndarray, " 2"]) -> Frame:
    """The frame at a hinge (x, z) [m]: its third axis ends at the closed handle."""
    x, z = hinge
    basis, origin = np.eye(6), np.zeros(6)
    basis[np.ix_(PLANE, PLANE)] = [[-z, -x], [x, -z]]
    origin[PLANE] = hinge
    return Frame(basis=basis, origin=origin)


@dataclass(frozen=True, kw_only=True, slots=True)
class Circle:
    """A Gaussian over θ = (c_x, c_z, k) of the circle |p|² = 2 pᵀc + k; read-only."""

    mean: Float[np.ndarray, " 3"]
    """Mean of θ [m, m, m²]."""
    covariance: Float[np.ndarray, "3 3"]
    """Covariance of θ."""

    def __post_init__(self) -> None:
        freeze(self, "mean", "covariance")

    def through(self, via_points: Sequence[ViaPoint]) -> "Circle":
        """The circle given further points of it, with their standard deviations.

        An error e of a point is one of 2 (p − c)ᵀe in its equation: along the path it
        does not count. Via-points that leave x or z free say nothing here.
        """
        poses = np.array([point.pose for point in via_points])[:, PLANE]
        noise = np.array([point.noise_variance for point in via_points])[:, PLANE]
        told = np.isfinite(noise).all(axis=1)
        points, noise = poses[told], np.maximum(noise[told], _STRONGEST**2)
        rows, squares = _equations(points)
        lever = points - self.mean[:2]
        variance = 4.0 * np.sum(lever**2 * noise, axis=1)
        across = self.covariance @ rows.T
        factor = cho_factor(rows @ across + np.diag(variance), lower=True)
        gain = cho_solve(factor, across.T).T
        return Circle(
            mean=self.mean + gain @ (squares - rows @ self.mean),
            covariance=self.covariance - gain @ across.T,
        )


def _equations(
    points: Float[np.ndarray, "N 2"],
) -> tuple[Float[np.ndarray, "N 3"], Float[np.ndarray, " N"]]:
    """Rows (2 x, 2 z, 1) and right sides |p|² of a circle's linear equations."""
    rows = np.column_stack([2.0 * points, np.ones(len(points))])
    return rows, np.sum(points**2, axis=1)


def fit_circle(points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, " 3"] | None:
    """θ of the circle through points [m] after Kåsa; None if they are on none."""
    theta: np.ndarray = np.linalg.lstsq(*_equations(points), rcond=None)[0]
    radius = np.sqrt(max(theta @ (*theta[:2], 1.0), 0.0))
    misses = np.linalg.norm(points - theta[:2], axis=1) - radius
    across_line = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    return theta if np.linalg.norm(misses) < _ROUNDNESS * across_line else None
