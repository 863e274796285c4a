"""Task-parameterised Gaussian mixture: frames at the closed handle and at the hinge.

Calinon, *A tutorial on task-parameterized movement learning and retrieval*, Intelligent
Service Robotics 9, 2016. A demonstration ξ is expressed in P frames {A_j, b_j}, as
A_j⁻¹ (ξ − b_j), and one mixture of all these views is learned, with common weights π_i.
In a new situation the Gaussians of all frames are transformed to it and multiplied,

    Σ_i⁻¹ = Σ_j Σ̂_ij⁻¹,   μ_i = Σ_i Σ_j Σ̂_ij⁻¹ μ̂_ij,                            Eq. (6)

with μ̂_ij = A_j μ_ij + b_j and Σ̂_ij = A_j Σ_ij A_jᵀ, and the mixture is regressed.
Frames that agree count as independent: two equal ones halve the variance.

Choices that the tutorial leaves to the user:

* One frame is the task frame. The other has its origin at the hinge c. Its third axis
  is the vector from there to the closed handle, including its length; the first axis
  has the same length. In this frame every door has unit radius.
* The hinge of a demonstration is the centre of a circle through the hand's path (Kåsa's
  fit: |p|² = 2 pᵀc + k is linear in c and k). Without a circle there is one frame.
* The phase is shared: as an output of each frame it would be counted twice.
* In a new situation (c, k) is Gaussian as demonstrated, and via-points are further
  points of the circle. An uncertain c adds G C Gᵀ to a Gaussian of this frame, to first
  order. Via-points are not necessarily reached, and have no effect on rotations.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Float, Outputs, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.baselines.gmr import (
    TOLERANCE,
    GaussianMixtureRegression,
    GMRConfig,
    Standardisation,
    warn_of_early_stop,
)
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    LearnedMovement,
    ViaPoint,
)

PLANE = [0, 2]  # x and z, the plane in which a door turns.
_ROUNDNESS = 0.5
"""Greatest RMS distance of a path from its circle, relative to the nearest line."""
_STRONGEST = 1e-4  # least standard deviation of a point of a circle [m]
_GMR = GMRConfig()
Mixture = tuple[
    Float[np.ndarray, " C"], Float[np.ndarray, "P C 7"], Float[np.ndarray, "P C 7 7"]
]
"""π_i, and μ_ij and Σ_ij in P frames."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Frame:
    """A frame {A, b} in which a movement is expressed: ξ = A X + b [m, rad]."""

    basis: Float[np.ndarray, "6 6"]
    origin: Pose

    def seen(self, poses: Outputs) -> Outputs:
        """X = A⁻¹ (ξ − b)."""
        return np.linalg.solve(self.basis, (poses - self.origin).T).T

    def pose(self, seen: Outputs) -> Outputs:
        """ξ = A X + b."""
        return np.asarray(seen @ self.basis.T + self.origin)


def hinge_frame(hinge: Float[np.ndarray, " 2"]) -> Frame:
    """The frame at a hinge (x, z) [m]: its third axis ends at the closed handle."""
    x, z = hinge
    basis, origin = np.eye(6), np.zeros(6)
    basis[np.ix_(PLANE, PLANE)] = [[-z, -x], [x, -z]]
    origin[PLANE] = hinge
    return Frame(basis=basis, origin=origin)


@dataclass(frozen=True, kw_only=True, slots=True)
class CircleDistribution:
    """A Gaussian over θ = (c_x, c_z, k) [m, m, m²] of the circle |p|² = 2 pᵀc + k."""

    mean: Float[np.ndarray, " 3"]
    covariance: Float[np.ndarray, "3 3"]

    def through(
        self, via_point: ViaPoint, centre: Float[np.ndarray, " 2"]
    ) -> "CircleDistribution":
        """Return the circle conditioned on a further point with known x and z.

        An error e of a point p is an error 2 (p − c)ᵀe of its equation, which is zero
        for e along the path; c is the centre that was expected at first [m].
        """
        point, noise = via_point.pose[PLANE], via_point.noise_variance[PLANE]
        if not np.isfinite(noise).all():
            return self
        rows, squares = _equations(point[None])
        variance = np.maximum(noise, _STRONGEST**2) @ (2.0 * (point - centre)) ** 2
        across = self.covariance @ rows[0]
        gain = across / (rows[0] @ across + variance)
        return CircleDistribution(
            mean=self.mean + gain * (squares[0] - rows[0] @ self.mean),
            covariance=self.covariance - np.outer(gain, across),
        )


