"""Task-parameterised Gaussian mixture: frames at the closed handle and at the hinge.

Calinon, *A tutorial on task-parameterized movement learning and retrieval*, Intelligent
Service Robotics 9, 2016. A demonstration ξ is seen from P frames {A_j, b_j}, as
A_j⁻¹ (ξ − b_j), and one mixture is learned of all views together: its components share
their weights π_i and have a centre μ_ij and a covariance Σ_ij in every frame. In a new
situation every Gaussian is brought there by the new frames, and these are multiplied,

    Σ_i⁻¹ = Σ_j Σ̂_ij⁻¹,   μ_i = Σ_i Σ_j Σ̂_ij⁻¹ μ̂_ij,                            Eq. (6)

with μ̂_ij = A_j μ_ij + b_j and Σ̂_ij = A_j Σ_ij A_jᵀ. What results is a mixture of
phase and pose, which `gplfd_policies.movements.baselines.gmr` regresses. Frames that
agree count as independent witnesses: where both say the same the spread is 1/√2 of
theirs, as published (``test_two_equal_frames_halve_the_variance``).

What the tutorial leaves to the user:

* Frames. One is the task frame, whose origin is the closed handle. The other has its
  origin at the hinge c and the vector from the hinge to the closed handle for its third
  axis, with its length; the first axis is as long. There all doors are one door of unit
  radius. With axes of unit length, x = R sin φ would be the same in both frames and no
  frame could tell the radius. Height and rotations have the axes of the task frame.
* Where the hinge of a demonstration is. Nobody says; it is the centre of a circle
  through the hand's path (Kåsa's fit: |p|² = 2 pᵀc + k is linear in c and k), which is
  what an observer could measure. If a demonstrated path is no circle, there is no
  hinge: the method then has one frame and is GMM-GMR.
* The phase, which all frames share: they multiply what they say of the pose at a
  phase. As one more output, the phase would be witnessed twice, components would
  follow each other abruptly, and the mean would miss the demonstrations' by 4 cm.
* Where the hinge is in a new situation. Before anything has moved, where it was
  demonstrated on average, as uncertain as it varied; via-points are more points of the
  circle, and (c, k) is Gaussian given all of them. The path is linear in c, so that an
  uncertain c adds G C Gᵀ to a Gaussian of this frame, to first order. A via-point moves
  the hinge, not the path directly: it need not be met, and rotations learn nothing.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.arrays.records import freeze
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.baselines.gmr import GaussianMixtureRegression, GMRConfig
from gplfd_policies.movements.baselines.mixture_of_views import fit_mixture_of_views
from gplfd_policies.movements.baselines.standardisation import Standardisation
from gplfd_policies.movements.baselines.task_frames import (
    HANDLE,
    PLANE,
    Circle,
    Frame,
    fit_circle,
    hinge_frame,
)
from gplfd_policies.movements.movement import LearnedMovement
from gplfd_policies.movements.trajectory import (
    GaussianTrajectory,
    ViaPoint,
    checked_times,
)


@dataclass(frozen=True, kw_only=True, repr=False)
class TaskParameterisedMixture(LearnedMovement):
    """A mixture seen from several frames; made by `fit_tp_gmm`, immutable.

    It holds phase and pose, in this order, in the units of each frame.
    """

    weights: Float[np.ndarray, " C"]
    """π_i."""
    means: Float[np.ndarray, "P C 7"]
    """μ_ij; of the handle's frame, and the hinge's if there is one."""
    covariances: Float[np.ndarray, "P C 7 7"]
    """Σ_ij."""
    circle: Circle | None
    """Where the hinge is believed to be; None without any."""

    def __post_init__(self) -> None:
        freeze(self, "weights", "means", "covariances")

    def adapt(self, via_points: Sequence[ViaPoint]) -> "TaskParameterisedMixture":
        """The movement around the hinge that follows from ``via_points``.

        Args:
            via_points: poses that were seen or are wanted, in any order.
        """
        if self.circle is None:
            return self
        return replace(self, circle=self.circle.through(via_points))

    @cached_property
    def regression(self) -> GaussianMixtureRegression:
        """The product of what the frames say, where they are now."""
        variance = self.covariances[0, :, 0, 0]
        slopes = self.covariances[:, :, 1:, 0] / variance[:, None]
        explained = slopes[..., None] * self.covariances[:, :, :1, 1:]
        spreads = self.covariances[:, :, 1:, 1:] - explained
        # Where every component is in its middle, and where it goes from there.
        middles, later = self.means[..., 1:].copy(), self.means[..., 1:] + slopes
        for view, frame in enumerate(self._frames):
            middles[view] = frame.pose(middles[view])
            later[view] = frame.pose(later[view])
            spreads[view] = frame.basis @ spreads[view] @ frame.basis.T
        if self.circle is not None:
            spreads[1] += self._hinge_uncertainty(self.circle)
        middle, spread = product_of_gaussians(middles, spreads)
        slope = product_of_gaussians(later, spreads)[0] - middle
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

    @property
    def _frames(self) -> tuple[Frame, ...]:
        """The frames, where they are now."""
        if self.circle is None:
            return (HANDLE,)
        return HANDLE, hinge_frame(self.circle.mean[:2])

    def _hinge_uncertainty(self, circle: Circle) -> Float[np.ndarray, "C 6 6"]:
        """G C Gᵀ of every component, with G = ∂(A μ + b)/∂c."""
        x, z = self.means[1][:, 1], self.means[1][:, 3]
        slope = np.zeros((len(x), 6, 2))
        slope[:, 0, 0] = slope[:, 2, 1] = 1.0 - z
        slope[:, 0, 1], slope[:, 2, 0] = -x, x
        spread: np.ndarray = slope @ circle.covariance[:2, :2] @ slope.mT
        return spread

    @one_thread
    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution of the pose at ``times``; samples are white around the mean.

        Args:
            times: phases, strictly increasing, shape (M,). Outside the demonstrated
                range one component goes on along its straight line.

        Raises:
            ValueError: if there are no times, or they do not increase.
        """
        return self.regression.predict(checked_times(times))


