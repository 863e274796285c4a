"""Gaussian conditioning of smooth processes, one via-point at a time.

A smooth process on an interval is a vector of q coefficients (`policies.gp.legendre`).
A via-point at *any* phase τ observes the functional a(τ)ᵀ w, so conditioning is a
rank-1 update of a q × q covariance, exact off the grid, and the grid on which mean and
variance are reported has no influence on them:

    g = C a(τ),  s = a(τ)ᵀ g + σ²,  w ← w + g (y − a(τ)ᵀ w) / s,  C ← C − g gᵀ / s.

``test_sequential_updates_equal_batch_conditioning`` settles it.
"""

from functools import partial

import numpy as np
from jaxtyping import Float

from policies.gp.legendre import LegendreBasis
from policies.trajectory import GaussianTrajectory

_STRONGEST = 1e-8
"""Least via-point variance, relative to the largest variance of the output. A via-point
is never trusted beyond 1e-4 of the demonstrated spread, so that σ_v = 0, repeated and
contradicting via-points have an answer: the average."""


def basis_for_grid(
    times: Float[np.ndarray, " N"],
    grid: Float[np.ndarray, " M"],
    shortest_scale: float,
) -> LegendreBasis:
    """A basis that covers the demonstrations and the grid.

    Raises:
        ValueError: if the grid is empty or not finite, or so much wider than the
            demonstrations that no basis represents the process on it.
    """
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


class ConditionedProcess:
    """Six independent processes on a grid, updated in place."""

    def __init__(
        self,
        basis: LegendreBasis,
        mean: Float[np.ndarray, "Q 6"],
        covariance: Float[np.ndarray, "6 Q Q"],
        log_white: Float[np.ndarray, "Q 6"],
        grid: Float[np.ndarray, " M"],
    ) -> None:
        """Start from the policy before any via-point.

        Args:
            basis: basis of all coefficients.
            mean: coefficients of the mean.
            covariance: covariance of the coefficients, per output.
            log_white: coefficients of the logarithm of the variance that is
                independent from sample to sample, which no via-point reduces.
            grid: phases at which mean and variance are reported, shape (M,).
        """
        self.grid = grid
        self._basis = basis
        self._weights = mean.T.copy()
        self._covariance = covariance.copy()
        self._log_white = log_white
        self._rows = basis.matrix(grid)
        self._row_phase, self._last_row = np.nan, np.empty(basis.size)
        self._mean = self._rows @ mean
        self._variance = np.stack(
            [np.sum(self._rows @ part * self._rows, axis=1) for part in covariance],
            axis=1,
        )
        self._white = np.exp(self._rows @ log_white)
        self._floor = _STRONGEST * np.max(self._variance + self._white, axis=0)

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """Current mean on the grid, a read-only view."""
        view: np.ndarray = self._mean.view()
        view.setflags(write=False)
        return view

    def variance(self) -> Float[np.ndarray, "M 6"]:
        """Current variance on the grid, white part included."""
        return np.asarray(np.maximum(self._variance, 0.0) + self._white)

    def white_at(self, phase: float) -> Float[np.ndarray, "6"]:
        """The white variance at any phase."""
        return np.asarray(np.exp(self._row(phase) @ self._log_white))

    def _row(self, phase: float) -> Float[np.ndarray, " Q"]:
        if not self._basis.start <= phase <= self._basis.stop:
            raise ValueError(
                f"The via-point's phase {phase} is outside the range "
                f"[{self._basis.start}, {self._basis.stop}] of demonstrations and "
                f"grid; clip it, or build the adaptation on a wider grid."
            )
        # Asked for twice per via-point: for its white variance, and to condition on it.
        if phase != self._row_phase:
            self._row_phase = phase
            self._last_row = self._basis.matrix(np.array([phase]))[0]
        return self._last_row

    def update(
        self,
        phase: float,
        pose: Float[np.ndarray, "6"],
        noise_variance: Float[np.ndarray, "6"],
    ) -> tuple[Float[np.ndarray, "6"], Float[np.ndarray, "6"]]:
        """Condition on a pose at a phase.

        Args:
            phase: any phase in the interval.
            pose: observed pose; ignored where its noise is infinite.
            noise_variance: variance of the observation, per output.

        Returns:
            Squared innovation over its variance per output, and 1 where an output was
            observed, else 0.

        Raises:
            ValueError: if the phase is outside the interval.
        """
        row = self._row(phase)
        gain = self._covariance @ row
        innovation_variance = gain @ row + np.maximum(noise_variance, self._floor)
        observed = np.isfinite(noise_variance)
        inverse = np.where(observed, 1.0 / innovation_variance, 0.0)
        innovation = np.where(observed, pose - self._weights @ row, 0.0)
        step = innovation * inverse
        self._weights += step[:, None] * gain
        half = np.sqrt(inverse)[:, None] * gain
        # `einsum` makes outer products in half of the time of `*`.
        self._covariance -= np.einsum("oi,oj->oij", half, half)
        on_grid = self._rows @ gain.T
        self._mean += on_grid * step
        self._variance -= on_grid**2 * inverse
        return innovation * step, observed.astype(np.float64)

    def distribution(
        self, stretch: Float[np.ndarray, "6"], degrees_of_freedom: float | None
    ) -> GaussianTrajectory:
        """The current distribution; later updates do not change it.

        Args:
            stretch: factor on every output's standard deviation.
            degrees_of_freedom: see `GaussianTrajectory`.
        """
        rows, covariance = self._rows, self._covariance.copy()
        slopes = rows @ self._basis.differentiate(np.eye(self._basis.size))
        spread = np.sqrt(self.variance())
        smooth_rate = np.stack(
            [2.0 * np.sum(slopes @ part * rows, axis=1) for part in covariance], axis=1
        )
        variance_rate = smooth_rate + self._white * (slopes @ self._log_white)
        return GaussianTrajectory(
            times=self.grid,
            mean=self._mean,
            std=stretch * spread,
            mean_rate=slopes @ self._weights.T,
            std_rate=stretch * variance_rate / (2.0 * spread),
            covariance_function=partial(
                _covariance_on_grid, rows, covariance, spread**2, stretch
            ),
            degrees_of_freedom=degrees_of_freedom,
        )


def _covariance_on_grid(
    rows: Float[np.ndarray, "M Q"],
    covariance: Float[np.ndarray, "6 Q Q"],
    variance: Float[np.ndarray, "M 6"],
    stretch: Float[np.ndarray, "6"],
) -> Float[np.ndarray, "6 M M"]:
    """Covariance over time of smooth and white part together."""
    full: np.ndarray = rows @ covariance @ rows.T
    diagonal = np.arange(len(rows))
    full[:, diagonal, diagonal] = variance.T
    return np.asarray(stretch[:, None, None] ** 2 * full)
