"""Probabilistic movement primitives, the second method of Table 1.

Paraschos et al., *Probabilistic Movement Primitives*, NeurIPS 2013, and Autonomous
Robots 42, 2018. A movement is y(t) = φ(t)ᵀ w + ε with B normalised Gaussian basis
functions φ, weights w ~ N(μ, Σ), output by output (6 B,), and observation noise ε ~
N(0, R) per output. Σ is a full matrix over all outputs: observing x also reduces the
uncertainty of z.

The covariance of D weight vectors has rank D - 1. Via-points outside the span of the
demonstrations are missed, or distort the rest of the movement, unless
`ProMPConfig.shrinkage` is raised (``test_few_demonstrations_span_few_movements``).
"""

from abc import ABC, abstractmethod
from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Covariances, Float, OutputCurves, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    LearnedMovement,
    ViaPoint,
    checked_times,
    stacked,
)

Basis = tuple[Float[np.ndarray, "M B"], Float[np.ndarray, "M B"]]
"""Basis functions at M phases and their derivatives, per unit phase."""

RIDGE: Final = 1e-8
"""Penalty on squared weights; it has an effect only where data are not sufficient."""
_SINGULAR = 1e-9
"""Least tolerance of a demand, as a share of its whole variance."""


@dataclass(frozen=True, kw_only=True, slots=True)
class ProMPConfig(Quantities):
    """Constants of a probabilistic movement primitive."""

    n_basis: int = quantity(20, low=2)
    """Basis functions per output B; centres evenly over phases 0 to 1."""
    overlap: float = quantity(0.7, above=0.0, below=1.0)
    """Height of a basis function at the distance 1/(2 B) from its centre."""
    shrinkage: float = quantity(1e-6, low=0.0, high=1.0)
    """λ in Σ = (1 - λ) S + λ diag(S), with S the sample covariance. The default makes Σ
    invertible. At 1, weights are independent."""


