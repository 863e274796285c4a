"""What every learned movement can be asked, whatever method learned it.

`gplfd_policies.movements.skill.Skill` and each baseline of Table 1 in Arduengo et al.,
*Gaussian- Process-based Robot Learning from Demonstration*, arXiv:2002.09979, are
movements: they predict a distribution over poses at any phase, and adapt to via-points
if they can.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from typing import Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from gplfd_policies.arrays.records import freeze
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.trajectory import GaussianTrajectory, ViaPoint


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
    """A movement that says itself how it is conditioned on via-points."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> Predictor:
        """The movement conditioned on ``via_points``, all of them at once."""
        ...


@dataclass(frozen=True, kw_only=True, repr=False)
class LearnedMovement:
    """What movements of every method have from their demonstrations."""

    aligned: AlignedDemonstrations
    """The demonstrations it was learned from."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]; rates per second are rates / it."""
        return self.aligned.duration

    def __post_init__(self) -> None:
        arrays = (each.name for each in fields(self))
        freeze(self, *(n for n in arrays if isinstance(getattr(self, n), np.ndarray)))

    def __repr__(self) -> str:
        """Return the method and what it learned from, in one line."""
        count, phases, _ = self.aligned.poses.shape
        lasting = f"{self.duration * self.aligned.end:.3g} s"
        if self.aligned.end < 1.0:
            lasting += f", continued to {self.duration:.3g} s"
        return (
            f"{type(self).__name__}({count} demonstrations, {phases} phases, {lasting})"
        )


@runtime_checkable
class Adaptation(Protocol):
    """A distribution over poses on a fixed grid of M phases, updated online."""

    def observe(self, via_point: ViaPoint) -> None:
        """Take one more via-point, in place."""
        ...

    @property
    def mean(self) -> Float[np.ndarray, "M 6"]:
        """Current mean on the grid [m, rad], read-only."""
        ...

    @property
    def std(self) -> Float[np.ndarray, "M 6"]:
        """Current standard deviation on the grid [m, rad]."""
        ...

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution; later via-points do not change it."""
        ...


AdaptationForm = Callable[[Any, np.ndarray], Adaptation]
"""Starts the adaptation of a movement on a grid of phases, shape (M,)."""
