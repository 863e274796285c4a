"""Kernelized movement primitives: a kernel-smoothed, adaptable reference trajectory.

Equation numbers refer to Huang, Rozo, Silvério, Caldwell, *Kernelized movement
primitives*, IJRR 2019: a mixture regression gives a reference of means and covariances,
and a via-point is one more entry of the reference, or replaces one. Via-points are
poses. With N phases t_i, standardised means μ_i and covariances Σ_i (D × D, D = 6), K =
[k(t_i, t_j) I_D], Σ = blockdiag(Σ_i), μ stacked and k* = [k(t, t_i) I_D], the smoothed
reference is

    mean(t) = k* (K + λ Σ)⁻¹ μ                                              Eq. (21)
    cov(t, t') = (N/λ_c) [k(t, t') I_D − k* (K + λ_c Σ)⁻¹ k*'ᵀ]             Eq. (26)

K is so smooth that k(t, t_i) = φ(t) φ(t_i)ᵀ with a few tens of features, those of the
kernel's power series (`RBF.features`) in an orthonormal basis of the reference. With Λ
= Σ_i φ_i φ_iᵀ ⊗ Σ_i⁻¹, A = I + Λ/λ and A_c = I + Λ/λ_c the same equations read

    mean(t) = φ(t) A⁻¹ Σ_i (φ_i ⊗ Σ_i⁻¹ μ_i) / λ
    cov(t, t') = (N/λ_c) [k(t, t') − φ(t) φ(t')ᵀ + φ(t) A_c⁻¹ φ(t')ᵀ]

(``test_prediction_is_the_published_dense_formula``). The cost hardly depends on N, and
an unconstrained output has zero precision.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.movements.baselines.gmr import (
    GaussianMixtureRegression,
    GMRConfig,
    fit_gmr,
)
from gplfd_policies.movements.movement import MomentMovement, Moments, ViaPoint

_STRONGEST = 1e-4
"""Least standard deviation of a via-point, standardised."""
_SAME_PHASE = 0.1
"""Phases closer than this share of the reference's spacing coincide; as published."""
_SMALLEST = 1e-10
"""Directions of the features below this share of the largest are left out."""


