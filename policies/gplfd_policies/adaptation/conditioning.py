"""Gaussian conditioning of six smooth curves together, one via-point at a time.

A repetition of the task is the mean, plus deviations given by a few standard-normal
numbers z_i per output, which are independent a priori:

    y_i(t) = m_i(t) + φ_i(t)ᵀ z_i + white noise.

A via-point at *any* phase observes all outputs at once, each with its own noise and one
shared error (`ViaPoint.along`): covariance diag(σ²) + ρ ρᵀ. With H the 6 × n matrix of
the curves,

    S = H C Hᵀ + diag(σ²) + ρ ρᵀ = L Lᵀ,  B = C Hᵀ L⁻ᵀ,
    z ← z + B L⁻¹ (y − m − H z),  C ← C − B Bᵀ,

This is exact for any ρ (``test_shared_error_equals_dense_conditioning``); the grid of
the reported distribution has no influence. If ρ = 0 the outputs stay independent.
"""

from dataclasses import dataclass
from functools import partial

import numpy as np
import scipy

from gplfd_policies.arrays.shapes import Covariances, Float, Outputs, Pose, Times
from gplfd_policies.gp.legendre import LegendreBasis
from gplfd_policies.movements.trajectory import GaussianTrajectory

_STRONGEST = 1e-8
"""Least via-point variance, relative to the largest variance of the output: 1e-4 of the
demonstrated spread, so that σ_v = 0 and repeated or contradictory via-points have a
solution, their average."""
_LEFT_OUT = 1e-7
"""Eigenvectors of a smooth covariance whose eigenvalue is below this share of the
largest are left out: no via-point can observe them."""


def basis_for_grid(
    times: Float[np.ndarray, " N"], grid: Times, shortest_scale: float
) -> LegendreBasis:
    """Return a basis over demonstrations and grid; raise if the grid is impossible."""
    if len(grid) == 0 or not np.isfinite(grid).all():
        raise ValueError(f"Adaptation needs finite grid phases, got {grid}.")
    start = float(min(times[0], np.min(grid)))
    stop = float(max(times[-1], np.max(grid)))
    basis = LegendreBasis.for_length_scale(start, stop, shortest_scale)
    if basis is None:
        raise ValueError(
            f"The grid reaches from {np.min(grid)} to {np.max(grid)}, too far beyond "
            f"the demonstrated [{times[0]}, {times[-1]}]; keep it near that range."
        )
    return basis


@dataclass(frozen=True, kw_only=True, slots=True)
class Repetition:
    """The prior of a repetition, before any via-point, in a basis."""

    basis: LegendreBasis
    """Basis of all coefficients."""
    mean: Float[np.ndarray, "Q 6"]
    """Coefficients of the mean m_i."""
    deviations: Float[np.ndarray, "6 Q R"]
    """Coefficients of the curves φ_i, R of each output."""
    log_white: Float[np.ndarray, "Q 6"]
    """Coefficients of the logarithm of the white variance, which is independent from
    sample to sample and not reduced by via-points."""

    @classmethod
    def from_covariance(
        cls,
        basis: LegendreBasis,
        mean: Float[np.ndarray, "Q 6"],
        covariance: Float[np.ndarray, "6 Q Q"],
        log_white: Float[np.ndarray, "Q 6"],
    ) -> "Repetition":
        """Compute the curves φ_i of each output from the covariance of coefficients."""
        return cls(
            basis=basis,
            mean=mean,
            deviations=leading_curves(covariance, _LEFT_OUT),
            log_white=log_white,
        )

    @property
    def table(self) -> Float[np.ndarray, "Q C"]:
        """Coefficients of every curve: m, log white, ṁ, and φ by output."""
        flat = self.deviations.transpose(1, 0, 2).reshape(self.basis.size, -1)
        slope = self.basis.differentiate(self.mean)
        return np.concatenate([self.mean, self.log_white, slope, flat], axis=1)


def _curves(rows: Float[np.ndarray, "M C"]) -> Float[np.ndarray, "6 M R"]:
    """Return φ_i, or its derivatives, by output, from rows of the table."""
    curves = rows[:, 18:].reshape(len(rows), 6, -1)
    return np.ascontiguousarray(curves.transpose(1, 0, 2))


def leading_curves(
    covariance: Float[np.ndarray, "*N Q Q"], left_out: float
) -> Float[np.ndarray, "*N Q R"]:
    """Return eigenvectors times roots of eigenvalues above a share of the largest."""
    values, vectors = np.linalg.eigh(covariance)
    values = np.maximum(values, 0.0)
    kept = values > left_out * values[..., -1:]
    most = max(int(np.max(np.sum(kept, axis=-1))), 1)
    curves: np.ndarray = vectors[..., -most:] * np.sqrt(values[..., None, -most:])
    return curves


@dataclass(frozen=True, kw_only=True, slots=True)
class Local:
    """A repetition at one phase, before any via-point."""

    mean: Pose
    """m_i at this phase."""
    white: Pose
    """The white variance at this phase."""
    curves: Float[np.ndarray, "6 R"]
    """φ_i at this phase."""


@dataclass(frozen=True, kw_only=True, slots=True)
class InnovationStatistics:
    """Innovation statistics of an observed pose; zeros for unobserved outputs."""

    observed: Pose
    """1 where an output was observed, else 0."""
    given_others: Pose
    """Squared innovation of each output over its variance, *given the other five
    outputs*."""
    joint: float
    """Squared Mahalanobis distance of all outputs together."""
    log_variance: float
    """Logarithm of the determinant of their covariance."""


