"""Expected force of the hand, from demonstrations and from this door so far.

The demonstrated force is a movement like that of the poses
(`gplfd_policies.movements.movement.LearnedMovement.forces`). The force that a robot
measures on its way through a door is a via-point of it: the mean since the last
via-point, because friction and sensors vary faster than the phase. The force is
conditioned one control step after the via-point, because the step of the via-point
already adapts the path, and two adaptations in one step would take too long.
"""

import math
from dataclasses import dataclass

import numpy as np

from gplfd_policies.adaptation.gridded import LOOK_AHEAD, GriddedMovements
from gplfd_policies.arrays.rows import ALL_ROWS, PerRow, Rows
from gplfd_policies.arrays.shapes import Axes, Bool, Float, Vectors
from gplfd_policies.control.frame import product
from gplfd_policies.movements.movement import ViaPoint


@dataclass(frozen=True, kw_only=True, slots=True)
class ExpectedForce:
    """Expected force of some hands on what they hold."""

    mean: Vectors
    """Mean force, in the axes of the hand [N]."""
    std: Vectors
    """Standard deviation along each of these axes [N]."""
    axes: Float[np.ndarray, "... 3 3"]
    """Axes of the hand, as columns in the task frame."""
    largest: PerRow | float = math.inf
    """Largest demonstrated force on the whole way [N]."""

    def along(
        self, directions: Float[np.ndarray, "... 3 D"]
    ) -> tuple[Float[np.ndarray, "... D"], Float[np.ndarray, "... D"]]:
        """Return mean and σ [N] along unit vectors, given as columns."""
        along = product(self.axes.swapaxes(-1, -2), directions)
        spread = along * self.std[..., None]
        variance = np.add.reduce(spread * spread, axis=-2)
        return np.add.reduce(along * self.mean[..., None], axis=-2), np.sqrt(variance)


class ForceForecast:
    """Predicts the forces of some hands, and learns from measured forces."""

    def __init__(
        self, movements: GriddedMovements, measurement_std: tuple[float, float]
    ) -> None:
        """Start from movements of wrenches, and σ of measured wrenches [N], [N m]."""
        self._movements = movements
        self._noise = np.repeat(measurement_std, 3)
        shape = movements.numbers.shape
        squares = [wrenches[..., :3] ** 2 for wrenches in movements.demonstrated()]
        largest = [float(np.sqrt(square.sum(axis=-1).max())) for square in squares]
        self._largest = np.reshape(largest, shape)
        # Measured since the last via-point: sum and number.
        self._sum, self._count = np.zeros((*shape, 6)), np.zeros(shape)
        # Rows to be conditioned before the next prediction, and their phases.
        self._due, self._phases = np.zeros(shape, dtype=bool), np.zeros(shape)

    def reset(self, rows: Rows = ALL_ROWS) -> None:
        """Forget these rows' doors."""
        self._movements.reset(rows)
        self._sum[rows] = 0.0
        self._count[rows] = 0.0
        self._due[rows] = False

    def expect(
        self,
        phases: PerRow,
        axes: Float[np.ndarray, "... 3 3"],
        rows: Rows = ALL_ROWS,
    ) -> tuple[ExpectedForce, ExpectedForce]:
        """Return the expected forces at phases, and at the end of the path ahead.

        The axes of the hands are columns in the task frame.
        """
        if self._due[rows].any():
            self._condition(rows)
        ends = np.minimum(np.array([phases, phases + LOOK_AHEAD]), 1.0)
        means, stds = self._movements.at(ends, rows)
        largest = self._largest[rows]
        here, ahead = (
            ExpectedForce(mean=mean, std=std, axes=axes, largest=largest)
            for mean, std in zip(means[..., :3], stds[..., :3], strict=True)
        )
        return here, ahead

    def measure(
        self,
        wrenches: Axes,
        axes: Float[np.ndarray, "... 3 3"],
        rows: Rows = ALL_ROWS,
    ) -> None:
        """Add measured wrenches on the hands, task frame [N, N m]."""
        apart = np.stack([wrenches[..., :3], wrenches[..., 3:]], axis=-1)
        # Wrench of the hand on what it holds, in the axes of the hand.
        forces = product(axes.swapaxes(-1, -2), -apart).swapaxes(-1, -2)
        self._sum[rows] += forces.reshape(wrenches.shape)
        self._count[rows] += 1.0

    def learn(
        self,
        due: Bool[np.ndarray | np.bool_, "*N"],
        phases: PerRow,
        rows: Rows = ALL_ROWS,
    ) -> None:
        """Schedule rows that are due to learn the mean measured since last time.

        The force is conditioned on it, at these phases, before the next prediction.
        """
        self._due[rows] = due
        self._phases[rows] = phases

    def _condition(self, rows: Rows) -> None:
        due, total, count = self._due[rows], self._sum[rows], self._count[rows]
        for number, phase, mean in zip(
            self._movements.numbers[rows][due].tolist(),
            np.asarray(self._phases[rows])[due].tolist(),
            total[due] / np.asarray(count)[due][:, None],
            strict=True,
        ):
            via_point = ViaPoint(phase=phase, pose=mean, std=self._noise)
            self._movements.observe(number, via_point)
        self._sum[rows] = np.where(np.asarray(due)[..., None], 0.0, total)
        self._count[rows] = np.where(due, 0.0, count)
        self._due[rows] = False