def _equations(
    points: Float[np.ndarray, "N 2"],
) -> tuple[Float[np.ndarray, "N 3"], Float[np.ndarray, " N"]]:
    """Rows (2 x, 2 z, 1) and right sides |p|² of a circle's linear equations."""
    rows = np.column_stack([2.0 * points, np.ones(len(points))])
    return rows, np.sum(points**2, axis=1)


def fit_kasa_circle(points: Float[np.ndarray, "N 2"]) -> Float[np.ndarray, " 3"] | None:
    """Return θ of Kåsa's circle through points [m]; None if there is no circle."""
    theta: np.ndarray = np.linalg.lstsq(*_equations(points), rcond=None)[0]
    radius = np.sqrt(max(theta @ (*theta[:2], 1.0), 0.0))
    misses = np.linalg.norm(points - theta[:2], axis=1) - radius
    across_line = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)[-1]
    return theta if np.linalg.norm(misses) < _ROUNDNESS * across_line else None


@dataclass(frozen=True, kw_only=True, repr=False)
class TaskParameterisedMixture(LearnedMovement):
    """A mixture expressed in several frames; made by `fit_tp_gmm`, immutable."""

    weights: Float[np.ndarray, " C"]
    means: Float[np.ndarray, "P C 7"]
    """π_i, and μ_ij and Σ_ij in the frames of the handle and, if any, of the hinge."""
    covariances: Float[np.ndarray, "P C 7 7"]
    circle: CircleDistribution | None
    """The estimate of the hinge; None if there is none."""
    expected_centre: Float[np.ndarray, " 2"] | None = None
    """The hinge that the demonstrations let expect, x and z [m]."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> "TaskParameterisedMixture":
        """The movement around the hinge that follows from further ``via_points``."""
        circle = self.circle
        if circle is None or self.expected_centre is None:
            return self
        for via_point in via_points:
            circle = circle.through(via_point, self.expected_centre)
        return replace(self, circle=circle)

    @cached_property
    def regression(self) -> GaussianMixtureRegression:
        """The product of the frames' distributions at their current places."""
        variance = self.covariances[0, :, 0, 0]
        slopes = self.covariances[:, :, 1:, 0] / variance[:, None]
        explained = slopes[..., None] * self.covariances[:, :, :1, 1:]
        spreads = self.covariances[:, :, 1:, 1:] - explained
        # Pose of every component at its centre, and one unit of phase later.
        middles, later = self.means[..., 1:].copy(), self.means[..., 1:] + slopes
        if self.circle is not None:  # the other view is that of the task frame
            frame = hinge_frame(self.circle.mean[:2])
            middles[1], later[1] = frame.pose(middles[1]), frame.pose(later[1])
            spreads[1] = frame.basis @ spreads[1] @ frame.basis.T
            spreads[1] += hinge_uncertainty(self.means[1], self.circle)
        middle, spread = product_over_frames(middles, spreads)
        slope = product_over_frames(later, spreads)[0] - middle
        covariances = np.empty_like(self.covariances[0])
        covariances[:, 0, 0] = variance
        covariances[:, 0, 1:] = covariances[:, 1:, 0] = variance[:, None] * slope
        covariances[:, 1:, 1:] = spread + slope[:, :, None] * covariances[:, :1, 1:]
        return GaussianMixtureRegression(
            aligned=self.aligned,
            standardisation=Standardisation(offset=np.zeros(6), scale=np.ones(6)),
            weights=self.weights,
            means=np.column_stack([self.means[0, :, 0], middle]),
            covariances=covariances,
        )

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution of the pose at ``times``; samples are white around it."""
        return self.regression.predict(times)


def hinge_uncertainty(
    means: Float[np.ndarray, "C 7"], circle: CircleDistribution
) -> Float[np.ndarray, "C 6 6"]:
    """G C Gᵀ of components in the hinge's frame, with G = ∂(A μ + b)/∂c."""
    x, z = means[:, 1], means[:, 3]
    slope = np.zeros((len(x), 6, 2))
    slope[:, 0, 0] = slope[:, 2, 1] = 1.0 - z
    slope[:, 0, 1], slope[:, 2, 0] = -x, x
    spread: np.ndarray = slope @ circle.covariance[:2, :2] @ slope.mT
    return spread