def product_of_gaussians(
    means: Float[np.ndarray, "P C D"], covariances: Float[np.ndarray, "P C D D"]
) -> tuple[Float[np.ndarray, "C D"], Float[np.ndarray, "C D D"]]:
    """The normalised product over P frames of each of C Gaussians, Eq. (6)."""
    precisions = np.linalg.inv(covariances)
    covariance = np.linalg.inv(precisions.sum(axis=0))
    covariance = 0.5 * (covariance + covariance.mT)
    pull = np.einsum("pcde,pce->cd", precisions, means)
    mean: np.ndarray = np.einsum("cde,ce->cd", covariance, pull)
    return mean, covariance


@one_thread
def fit_tp_gmm(
    aligned: AlignedDemonstrations, config: GMRConfig | None = None
) -> TaskParameterisedMixture:
    """Fit the mixture of all views by expectation maximisation.

    Args:
        aligned: demonstrations on common phases.
        config: how; the defaults of `GMRConfig` if None. Outputs are standardised in
            every frame.

    Raises:
        ValueError: if there are more components than phases.

    Warns:
        UserWarning: if expectation maximisation did not converge.
    """
    config = GMRConfig() if config is None else config
    config.check_phases(len(aligned.times))
    fits = [fit_circle(poses[:, PLANE]) for poses in aligned.poses]
    circles = [circle for circle in fits if circle is not None]
    views, circle = [aligned.poses], None
    if len(circles) == len(fits):
        frames = [hinge_frame(each[:2]) for each in circles]
        seen = zip(frames, aligned.poses, strict=True)
        views.append(np.stack([frame.seen(poses) for frame, poses in seen]))
        deviations = np.array(circles) - np.mean(circles, axis=0)
        free = max(len(circles) - 1, 1)
        circle = Circle(
            mean=np.mean(circles, axis=0), covariance=deviations.T @ deviations / free
        )
    weights, means, covariances = fit_mixture_of_views(aligned.times, views, config)
    return TaskParameterisedMixture(
        aligned=aligned,
        weights=weights,
        means=means,
        covariances=covariances,
        circle=circle,
    )
