"""Mixture of discrete-time Gaussian processes: a reconstruction; not in Table 1.

Von Hartz et al., *The Unreasonable Effectiveness of Discrete-Time Gaussian Process
Mixtures for Robot Policy Learning*, arXiv:2505.03296, known from abstract and
summaries. A mode is a sequence of Gaussians on R³ × SO(3) with Fréchet mean and tangent
covariance; its weight is its share of the trajectories; evidence updates Gaussians and
weights. With the deviations e_i (position and Log(R_i R_μᵀ)) of K demonstrations,

    Cov[e(t), e(t')] = exp(-(t - t')²/(2 ℓ²)) Σ_i e_i(t) e_i(t')ᵀ / (K - 1).

Assumptions where the sources give no information or the benchmark needs more:

* Published steps are independent, ℓ → 0. A greater ℓ tapers the sample covariance
  between steps; the covariance of each step is unchanged.
* Evidence consists of via-points, for which conditioning in the tangent space is exact.
* Number of modes: demonstrations are clustered by average linkage of the chords between
  their displacements from the start, of unit norm, with 1 m equal to 1 rad.
* A mode of one demonstration has the spread of the largest mode.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_env.spatial.turns import REGULAR
from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.records import FINEST
from gplfd_policies.arrays.shapes import (
    Covariances,
    Float,
    Int,
    OutputCurves,
    Outputs,
    Times,
)
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.conditioning import ConditionedFunctions, Places
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    LearnedMovement,
    MomentMovement,
    Moments,
    ViaPoint,
)

_LEAST: Final = 1e-4  # least standard deviation, relative to the output's greatest


@dataclass(frozen=True, kw_only=True, slots=True)
class MiDiGaPConfig(Quantities):
    """Constants of a mixture of discrete-time Gaussian processes."""

    mode_angle: float = quantity(0.7, above=0.0, high=np.pi)
    """Least mean angle between the displacements of two modes [rad]."""
    length_scale: float = quantity(1.0, above=0.0)
    """ℓ, the phase over which steps are correlated."""


@dataclass(frozen=True, kw_only=True, repr=False)
class DiscreteTimeGP(MomentMovement):
    """One mode, a movement learned from its demonstrations; immutable.

    Predicted deviations are those of the rotation vector, to first order.
    """

    mean: Outputs
    """Mean position and Fréchet mean of the orientation at every step [m, rad]."""
    roots: OutputCurves
    """Deviations e_i / √(K - 1) at every step, in fixed axes [m, rad]."""
    seen: ConditionedFunctions
    """Deviation from the mean, given via-points."""
    log_evidence: float = 0.0
    """Log density of the via-points under the mode."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> "DiscreteTimeGP":
        """The mode conditioned on further via-points."""
        seen, log_evidence = self.seen, self.log_evidence
        for via_point in via_points:
            noise = via_point.own_variance
            places = self.places(np.array([float(via_point.phase)]))
            mean = places[1]
            pose = np.where(np.isfinite(noise), via_point.pose, mean[0])
            turn = compose_rotvecs(pose[3:], -mean[0, 3:])
            missed = pose - mean[0]
            missed[3:] = rotvec_jacobian(mean[0, 3:]) @ turn
            noise, along = np.maximum(noise, self._white), np.asarray(via_point.along)
            seen, new = seen.given(places, missed, noise, along)
            misfit = np.log(2.0 * np.pi) * np.count_nonzero(new.observed)
            misfit += new.whitened @ new.whitened
            log_evidence -= float(0.5 * misfit + np.log(np.diag(new.root)).sum())
        return replace(self, seen=seen, log_evidence=log_evidence)

    def places(self, times: Times) -> Places:
        """Phases, mean, and roots (M, 6, K) for the rotation vector.

        Mean and roots are constant outside the task.
        """
        steps, both = self.aligned.times, np.concatenate([self.mean[None], self.roots])
        interpolated = scipy.interpolate.make_interp_spline(steps, both, k=1, axis=1)
        curves = interpolated(np.clip(times, steps[0], steps[-1]))
        mean, roots = curves[0], curves[1:].transpose(1, 2, 0).copy()
        roots[:, 3:] = rotvec_jacobian(mean[:, 3:]) @ roots[:, 3:]
        return times, mean, roots

    @property
    def _white(self) -> Float[np.ndarray, " 6"]:
        variance = np.sum(self.roots**2, axis=0).max(axis=0)
        return np.asarray(_LEAST**2 * np.maximum(variance, FINEST**2))

    def _moments(self, times: Times) -> Moments:
        places = self.places(times)
        _, mean, roots = places
        change, half = self.seen.explained(places)
        turns = np.linalg.solve(rotvec_jacobian(mean[:, 3:]), change[:, 3:, None])
        turned = compose_rotvecs(turns[:, :, 0], mean[:, 3:])
        moved = mean + change
        moved[:, 3:] = nearest_rotvecs(turned, moved[:, 3:])
        variance = np.sum(roots**2, axis=2) - np.einsum("pmi,pmi->mi", half, half)
        return moved, np.sqrt(np.maximum(variance, 0.0) + self._white)

    def _covariance(self, times: Times) -> Covariances:
        places = self.places(times)
        prior = self.seen.covariance(places, places)
        half = self.seen.explained(places)[1].transpose(2, 1, 0)
        white = self._white[:, None, None] * np.eye(len(times))
        return np.asarray(np.einsum("mini->imn", prior) + white - half @ half.mT)


def tapered_covariance(
    length_scale: float, a: Places, b: Places
) -> Float[np.ndarray, "A 6 B 6"]:
    """Covariance of a mode's outputs at ``a`` with those at ``b``, before evidence."""
    apart = np.subtract.outer(a[0], b[0]) / length_scale
    products = np.tensordot(a[2], b[2], axes=(2, 2))
    return np.asarray(products * np.exp(-0.5 * apart**2)[:, None, :, None])


