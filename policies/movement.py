"""What every learned movement can be asked, whatever method learned it.

`policies.skill.Skill` and each baseline of Table 1 in Arduengo et al., *Gaussian-
Process-based Robot Learning from Demonstration*, arXiv:2002.09979, are movements: they
predict a distribution over poses at any phase, and adapt to via-points if they can.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from policies.aligned import AlignedDemonstrations
from policies.trajectory import GaussianTrajectory, ViaPoint

__all__ = [
    "Adaptable",
    "LearnedMovement",
    "Movement",
    "Predictor",
    "ReadaptedMovement",
    "adapted",
]


@runtime_checkable
class Predictor(Protocol):
    """Something that predicts a distribution over poses."""

    def predict(self, times: Float[np.ndarray, " M"]) -> GaussianTrajectory:
        """The distribution at phases ``times``; NaN std for a method without any."""
        ...


@runtime_checkable
class Movement(Predictor, Protocol):
    """A movement learned from aligned demonstrations."""

    @property
    def aligned(self) -> AlignedDemonstrations:
        """The demonstrations it was learned from."""
        ...

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]."""
        ...


@runtime_checkable
class Adaptable(Movement, Protocol):
    """A movement that can be conditioned on via-points."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> Predictor:
        """The movement conditioned on ``via_points``, all of them at once."""
        ...


def adapted(movement: Movement, via_points: Sequence[ViaPoint]) -> Predictor:
    """Return a movement conditioned on via-points.

    Raises:
        ValueError: The method has no via-points.
    """
    if isinstance(movement, Adaptable):
        return movement.adapt(via_points)
    raise ValueError(
        f"{type(movement).__name__} has no via-points: what it learned cannot be "
        "conditioned. Methods that have them: gp, gp-paper, promp, kmp, gmm-gp"
    )


@dataclass(frozen=True, kw_only=True, repr=False)
class LearnedMovement:
    """What movements of every method have from their demonstrations."""

    aligned: AlignedDemonstrations
    """The demonstrations it was learned from."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]; rates per second are rates / it."""
        return self.aligned.duration

    def __repr__(self) -> str:
        """Return the method and what it learned from, in one line."""
        count, phases, _ = self.aligned.poses.shape
        return (
            f"{type(self).__name__}({count} demonstrations, {phases} phases, "
            f"{self.duration:.3g} s)"
        )


class ReadaptedMovement:
    """Online adaptation of a movement that only adapts to all via-points at once.

    Every new via-point conditions the movement anew on all that were seen. The
    distribution on the grid is computed when it is next asked for.

    Args:
        movement: what was learned.
        grid: phases at which the distribution is reported, shape (M,).
    """

    def __init__(self, movement: Adaptable, grid: Float[np.ndarray, " M"]) -> None:
        self._movement = movement
        self._grid = grid
        self._via_points: list[ViaPoint] = []
        self._trajectory: GaussianTrajectory | None = movement.predict(grid)

    def observe(self, via_point: ViaPoint) -> None:
        """Take one more via-point."""
        self._via_points.append(via_point)
        self._trajectory = None

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """Current mean on the grid [m, rad]."""
        return self.trajectory().mean

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid [m, rad]."""
        return self.trajectory().std

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution on the grid."""
        if self._trajectory is None:
            adapted = self._movement.adapt(tuple(self._via_points))
            self._trajectory = adapted.predict(self._grid)
        return self._trajectory
