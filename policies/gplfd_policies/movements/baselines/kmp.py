"""Kernelized movement primitives: a kernel-smoothed, adaptable reference trajectory.

Equation numbers refer to Huang, Rozo, Silvério, Caldwell, *Kernelized movement
primitives*, IJRR 2019: a mixture regression gives a reference of means and covariances
of pose and rate, and a via-point is one more entry of the reference, or replaces one.
With N phases t_i, standardised means μ_i (12,) and covariances Σ_i of pose and rate,

    k(t, t') = [[k, ∂k/∂t'], [∂k/∂t, ∂²k/∂t∂t']] ⊗ I_6

for the scalar k = exp(−(t − t')²/(2 l²)), K = [k(t_i, t_j)], Σ = blockdiag(Σ_i), μ
stacked and k* = [k(t, t_i)], the smoothed reference is

    mean(t) = k* (K + λ Σ)⁻¹ μ                                              Eq. (21)
    cov(t, t') = (N/λ_c) [k(t, t') − k* (K + λ_c Σ)⁻¹ k*'ᵀ]                 Eq. (26)

The scalar k is so smooth that k = φ(t) φ(t')ᵀ with a few tens of features, those of its
power series (`RBF.features`) in an orthonormal basis of the reference. The block is
then Φ(t) Φ(t')ᵀ, where Φ(t) has the rows φ ⊗ I_6 and φ' ⊗ I_6: a rate is the derivative
of the same function, and the authors' differences over 1 ms are not needed. With Λ =
Σ_i Φ_iᵀ Σ_i⁻¹ Φ_i, A = I + Λ/λ and A_c = I + Λ/λ_c the same equations read

    mean(t) = Φ(t) A⁻¹ Σ_i Φ_iᵀ Σ_i⁻¹ μ_i / λ
    cov(t, t') = (N/λ_c) [k(t, t') − Φ(t) Φ(t')ᵀ + Φ(t) A_c⁻¹ Φ(t')ᵀ]

(``test_prediction_is_the_published_dense_formula``). The cost hardly depends on N or on
rates, and an unconstrained output has zero precision.
"""

import copy
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import scipy

from gplfd_env.validation.fields import Quantities, quantity
from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.gp.conditioning import conditioned
from gplfd_policies.gp.kernels import RBF
from gplfd_policies.movements.baselines.gmr import (
    GMRConfig,
    Standardisation,
    fit_outputs,
)
from gplfd_policies.movements.movement import MomentMovement, Moments, ViaPoint

_State = Float[np.ndarray, "2 6"]
"""Pose and rate, standardised."""
_STRONGEST = 1e-4  # Least standard deviation of a via-point, standardised.
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
    """λ_c; N/λ_c is the variance far from the reference. Published: 60, times 25."""