def product_over_frames(
    means: Float[np.ndarray, "P C D"], covariances: Float[np.ndarray, "P C D D"]
) -> tuple[Float[np.ndarray, "C D"], Float[np.ndarray, "C D D"]]:
    """The normalised product over P frames of each of C Gaussians, Eq. (6)."""
    precisions = np.linalg.inv(covariances)
    covariance = np.linalg.inv(precisions.sum(axis=0))
    covariance = 0.5 * (covariance + covariance.mT)
    pull = np.einsum("pcde,pce->cd", precisions, means)
    mean: np.ndarray = np.einsum("cde,ce->cd", covariance, pull)
    return mean, covariance


def fit_mixture_of_views(
    times: Times, views: Sequence[Float[np.ndarray, "K M 6"]], config: GMRConfig
) -> Mixture:
    """Fit C components of phase and pose by expectation maximisation.

    It starts from equal bins of time. The views of a sample are independent given its
    component; with one view the result equals that of `fit_gmr`
    (``test_one_frame_is_gaussian_mixture_regression``).
    """
    standardisations = [Standardisation.of(view) for view in views]
    standardised = [
        standardisation.apply(view).reshape(-1, 6)
        for standardisation, view in zip(standardisations, views, strict=True)
    ]
    phases = np.tile(times, len(views[0]))
    samples = np.stack([np.column_stack([phases, view]) for view in standardised])
    bins = np.array_split(np.arange(len(times)), config.components)
    binned = np.concatenate([np.full(len(part), i) for i, part in enumerate(bins)])
    shares = np.eye(config.components)[np.tile(binned, len(views[0]))]
    bound = -np.inf
    weights, means, covariances = _maximised(samples, shares, config)
    for _ in range(config.max_iterations):
        # Logarithm of π_i Π_j N(X_nj; μ_ij, Σ_ij), without its constant.
        lower = np.linalg.cholesky(covariances)
        white = np.linalg.solve(lower, (samples[:, None] - means[:, :, None]).mT)
        log_root = np.log(np.diagonal(lower, axis1=2, axis2=3)).sum(axis=2)
        misfit = log_root[:, :, None] + 0.5 * np.sum(white**2, axis=2)
        densities = np.log(weights) + -misfit.sum(axis=0).T
        totals = scipy.special.logsumexp(densities, axis=1, keepdims=True)
        shares, previous, bound = np.exp(densities - totals), bound, totals.mean()
        weights, means, covariances = _maximised(samples, shares, config)
        if abs(bound - previous) < TOLERANCE:
            break
    else:
        warn_of_early_stop(config)
    scales = np.stack([np.append(1.0, output.scale) for output in standardisations])
    offsets = np.stack([np.append(0.0, output.offset) for output in standardisations])
    units = scales[:, None, :, None] * scales[:, None, None, :]
    return weights, offsets[:, None] + scales[:, None] * means, units * covariances


def _maximised(
    samples: Float[np.ndarray, "P N 7"],
    shares: Float[np.ndarray, "N C"],
    config: GMRConfig,
) -> Mixture:
    """Maximum-likelihood components for given shares of the samples."""
    # A component that has lost all its samples keeps a weight.
    counts = shares.sum(axis=0) + 10.0 * np.finfo(np.float64).eps
    means = shares.T @ samples / counts[:, None]
    apart = samples[:, None] - means[:, :, None]
    covariances = (apart * shares.T[:, :, None]).mT @ apart / counts[:, None, None]
    covariances += config.regularisation * np.eye(samples.shape[2])
    return counts / counts.sum(), means, covariances


def fit_tp_gmm(
    aligned: AlignedDemonstrations, config: GMRConfig = _GMR
) -> TaskParameterisedMixture:
    """Fit the mixture of all views by expectation maximisation."""
    config.check_phases(len(aligned.times))
    fits = [fit_kasa_circle(poses[:, PLANE]) for poses in aligned.poses]
    circles = [circle for circle in fits if circle is not None]
    views, circle = [aligned.poses], None
    if len(circles) == len(fits):
        frames = [hinge_frame(circle[:2]) for circle in circles]
        seen = zip(frames, aligned.poses, strict=True)
        views.append(np.stack([frame.seen(poses) for frame, poses in seen]))
        deviations = np.array(circles) - np.mean(circles, axis=0)
        free = max(len(circles) - 1, 1)
        circle = CircleDistribution(
            mean=np.mean(circles, axis=0), covariance=deviations.T @ deviations / free
        )
    weights, means, covariances = fit_mixture_of_views(aligned.times, views, config)
    return TaskParameterisedMixture(
        aligned=aligned,
        weights=weights,
        means=means,
        covariances=covariances,
        circle=circle,
        expected_centre=None if circle is None else circle.mean[:2],
    )
