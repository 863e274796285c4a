"""A movement on a grid of phases, with fast look-up and adaptation in place."""

import copy
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Any, Final

import numpy as np

from gplfd_policies.adaptation import begin_adaptation
from gplfd_policies.adaptation.similarity import SimilarityAdaptation, forecast
from gplfd_policies.arrays.rows import ALL_ROWS, Numbers, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Float, Outputs, Vectors
from gplfd_policies.movements.movement import (
    Adaptation,
    AdaptationForm,
    GaussianTrajectory,
    Movement,
    ViaPoint,
)

LOOK_AHEAD: Final = 0.05
"""Length of the chord that defines the direction of the path, in phase."""
_AT_ONCE: Final = 16  # number of adaptations whose arrays stay in a core's cache


class GriddedMovement:
    """A movement under one form of adaptation, on a uniform grid of phases.

    Between grid points mean and σ are linear. The form None does not adapt.
    """

    def __init__(
        self, movement: Movement, form: AdaptationForm | None, n_grid: int
    ) -> None:
        if n_grid < 2:
            raise ValueError(f"n_grid must be at least 2, got {n_grid}")
        self.learned, self.n_grid = movement, n_grid
        self._grid = np.linspace(0.0, 1.0, n_grid)
        # A copy, because other predictions change what a movement keeps for the next.
        self._unadapted = copy.deepcopy(begin_adaptation(movement, form, self._grid))
        self.distribution, self._fresh, self._seen = self._unadapted, False, 0.0

    def __deepcopy__(self, memo: dict[int, Any]) -> "GriddedMovement":
        other = copy.copy(self)  # It shares what never changes, up to some megabytes.
        if self.distribution is not self._unadapted:
            other.distribution = copy.deepcopy(self.distribution, memo)
        return other

    def reset(self) -> None:
        """Forget every via-point."""
        if not self._fresh:  # A copy takes a tenth of the time of a new computation.
            self.distribution = copy.deepcopy(self._unadapted)
            self._fresh, self._seen = True, 0.0

    def adapted_at(self, phase: float) -> Adaptation:
        """Return the distribution, which is about to see a via-point at a phase."""
        if self.distribution is self._unadapted:
            self.reset()
        self._fresh, self._seen = False, max(self._seen, float(phase))
        return self.distribution

    def trajectory(self) -> GaussianTrajectory:
        """Return the current distribution over the whole task."""
        adapted, drift = self.distribution.trajectory(), self.drift
        if not drift.any():
            return adapted[:]  # a copy, as users may write into it
        std = np.hypot(adapted.std, drift)
        rate = adapted.std * adapted.std_rate + drift * self.learned.aligned.drift
        return replace(
            adapted,
            std=std,
            std_rate=np.divide(rate, std, where=std > 0.0, out=adapted.std_rate.copy()),
            covariance_function=partial(_drifting, adapted, drift),
        )

    @property
    def drift(self) -> Outputs:
        """Error of the extrapolation beyond the seen phases, added to σ [m, rad]."""
        aligned = self.learned.aligned
        unseen = np.maximum(self._grid - max(aligned.end, self._seen), 0.0)
        return np.asarray(unseen[:, None] * aligned.drift)


def _drifting(adapted: GaussianTrajectory, drift: Outputs) -> np.ndarray:
    """Return the covariance with a drift, which is one error at all phases."""
    return np.asarray(adapted.covariance + np.einsum("mi,ni->imn", drift, drift))


class GriddedMovements:
    """Movements on equal grids in one table, adapted in place: one, or one per row."""

    def __init__(self, movements: GriddedMovement | Sequence[GriddedMovement]) -> None:
        alone = isinstance(movements, GriddedMovement)
        several = (movements,) if isinstance(movements, GriddedMovement) else movements
        self._movements = tuple(several)
        self._n_grid, count = self._movements[0].n_grid, len(self._movements)
        shape = () if alone else (count,)
        durations = [movement.learned.duration for movement in self._movements]
        self.durations = np.reshape(durations, shape)  # duration of each row's task [s]
        self.numbers = np.reshape(np.arange(count), shape)
        # The last grid point is stored twice: it also has a right neighbour.
        self._first_row = self.numbers * (self._n_grid + 1)
        self._table = np.empty((count * (self._n_grid + 1), 13))
        for member in range(count):
            self._renew(member)

    def demonstrated(self) -> list[Float[np.ndarray, "K M 6"]]:
        """Return the poses from which each movement was learned."""
        return [m.learned.aligned.demonstrated.poses for m in self._movements]

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget the via-points of these rows."""
        for member in np.ravel(self.numbers[rows]).tolist():
            self._movements[member].reset()
            self._renew(member)

    def observe(self, members: Sequence[int], via_points: Sequence[ViaPoint]) -> None:
        """Condition the movements of some members on a via-point each."""
        together: list[SimilarityAdaptation] = []
        for member, via_point in zip(members, via_points, strict=True):
            distribution = self._movements[member].adapted_at(via_point.phase)
            if isinstance(distribution, SimilarityAdaptation):
                distribution.filter(via_point)
                together.append(distribution)
            else:
                distribution.observe(via_point)
        for begin in range(0, len(together), _AT_ONCE):
            forecast(together[begin : begin + _AT_ONCE])
        for member in members:
            self._renew(member)

    def at(
        self, phases: Float[Numbers, "*S"], rows: Rows = ALL_ROWS
    ) -> Float[np.ndarray, "*S 13"]:
        """Return six means and six standard deviations at one phase per row [m, rad].

        The last number is the covariance of x and z [m²]; phases are in [0, 1].
        """
        position = phases * (self._n_grid - 1)
        left = position.astype(np.int64)
        share = np.asarray(position - left)[..., None]
        row, table = self._first_row[rows] + left, self._table
        values: np.ndarray = (1.0 - share) * table.take(row, 0)
        values += share * table.take(row + 1, 0)
        return values

    def ahead(
        self, phases: PerRow, rows: Rows = ALL_ROWS
    ) -> tuple[Axes, Axes, Vectors]:
        """Return mean and σ [m, rad], and the chord of the path ahead [m]."""
        end = np.minimum(phases + LOOK_AHEAD, 1.0)
        here, begin, end = self.at(np.array([phases, end - LOOK_AHEAD, end]), rows)
        return here[..., :6], here[..., 6:12], end[..., :3] - begin[..., :3]

    def geared(self, poses: Axes, power: int, rows: Rows = ALL_ROWS) -> Axes:
        """Return hand poses for poses of the movements, or with power -1 the reverse.

        Here they are identical.
        """
        return poses

    def _renew(self, member: int) -> None:
        movement = self._movements[member]
        distribution, drift = movement.distribution, movement.drift
        part = self._table.reshape(-1, self._n_grid + 1, 13)[member]
        part[:-1, :6] = distribution.mean
        part[:-1, 6:12] = np.sqrt(distribution.std**2 + drift**2)
        part[:-1, 12] = 0.0
        if isinstance(distribution, SimilarityAdaptation):
            part[:-1, 12] = distribution.horizontal_covariance
        part[-1] = part[-2]