@dataclass(frozen=True, kw_only=True, slots=True)
class KMPConfig(Quantities):
    """Settings of the reference and its smoothing; only λ/N and λ_c/N matter."""

    components: int = quantity(8, low=1)
    """Gaussians of the mixture behind the reference; as published."""
    references: int = quantity(400, low=2)
    """Number N of reference phases; as published. The cost hardly depends on it."""
    length_scale: float = quantity(0.144, low=0.01)
    """Length-scale of the kernel [phase]. Published is exp(−6 (t − t')²) over 2 s."""
    mean_regularisation: float = quantity(25.0, above=0.0)
    """λ. Published is 1 for letters that vary by 25 cm², thus 25 in standardised
    outputs. Where demonstrations differ much it pulls the mean to the average pose."""
    covariance_regularisation: float = quantity(1500.0, above=0.0)
    """λ_c. Published is 60, times 25 for the same reason: too confident. N/λ_c
    is the variance far from the reference."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Reference:
    """A reference trajectory; it is never changed."""

    phases: Float[np.ndarray, " N"]
    """t_i; in the order of entry, not of phase."""
    means: Float[np.ndarray, "N 6"]
    """μ_i."""
    precisions: Float[np.ndarray, "N 6 6"]
    """Σ_i⁻¹; rows and columns of unconstrained outputs are zero."""


@dataclass(frozen=True, kw_only=True, slots=True)
class SmoothedReference:
    """Mean and covariance of Eqs. (21) and (26) at any phase."""

    kernel: RBF
    centre: float
    """Phase about which the series of the kernel, of variance one, is taken."""
    basis: Float[np.ndarray, "F R"]
    """φ(t) = kernel.features(t) basis."""
    weights: Float[np.ndarray, "6 R"]
    """A⁻¹ Σ_i (φ_i ⊗ Σ_i⁻¹ μ_i) / λ."""
    blocks: Float[np.ndarray, "6 R R"]
    """Blocks of A_c⁻¹ for one output with itself, transposed, as LAPACK leaves them."""
    amplitude: float
    """N/λ_c."""

    @classmethod
    def fit(cls, reference: Reference, config: KMPConfig) -> "SmoothedReference":
        """Smooth a reference."""
        kernel = RBF(length_scale=config.length_scale, signal_std=1.0)
        phases = np.unique(reference.phases)
        centre = 0.5 * (phases[0] + phases[-1])
        reach = (phases[-1] - centre) / kernel.length_scale
        # Later terms of the series are below 1e-16 everywhere on the reference.
        terms = int(reach**2 + 10.0 * reach) + 20
        series = kernel.features(phases, centre, terms)
        values, vectors = scipy.linalg.svd(series, full_matrices=False)[1:]
        basis = vectors[values > _SMALLEST * values[0]].T
        rows = kernel.features(reference.phases, centre, terms) @ basis

        # Λ, and solutions with A = I + Λ/λ and A_c = I + Λ/λ_c.
        size = rows.shape[1]
        weighed = rows[:, None, None, :] * reference.precisions[..., None]
        information = np.tensordot(rows, weighed, axes=(0, 0))
        information = information.transpose(1, 0, 2, 3).reshape(6 * size, 6 * size)

        def solved(regularisation: float, right: np.ndarray) -> np.ndarray:
            matrix = np.eye(6 * size) + information / regularisation
            factor = scipy.linalg.cho_factor(matrix, lower=True, overwrite_a=True)
            return np.asarray(scipy.linalg.cho_solve(factor, right))

        targets = np.einsum("nde,ne->nd", reference.precisions, reference.means)
        weights = solved(config.mean_regularisation, (targets.T @ rows).ravel())
        inverse = solved(config.covariance_regularisation, np.eye(6 * size))
        blocks = inverse.reshape(6, size, 6, size)
        return cls(
            kernel=kernel,
            centre=float(centre),
            basis=basis,
            weights=weights.reshape(6, size) / config.mean_regularisation,
            blocks=np.stack([blocks[d, :, d].T for d in range(6)]),
            amplitude=len(reference.phases) / config.covariance_regularisation,
        )

    def features(self, times: Times) -> Float[np.ndarray, "M R"]:
        """φ(t)."""
        series = self.kernel.features(times, self.centre, len(self.basis))
        return np.asarray(series @ self.basis)

    def moments(self, times: Times) -> tuple[Outputs, Outputs]:
        """Mean and variance of every output."""
        rows = self.features(times)
        beyond = np.maximum(1.0 - np.sum(rows**2, axis=1), 0.0)
        within = np.sum((rows @ self.blocks.mT) * rows, axis=2).T
        return rows @ self.weights.T, self.amplitude * (beyond[:, None] + within)

    def covariance(self, times: Times) -> Covariances:
        """Covariance between phases of every output."""
        rows = self.features(times)
        beyond = self.kernel(times, times) - rows @ rows.T
        covariance: np.ndarray = beyond + rows @ self.blocks.mT @ rows.T
        return self.amplitude * covariance


@dataclass(frozen=True, kw_only=True, repr=False)
class KernelizedMovementPrimitive(MomentMovement):
    """A learned movement that via-points adapt; made by `fit_kmp`, immutable.

    Far outside the reference the mean is the demonstrations' average and the variance
    is N/λ_c times theirs; this N includes via-points.
    """

    regression: GaussianMixtureRegression
    config: KMPConfig
    reference: Reference
    """The reference with via-points, standardised, taken from the mixture."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> "KernelizedMovementPrimitive":
        """Return the primitive with via-points that replace references at their phase.

        A standard deviation σ enters as the covariance σ²/N, because every entry has
        the weight 1/N. An error that outputs share counts as independent errors.
        """
        standardisation = self.regression.standardisation
        count = self.config.references
        tolerance = _SAME_PHASE * float(np.ptp(self.aligned.times)) / (count - 1)
        reference = self.reference
        for via_point in via_points:
            variance = via_point.noise_variance / standardisation.scale**2
            precision = count / np.maximum(variance, _STRONGEST**2)
            pose = standardisation.apply(via_point.pose)
            mean = np.where(precision > 0.0, pose, 0.0)[None]
            kept = np.abs(reference.phases - via_point.phase) >= tolerance
            precisions = reference.precisions[kept], np.diag(precision)[None]
            reference = Reference(
                phases=np.append(reference.phases[kept], via_point.phase),
                means=np.concatenate([reference.means[kept], mean]),
                precisions=np.concatenate(precisions),
            )
        return replace(self, reference=reference)

    @cached_property
    def _smoothed(self) -> SmoothedReference:
        return SmoothedReference.fit(self.reference, self.config)

    def _moments(self, times: Times) -> Moments:
        """Eq. (21), and the diagonal of Eq. (26)."""
        return self.regression.standardisation.moments(*self._smoothed.moments(times))

    def _covariance(self, times: Times) -> Covariances:
        """Eq. (26)."""
        smoothed = self._smoothed.covariance(times)
        return self.regression.standardisation.covariance(smoothed)


def fit_kmp(
    aligned: AlignedDemonstrations, config: KMPConfig = KMPConfig()
) -> KernelizedMovementPrimitive:
    """Learn a primitive: fit the mixture and take the reference from it."""
    regression = fit_gmr(aligned, GMRConfig(components=config.components))
    phases = np.linspace(aligned.times[0], aligned.times[-1], config.references)
    means, covariances = regression.standardised_moments(phases)
    precisions = np.linalg.inv(covariances)
    reference = Reference(phases=phases, means=means, precisions=precisions)
    return KernelizedMovementPrimitive(
        aligned=aligned, regression=regression, config=config, reference=reference
    )
