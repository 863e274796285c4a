"""Probabilistic movement primitives, the second method of Table 1.

Paraschos et al., *Probabilistic Movement Primitives*, NeurIPS 2013, and Autonomous
Robots 42, 2018. A movement is y(t) = φ(t)ᵀ w + ε with B normalised Gaussian basis
functions φ, weights w ~ N(μ, Σ), output by output (6 B,), and observation noise ε ~
N(0, R) per output. Σ is a full matrix over all outputs: observing x informs of z.

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
from gplfd_policies.arrays.records import FINEST
from gplfd_policies.arrays.shapes import Covariances, Float, OutputCurves, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.conditioning import conditioned
from gplfd_policies.movements.movement import (
    GaussianTrajectory,
    LearnedMovement,
    ViaPoint,
    checked_times,
)
from gplfd_policies.movements.skill import SIZE_STD

Basis = tuple[Float[np.ndarray, "M B"], Float[np.ndarray, "M B"]]
"""Basis functions at M phases and their derivatives, per unit phase."""

RIDGE: Final = 1e-8
"""Penalty on squared weights; it has an effect only where data are not sufficient."""
_STRONGEST = 1e-4
"""Least standard deviation of a via-point, relative to that of all poses."""


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
        blocks = np.einsum("didj->dij", self.weight_covariance.reshape(6, size, 6, -1))
        spread = basis @ blocks
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
        between: np.ndarray = spread @ basis.T
        return between + noise

    def adapt(self, via_points: Sequence[ViaPoint]) -> "WeightMovement":
        """The movement φᵀ w itself, without its noise, given further via-points."""
        mean, covariance = self.weight_mean, self.weight_covariance
        least = _STRONGEST * np.maximum(self.aligned.poses.std(axis=(0, 1)), FINEST)
        for point in via_points:
            basis, _ = self.basis(np.array([float(point.phase)]))
            design, along = np.kron(np.eye(6), basis), np.asarray(point.along)
            noise = np.maximum(point.own_variance, least**2)
            mean, covariance = conditioned(
                mean, covariance, design, point.pose, noise, along
            )
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
    """Learn μ, Σ = S and R from curves, whose weights ``regression`` gives.

    For a single demonstration S is the variance of its unknown size, as in `Skill`.
    """
    count, n_phases, _ = poses.shape
    size = basis.shape[1]
    if n_phases <= size:
        raise ValueError(
            f"{size} basis functions need more than {size} phases, got {n_phases}: "
            "align with more samples, or lower n_basis."
        )
    weights = np.einsum("bm,kmd->kdb", regression, poses)
    residuals = poses - np.einsum("mb,kdb->kmd", basis, weights)
    freedom = count * (n_phases - np.trace(regression @ basis))
    if count > 1:
        covariance = np.cov(weights.reshape(count, -1), rowvar=False)
    else:
        larger = SIZE_STD * weights[0]
        covariance = scipy.linalg.block_diag(*(np.outer(w, w) for w in larger))
    return {
        "weight_mean": weights.reshape(count, -1).mean(axis=0),
        "weight_covariance": covariance,
        "noise_variance": np.sum(residuals**2, axis=(0, 1)) / freedom,
    }


def _basis(times: Times, config: ProMPConfig) -> Float[np.ndarray, "M B"]:
    """φ(t)."""
    sharpness = -4.0 * config.n_basis**2 * np.log(config.overlap)
    distance = times[:, None] - np.linspace(0.0, 1.0, config.n_basis)
    return np.asarray(scipy.special.softmax(-sharpness * distance**2, axis=1))