class Reference:
    """A reference trajectory, standardised, and its smoothing; it is never changed."""

    def __init__(
        self,
        config: KMPConfig,
        phases: Float[np.ndarray, " N"],
        means: Float[np.ndarray, "N 12"],
        precisions: Float[np.ndarray, "N 12 12"],
    ) -> None:
        """Smooth t_i, μ_i and Σ_i⁻¹, whose rows of unconstrained outputs are zero.

        Outputs are the standardised pose, then its rate per unit phase.
        """
        self.config, self.phases = config, phases
        self.means, self.precisions = means, precisions
        self._kernel = RBF(length_scale=config.length_scale, signal_std=1.0)
        different = np.unique(phases)
        # Phase about which the series of the kernel is taken.
        self._centre = 0.5 * float(different[0] + different[-1])
        reach = (different[-1] - self._centre) / config.length_scale
        # Later terms of the series are below 1e-16 everywhere on the reference.
        terms = int(reach**2 + 10.0 * reach) + 20
        place = different, self._centre, terms
        series = [self._kernel.features(*place), self._kernel.feature_rates(*place)]
        values, vectors = scipy.linalg.svd(np.vstack(series), full_matrices=False)[1:]
        self._basis = vectors[values > _SMALLEST * values[0]].T

        # Λ, the solution with A = I + Λ/λ, and the inverses of A and A_c = I + Λ/λ_c.
        rows = np.stack([self.features(phases), self.rates(phases)], axis=1)
        size = 6 * rows.shape[2]
        blocks = precisions.reshape(-1, 2, 6, 2, 6)
        weighed = np.einsum("nadbe,nbs->nades", blocks, rows)
        information = np.tensordot(rows, weighed, axes=((0, 1), (0, 1)))
        information = information.transpose(1, 0, 2, 3).reshape(size, size)

        def inverse(regularisation: float) -> np.ndarray:
            matrix = np.eye(size) + information / regularisation
            factor = scipy.linalg.cho_factor(matrix, lower=True, overwrite_a=True)
            return np.asarray(scipy.linalg.cho_solve(factor, np.eye(size)))

        targets = np.einsum("nde,ne->nd", precisions, means).reshape(-1, 2, 6)
        self._by_mean = inverse(config.mean_regularisation)
        self._by_covariance = inverse(config.covariance_regularisation)
        right = np.tensordot(targets, rows, axes=((0, 1), (0, 1))).ravel()
        self._weights = self._by_mean @ (right / config.mean_regularisation)

    def given(self, phase: float, state: _State, variance: _State) -> "Reference":
        """Return it with another entry of independent errors, which replaces others."""
        config = self.config
        tolerance = _SAME_PHASE * float(np.ptp(self.phases)) / (config.references - 1)
        kept = np.abs(self.phases - phase) >= tolerance
        observed = np.isfinite(variance)
        mean = np.where(observed, state, 0.0).reshape(1, 12)
        precision = np.diag(1.0 / variance.ravel())[None]
        entries = {
            "phases": np.append(self.phases[kept], phase),
            "means": np.concatenate([self.means[kept], mean]),
            "precisions": np.concatenate([self.precisions[kept], precision]),
        }
        within = np.min(self.phases) <= phase <= np.max(self.phases)
        if not (within and kept.all()):
            # The basis may grow, and an update cannot take back an entry.
            return Reference(config, **entries)
        later = copy.copy(self)
        vars(later).update(entries)
        rows = self.features(np.array([phase])), self.rates(np.array([phase]))
        for name, regularisation in (
            ("_by_covariance", config.covariance_regularisation),
            ("_by_mean", config.mean_regularisation),
        ):
            later._weights = self._weights
            for index in np.flatnonzero(observed.any(axis=1)):
                later._weights, vars(later)[name] = conditioned(
                    later._weights,
                    vars(later)[name],
                    np.kron(np.eye(6), rows[index]),
                    state[index],
                    regularisation * variance[index],
                )
        return later

    def features(self, times: Times) -> Float[np.ndarray, "M R"]:
        """φ(t)."""
        series = self._kernel.features(times, self._centre, len(self._basis))
        return np.asarray(series @ self._basis)

    def rates(self, times: Times) -> Float[np.ndarray, "M R"]:
        """φ'(t)."""
        series = self._kernel.feature_rates(times, self._centre, len(self._basis))
        return np.asarray(series @ self._basis)

    def moments(self, times: Times) -> tuple[Outputs, Outputs]:
        """Mean, Eq. (21), and variance of every output, the diagonal of Eq. (26)."""
        rows = self.features(times)
        beyond = np.maximum(1.0 - np.sum(rows**2, axis=1), 0.0)
        within = np.maximum(np.sum((rows @ self._blocks) * rows, axis=2).T, 0.0)
        mean = rows @ self._weights.reshape(6, -1).T
        amplitude = len(self.phases) / self.config.covariance_regularisation
        return mean, amplitude * (beyond[:, None] + within)

    def covariance(self, times: Times) -> Covariances:
        """Covariance between phases of every output, Eq. (26)."""
        rows = self.features(times)
        beyond = self._kernel(times, times) - rows @ rows.T
        covariance: np.ndarray = beyond + rows @ self._blocks @ rows.T
        return len(self.phases) / self.config.covariance_regularisation * covariance

    @property
    def _blocks(self) -> Float[np.ndarray, "6 R R"]:
        """Blocks of A_c⁻¹ for one output with itself."""
        size = self._basis.shape[1]
        inverse = self._by_covariance.reshape(6, size, 6, size)
        return np.asarray(np.einsum("didj->dij", inverse))


@dataclass(frozen=True, kw_only=True, repr=False)
class KernelizedMovementPrimitive(MomentMovement):
    """A learned movement that via-points adapt; made by `fit_kmp`, immutable.

    Far outside the reference the mean is the demonstrations' average and the variance
    is N/λ_c times theirs; this N includes via-points.
    """

    standardisation: Standardisation
    reference: Reference
    """The reference with via-points, taken from the mixture."""

    def adapt(
        self, via_points: Sequence[ViaPoint], rates: Sequence[Pose] = ()
    ) -> "KernelizedMovementPrimitive":
        """Return the primitive with via-points that replace references at their phase.

        A standard deviation σ enters as the covariance σ²/N, because every entry has
        the weight 1/N. An error that outputs share counts as independent errors. The
        first via-points also demand ``rates`` [m, rad per unit phase], free if NaN.
        """
        scale, reference = self.standardisation.scale, self.reference
        for index, via_point in enumerate(via_points):
            rate = rates[index] if index < len(rates) else np.full(6, np.nan)
            state = np.stack([self.standardisation.apply(via_point.pose), rate / scale])
            variance = np.where(np.isnan(state), np.inf, _STRONGEST**2)
            variance[0] = np.maximum(via_point.noise_variance / scale**2, variance[0])
            variance /= reference.config.references
            reference = reference.given(float(via_point.phase), state, variance)
        return replace(self, reference=reference)

    def _moments(self, times: Times) -> Moments:
        return self.standardisation.moments(*self.reference.moments(times))

    def _covariance(self, times: Times) -> Covariances:
        return self.standardisation.covariance(self.reference.covariance(times))


def fit_kmp(
    aligned: AlignedDemonstrations, config: KMPConfig = KMPConfig()
) -> KernelizedMovementPrimitive:
    """Learn a primitive: fit the mixture and take the reference from it."""
    standardisation = Standardisation.of(aligned.poses)
    poses = standardisation.apply(aligned.poses)
    states = np.concatenate([poses, np.gradient(poses, aligned.times, axis=1)], axis=2)
    mixture = GMRConfig(components=config.components)
    regression = fit_outputs(aligned, standardisation, states, mixture)
    phases = np.linspace(aligned.times[0], aligned.times[-1], config.references)
    means, covariances = regression.standardised_moments(phases)
    reference = Reference(config, phases, means, np.linalg.inv(covariances))
    return KernelizedMovementPrimitive(
        aligned=aligned, standardisation=standardisation, reference=reference
    )