@dataclass(frozen=True, kw_only=True, repr=False)
class MixtureOfDiscreteTimeGPs(LearnedMovement):
    """A mixture that predicts its most probable mode; made by `fit_midigap`."""

    modes: tuple[DiscreteTimeGP, ...]
    """The modes, the largest first."""

    @property
    def weights(self) -> Float[np.ndarray, " modes"]:
        """Probability of every mode given the via-points so far."""
        logs = [np.log(len(m.aligned.poses)) + m.log_evidence for m in self.modes]
        return np.asarray(scipy.special.softmax(logs))

    def adapt(self, via_points: Sequence[ViaPoint]) -> "MixtureOfDiscreteTimeGPs":
        """The mixture given further via-points: Gaussians and weights."""
        return replace(self, modes=tuple(mode.adapt(via_points) for mode in self.modes))

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution of the most probable mode; of the largest in a tie."""
        return self.modes[int(np.argmax(self.weights))].predict(times)


def fit_midigap(
    aligned: AlignedDemonstrations, config: MiDiGaPConfig = MiDiGaPConfig()
) -> MixtureOfDiscreteTimeGPs:
    """Partition demonstrations into modes, and learn the Gaussians of each."""
    if np.linalg.norm(aligned.poses[..., 3:], axis=2).max() > REGULAR:
        raise ValueError(
            "the demonstrations turn by more than 300 degrees, where this mixture is "
            "singular; choose another policy, such as gp"
        )
    parts = partition_by_angle(aligned.poses, config.mode_angle)
    if len(parts[0]) < 2:
        raise ValueError(
            "A mixture of discrete-time Gaussian processes needs at least 2 "
            f"demonstrations of one mode, got 1 of each of {len(parts)}."
        )
    modes: list[DiscreteTimeGP] = []
    for part in parts:
        poses = aligned.poses[part]
        mean = frechet_mean(poses)
        turns = compose_rotvecs(poses[:, :, 3:], -mean[:, 3:])
        roots = np.concatenate([poses[:, :, :3] - mean[:, :3], turns], axis=2)
        roots = roots / np.sqrt(len(part) - 1) if len(part) > 1 else modes[0].roots
        clocks = None if aligned.clocks is None else aligned.clocks[part]
        members = replace(aligned, poses=poses, clocks=clocks, wrenches=None, rests=())
        nowhere = np.empty(0), np.empty((0, 6)), np.empty((0, 6, len(roots)))
        seen = ConditionedFunctions(
            partial(tapered_covariance, config.length_scale), nowhere
        )
        modes.append(DiscreteTimeGP(aligned=members, mean=mean, roots=roots, seen=seen))
    return MixtureOfDiscreteTimeGPs(aligned=aligned, modes=tuple(modes))


def partition_by_angle(
    poses: OutputCurves, mode_angle: float
) -> list[Int[np.ndarray, " N"]]:
    """Indices of the demonstrations of every mode, the largest first."""
    if len(poses) < 2:
        return [np.arange(len(poses))]
    flat = (poses - poses[:, :1]).reshape(len(poses), -1)
    length = np.linalg.norm(flat, axis=1, keepdims=True)
    tree = scipy.cluster.hierarchy.average(flat / np.maximum(length, FINEST))
    chord = 2.0 * np.sin(0.5 * mode_angle)
    labels = scipy.cluster.hierarchy.fcluster(tree, chord, criterion="distance")
    parts = [np.flatnonzero(labels == label) for label in np.unique(labels)]
    return sorted(parts, key=lambda part: (-len(part), part[0]))


def frechet_mean(poses: OutputCurves) -> Outputs:
    """Mean position at every phase, and the rotation R with Σ_i Log(R_i Rᵀ) = 0."""
    mean: np.ndarray = poses.mean(axis=0)
    for _ in range(100):
        step = compose_rotvecs(poses[:, :, 3:], -mean[:, 3:]).mean(axis=0)
        mean[:, 3:] = nearest_rotvecs(compose_rotvecs(step, mean[:, 3:]), mean[:, 3:])
        if np.abs(step).max() < 1e-12:
            break
    return mean


def rotvec_jacobian(rotvecs: Float[np.ndarray, "*N 3"]) -> Float[np.ndarray, "*N 3 3"]:
    """Derivative of Log(Exp(e) Exp(r)) by e at e = 0, singular at |r| = 2π.

    I - [r]×/2 + (1 - (θ/2) cot(θ/2)) [r]×²/θ², θ = |r|.
    """
    cross = np.moveaxis(np.cross(rotvecs[..., None, :], np.eye(3)), -2, -1)
    half = np.maximum(0.5 * np.linalg.norm(rotvecs, axis=-1), 1e-3)
    factor = (1.0 - half / np.tan(half)) / (4.0 * half**2)
    return np.asarray(np.eye(3) - 0.5 * cross + factor[..., None, None] * cross @ cross)


def nearest_rotvecs(
    rotvecs: Float[np.ndarray, "*N 3"], targets: Float[np.ndarray, "*N 3"]
) -> Float[np.ndarray, "*N 3"]:
    """The rotation vectors (θ + 2πk) u of the same rotations nearest to targets."""
    angle = np.maximum(np.linalg.norm(rotvecs, axis=-1, keepdims=True), FINEST)
    along = np.sum(rotvecs * targets, axis=-1, keepdims=True) / angle
    turns = np.round((along - angle) / (2.0 * np.pi))
    return np.asarray(rotvecs * (1.0 + 2.0 * np.pi * turns / angle))