_OUTPUTS = np.arange(6)[:, None]
_DIAGONAL = np.diag_indices(6)


class ConditionedProcess:
    """Six curves on a grid of phases, conditioned in place."""

    def __init__(self, prior: Repetition, grid: Times) -> None:
        self.grid = grid
        self._prior, self._table = prior, prior.table
        self._rows = prior.basis.matrix(grid) @ self._table
        self._mean, self._white = self._rows[:, :6].copy(), np.exp(self._rows[:, 6:12])
        self._curves = _curves(self._rows)
        self._variance = np.sum(self._curves**2, axis=2).T
        self._floor = _STRONGEST * np.max(self._variance + self._white, axis=0)
        # Entries of the state that belong to each output.
        size = 6 * self._curves.shape[2]
        self._places = np.arange(size).reshape(6, -1)
        self._state = np.zeros(size)
        self._covariance = np.asfortranarray(np.eye(size))
        self._design = np.zeros((6, size))

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid, a read-only view."""
        view: np.ndarray = self._mean.view()
        view.setflags(write=False)
        return view

    def variance(self) -> Outputs:
        """Current variance on the grid, white part included."""
        return np.asarray(np.maximum(self._variance, 0.0) + self._white)

    def at(self, phase: float) -> Local:
        """The prior at a phase.

        Raises:
            ValueError: if the phase is outside demonstrations and grid.
        """
        basis = self._prior.basis
        if not basis.start <= phase <= basis.stop:
            raise ValueError(
                f"The via-point's phase {phase} is outside the range "
                f"[{basis.start}, {basis.stop}] of demonstrations and "
                f"grid; clip it, or build the adaptation on a wider grid."
            )
        row = basis.row(phase) @ self._table
        return Local(
            mean=row[:6],
            white=np.exp(row[6:12]),
            curves=_curves(row[None])[:, 0],
        )

    def update(
        self, here: Local, pose: Pose, noise_variance: Pose, along: Pose
    ) -> InnovationStatistics:
        """Condition on a pose.

        Args:
            here: the repetition at the pose's phase, from `at`.
            pose: observed pose; outputs with infinite noise are ignored.
            noise_variance: variance of each output's own noise.
            along: the error that all outputs share, see `ViaPoint.along`.
        """
        observed = np.isfinite(noise_variance)
        curves = here.curves * observed[:, None]
        design = self._design
        design[_OUTPUTS, self._places] = curves
        expected = here.mean + design @ self._state
        innovation = np.where(observed, pose - expected, 0.0)
        gain = self._covariance @ design.T
        error, variance = observed * along, np.maximum(noise_variance, self._floor)
        covariance = design @ gain + np.multiply.outer(error, error)
        covariance[_DIAGONAL] += np.where(observed, variance, 1.0)
        root = np.linalg.cholesky(covariance)
        inverse_root, _ = scipy.linalg.lapack.dtrtri(root, lower=1)
        half = gain @ inverse_root.T
        whitened = inverse_root @ innovation
        self._state += half @ whitened
        self._covariance = scipy.linalg.blas.dgemm(
            -1.0, half, half, trans_b=1, beta=1.0, c=self._covariance, overwrite_c=1
        )
        on_grid = self._curves @ half[self._places]
        self._mean += (on_grid @ whitened).T
        self._variance -= np.einsum("imk,imk->mi", on_grid, on_grid)
        alone = whitened @ inverse_root
        precision = np.einsum("ki,ki->i", inverse_root, inverse_root)
        return InnovationStatistics(
            observed=observed.astype(np.float64),
            given_others=alone * alone / precision,
            joint=float(whitened @ whitened),
            log_variance=2.0 * float(np.sum(np.log(root[_DIAGONAL]))),
        )

    def distribution(
        self, stretch: Pose, degrees_of_freedom: float | None
    ) -> GaussianTrajectory:
        """Return a copy of the current distribution with σ scaled per output."""
        blocks = self._covariance[self._places[:, :, None], self._places[:, None, :]]
        basis = self._prior.basis
        rates = basis.matrix(self.grid) @ basis.differentiate(self._table)
        slopes = _curves(rates)
        spread = np.sqrt(self.variance())
        smooth_rate = 2.0 * np.sum(slopes @ blocks * self._curves, axis=2).T
        variance_rate = smooth_rate + self._white * rates[:, 6:12]
        state = self._state[self._places]
        return GaussianTrajectory(
            times=self.grid,
            mean=self._mean,
            std=stretch * spread,
            mean_rate=self._rows[:, 12:18] + np.einsum("imr,ir->mi", slopes, state),
            std_rate=stretch * variance_rate / (2.0 * spread),
            covariance_function=partial(
                _covariance_on_grid, self._curves, blocks, spread**2, stretch
            ),
            degrees_of_freedom=degrees_of_freedom,
        )


def _covariance_on_grid(
    curves: Float[np.ndarray, "6 M R"],
    covariance: Float[np.ndarray, "6 R R"],
    variance: Outputs,
    stretch: Pose,
) -> Covariances:
    """Return the covariance over time of smooth and white part together."""
    full: np.ndarray = curves @ covariance @ np.swapaxes(curves, 1, 2)
    diagonal = np.arange(full.shape[1])
    full[:, diagonal, diagonal] = variance.T
    return np.asarray(stretch[:, None, None] ** 2 * full)