@dataclass(frozen=True, kw_only=True, repr=False)
class WeightMovement(LearnedMovement, ABC):
    """A Gaussian distribution over the weights of basis functions."""

    weight_mean: Float[np.ndarray, " W"]
    """μ, with W = 6 B."""
    weight_covariance: Float[np.ndarray, "W W"]
    """Σ, across all outputs."""
    noise_variance: Pose
    """R, the residual variance of the basis functions [m², rad²]."""

    @abstractmethod
    def basis(self, times: Times) -> Basis:
        """φ(t) and its derivative."""

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution of the pose at ``times``, observation noise included."""
        times = checked_times(times)
        basis, slope = self.basis(times)
        size, mean = basis.shape[1], self.weight_mean.reshape(6, -1)
        # Covariance of the weights of each output.
        blocks = np.einsum(
            "didj->dij", self.weight_covariance.reshape(6, size, 6, size)
        )
        spread = np.einsum("mi,dij->dmj", basis, blocks)
        variance = np.einsum("dmj,mj->md", spread, basis)
        half_rate = np.einsum("dmj,mj->md", spread, slope)
        std = np.sqrt(np.maximum(variance, 0.0) + self.noise_variance)
        moving = std > 0.0  # an output that never varies also has no rate
        return GaussianTrajectory(
            times=times,
            mean=basis @ mean.T,
            std=std,
            mean_rate=slope @ mean.T,
            std_rate=np.divide(half_rate, std, out=np.zeros_like(std), where=moving),
            covariance_function=partial(self._covariance, spread, basis),
        )

    def _covariance(
        self, spread: Float[np.ndarray, "6 M B"], basis: Float[np.ndarray, "M B"]
    ) -> Covariances:
        noise = self.noise_variance[:, None, None] * np.eye(len(basis))
        between: np.ndarray = np.einsum("dmj,nj->dmn", spread, basis)
        return between + noise

    def adapt(self, via_points: Sequence[ViaPoint]) -> "WeightMovement":
        """The movement conditioned on ``via_points``, all of them at once.

        With the demanded values y_v, their covariance V and the gain K,

            K = Σ Hᵀ (H Σ Hᵀ + V)⁻¹,  μ' = μ + K (y_v - H μ),  Σ' = (I - K H) Σ.

        Demands are on the movement φᵀ w itself, without observation noise.
        Contradictory demands without tolerance are met in the least-squares sense.
        """
        phases, poses, variances, along = stacked(via_points)
        which, outputs = asked = np.nonzero(np.isfinite(variances))
        if which.size == 0:
            return self
        together = which[:, None] == which
        variance = np.diag(variances[asked])
        variance += np.where(together, np.outer(along[asked], along[asked]), 0.0)
        basis, _ = self.basis(phases)
        rows = np.zeros((which.size, 6, basis.shape[1]))
        rows[np.arange(which.size), outputs] = basis[which]
        demand = rows.reshape(which.size, -1)
        cross = self.weight_covariance @ demand.T
        # K, by the pseudo-inverse if the sum is singular. Demands are scaled first, so
        # that the choice of units has no effect.
        whole = demand @ cross
        scale = np.sqrt(np.diag(whole) + np.diag(variance))
        scale = np.where(scale > 0.0, scale, 1.0)
        matrix = (whole + variance) / np.outer(scale, scale)
        if np.all(np.diag(variance) > _SINGULAR * scale**2):
            factor = scipy.linalg.cho_factor(matrix)
            gain = scipy.linalg.cho_solve(factor, (cross / scale).T).T / scale
        else:
            gain = cross / scale @ scipy.linalg.pinvh(matrix) / scale
        mean = self.weight_mean + gain @ (poses[asked] - demand @ self.weight_mean)
        keep = np.eye(len(mean)) - gain @ demand
        # Joseph's form: never negative, even for strong demands.
        covariance = keep @ self.weight_covariance @ keep.T
        covariance += gain @ variance @ gain.T
        return replace(self, weight_mean=mean, weight_covariance=covariance)


@dataclass(frozen=True, kw_only=True, repr=False)
class ProbabilisticMovementPrimitive(WeightMovement):
    """A Gaussian distribution over movements; made by `fit_promp`, immutable."""

    config: ProMPConfig

    def basis(self, times: Times) -> Basis:
        """φ(t) and its derivative."""
        config, size = self.config, self.config.n_basis
        basis = _basis(times, config)
        # Derivatives of the Gaussians' logarithms, and of the basis.
        sharpness = -4.0 * size**2 * np.log(config.overlap)
        slopes = -2.0 * sharpness * (times[:, None] - np.linspace(0.0, 1.0, size))
        return basis, basis * (slopes - np.sum(basis * slopes, axis=1, keepdims=True))


def fit_promp(
    aligned: AlignedDemonstrations, config: ProMPConfig = ProMPConfig()
) -> ProbabilisticMovementPrimitive:
    """Learn a probabilistic movement primitive from aligned demonstrations.

    Every demonstration is fitted by ridge regression; μ and S are mean and sample
    covariance of the weights, and R the mean squared residual per degree of freedom.
    """
    basis = _basis(aligned.times, config)
    gram = basis.T @ basis + RIDGE * np.eye(config.n_basis)
    learned = learn_weights(aligned.poses, basis, np.linalg.solve(gram, basis.T))
    sample, share = learned["weight_covariance"], config.shrinkage
    diagonal = np.diag(np.diag(sample))
    learned["weight_covariance"] = (1.0 - share) * sample + share * diagonal
    return ProbabilisticMovementPrimitive(aligned=aligned, config=config, **learned)


def learn_weights(
    poses: OutputCurves,
    basis: Float[np.ndarray, "M B"],
    regression: Float[np.ndarray, "B M"],
) -> dict[str, Any]:
    """Learn μ, Σ = S and R from curves, whose weights ``regression`` gives."""
    count, n_phases, _ = poses.shape
    size = basis.shape[1]
    if count < 2:
        raise ValueError(
            "A probabilistic movement primitive learns how repetitions differ, which "
            f"needs at least 2 demonstrations, got {count}."
        )
    if n_phases <= size:
        raise ValueError(
            f"{size} basis functions need more than {size} phases, got {n_phases}: "
            "align with more samples, or lower n_basis."
        )
    weights = np.einsum("bm,kmd->kdb", regression, poses)
    residuals = poses - np.einsum("mb,kdb->kmd", basis, weights)
    freedom = count * (n_phases - np.trace(regression @ basis))
    weights = weights.reshape(count, -1)
    return {
        "weight_mean": weights.mean(axis=0),
        "weight_covariance": np.cov(weights, rowvar=False),
        "noise_variance": np.sum(residuals**2, axis=(0, 1)) / freedom,
    }


def _basis(times: Times, config: ProMPConfig) -> Float[np.ndarray, "M B"]:
    """φ(t)."""
    sharpness = -4.0 * config.n_basis**2 * np.log(config.overlap)
    distance = times[:, None] - np.linspace(0.0, 1.0, config.n_basis)
    return np.asarray(scipy.special.softmax(-sharpness * distance**2, axis=1))
