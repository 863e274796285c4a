"""A reference trajectory smoothed by a kernel, for kernelized movement primitives.

Equation numbers refer to Huang, Rozo, Silvério, Caldwell, *Kernelized movement
primitives*, IJRR 2019. Everything is standardised. With N phases t_i, means μ_i and
covariances Σ_i (D × D, D = 6), K = [k(t_i, t_j) I_D], Σ = blockdiag(Σ_i), μ stacked and
k* = [k(t, t_i) I_D], the smoothed reference is

    mean(t) = k* (K + λ Σ)⁻¹ μ                                              Eq. (21)
    cov(t, t') = (N/λ_c) [k(t, t') I_D − k* (K + λ_c Σ)⁻¹ k*'ᵀ]             Eq. (26)

Neither N D × N D matrix is formed. K smooths so strongly that k(t, t_i) = φ(t) φ(t_i)ᵀ
with a few tens of features, to rounding. With one common Λ = Σ_i φ_i φ_iᵀ ⊗ Σ_i⁻¹ of
that size and A = I + Λ/λ, A_c = I + Λ/λ_c, the same two equations read

    mean(t) = φ(t) A⁻¹ Σ_i (φ_i ⊗ Σ_i⁻¹ μ_i) / λ
    cov(t, t') = (N/λ_c) [k(t, t') − φ(t) φ(t')ᵀ + φ(t) A_c⁻¹ φ(t')ᵀ]

which is the parametric form that the kernel form was derived from
(``test_prediction_is_the_published_dense_formula``). The cost hardly depends on N, and
an output left free is a precision of zero, where the published code has a variance of
1000.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float
from scipy.linalg import cho_factor, cho_solve, eigh

from gplfd_policies.gp.kernels import RBF

_NODES_PER_SCALE = 4
"""Nodes per length-scale that carry the kernel, besides `_MORE_NODES`."""
_MORE_NODES = 16
_SMALLEST_EIGENVALUE = 1e-15
"""Directions of the kernel below this share of the largest are rounding."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Reference:
    """A reference trajectory; read-only."""

    phases: Float[np.ndarray, " N"]
    """t_i; in the order of entry, not of phase."""
    means: Float[np.ndarray, "N 6"]
    """μ_i."""
    precisions: Float[np.ndarray, "N 6 6"]
    """Σ_i⁻¹; rows and columns of zeros where an output is left free."""

    def __post_init__(self) -> None:
        for array in (self.phases, self.means, self.precisions):
            array.setflags(write=False)

    def insert(
        self,
        phase: float,
        mean: Float[np.ndarray, "6"],
        precision: Float[np.ndarray, "6 6"],
        tolerance: float,
    ) -> "Reference":
        """The reference with one more entry, in place of those nearer than a tolerance.

        Args:
            phase: t of the entry.
            mean: μ of the entry.
            precision: Σ⁻¹ of the entry.
            tolerance: phases less than this apart coincide.
        """
        kept = np.abs(self.phases - phase) >= tolerance
        return Reference(
            phases=np.append(self.phases[kept], phase),
            means=np.concatenate([self.means[kept], mean[None]]),
            precisions=np.concatenate([self.precisions[kept], precision[None]]),
        )


@dataclass(frozen=True, kw_only=True, slots=True)
class _Features:
    """φ with k(t, t_i) = φ(t) φ(t_i)ᵀ for every reference phase t_i and any t."""

    kernel: RBF
    nodes: Float[np.ndarray, " Q"]
    """Phases whose kernels span those of all reference phases."""
    root: Float[np.ndarray, "Q R"]
    """φ(t) = k(t, nodes) root."""

    @classmethod
    def spanning(cls, kernel: RBF, phases: Float[np.ndarray, " N"]) -> "_Features":
        nodes = np.unique(phases)
        middle, half = 0.5 * (nodes[0] + nodes[-1]), 0.5 * (nodes[-1] - nodes[0])
        enough = _MORE_NODES + _NODES_PER_SCALE * 2.0 * half / kernel.length_scale
        if enough < len(nodes):
            # Fewer phases span as much if they lie denser towards the ends.
            nodes = middle + half * np.cos(np.linspace(0.0, np.pi, int(enough)))
        values, vectors = eigh(kernel(nodes, nodes), check_finite=False)
        kept = values > _SMALLEST_EIGENVALUE * values[-1]
        root = vectors[:, kept] / np.sqrt(values[kept])
        return cls(kernel=kernel, nodes=nodes, root=root)

    def __call__(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M R"]:
        return np.asarray(self.kernel(times, self.nodes) @ self.root)


@dataclass(frozen=True, kw_only=True, slots=True)
class SmoothedReference:
    """Mean and covariance of Eqs. (21) and (26) at any phase."""

    features: _Features
    weights: Float[np.ndarray, "6 R"]
    """A⁻¹ Σ_i (φ_i ⊗ Σ_i⁻¹ μ_i) / λ."""
    blocks: Float[np.ndarray, "6 R R"]
    """Blocks of A_c⁻¹ for one output with itself, transposed: as LAPACK leaves them in
    memory, so that a copy multiplies to the same bits."""
    amplitude: float
    """N/λ_c, the variance far from every reference phase."""

    @classmethod
    def fit(
        cls,
        reference: Reference,
        length_scale: float,
        mean_regularisation: float,
        covariance_regularisation: float,
    ) -> "SmoothedReference":
        """Smooth a reference.

        Args:
            reference: what to smooth.
            length_scale: of the radial basis function kernel, whose variance is one.
            mean_regularisation: λ.
            covariance_regularisation: λ_c.
        """
        kernel = RBF(length_scale=length_scale, signal_std=1.0)
        features = _Features.spanning(kernel, reference.phases)
        rows = features(reference.phases)
        size = rows.shape[1]
        weighed = rows[:, None, None, :] * reference.precisions[..., None]
        information = np.tensordot(rows, weighed, axes=(0, 0))
        information = information.transpose(1, 0, 2, 3).reshape(6 * size, 6 * size)

        def solved(regularisation: float, right: np.ndarray) -> np.ndarray:
            matrix = np.eye(6 * size) + information / regularisation
            factor = cho_factor(matrix, lower=True, overwrite_a=True)
            return np.asarray(cho_solve(factor, right))

        targets = np.einsum("nde,ne->nd", reference.precisions, reference.means)
        weights = solved(mean_regularisation, (targets.T @ rows).ravel())
        inverse = solved(covariance_regularisation, np.eye(6 * size))
        blocks = inverse.reshape(6, size, 6, size)
        return cls(
            features=features,
            weights=weights.reshape(6, size) / mean_regularisation,
            blocks=np.stack([blocks[d, :, d].T for d in range(6)]),
            amplitude=len(reference.phases) / covariance_regularisation,
        )

    def moments(
        self, times: Float[np.ndarray, " M"]
    ) -> tuple[Float[np.ndarray, "M 6"], Float[np.ndarray, "M 6"]]:
        """Mean and variance of every output."""
        rows = self.features(times)
        beyond = np.maximum(1.0 - np.sum(rows**2, axis=1), 0.0)
        within = np.sum((rows @ self.blocks.mT) * rows, axis=2).T
        return rows @ self.weights.T, self.amplitude * (beyond[:, None] + within)

    def covariance(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "6 M M"]:
        """Covariance between phases of every output."""
        rows = self.features(times)
        beyond = self.features.kernel(times, times) - rows @ rows.T
        covariance: np.ndarray = beyond + rows @ self.blocks.mT @ rows.T
        return self.amplitude * covariance
