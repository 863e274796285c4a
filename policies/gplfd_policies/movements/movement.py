"""The interface of learned movements, and base classes for implementations.

Movements are `gplfd_policies.movements.skill.Skill` and the baselines. They predict a
distribution over poses at any phase; most of them adapt to via-points.
"""

from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields
from functools import partial
from typing import Any, Protocol, runtime_checkable

import numpy as np

from gplfd_policies.arrays.records import freeze
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.arrays.shapes import Covariances, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.movements.trajectory import (
    GaussianTrajectory,
    ViaPoint,
    checked_times,
)

Moments = tuple[Outputs, Outputs]
"""Mean and standard deviation at M phases, or mean and variance."""


@runtime_checkable
class Predictor(Protocol):
    """Something that predicts a distribution over poses."""

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at phases ``times``; std is NaN if the method has none."""


@runtime_checkable
class Movement(Predictor, Protocol):
    """A movement learned from aligned demonstrations."""

    @property
    def aligned(self) -> AlignedDemonstrations:
        """The demonstrations it was learned from."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]."""


@runtime_checkable
class Adaptable(Movement, Protocol):
    """A movement with its own conditioning on via-points."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> Predictor:
        """Return the movement conditioned on all ``via_points``."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LearnedMovement:
    """Base class of movements, with their demonstrations."""

    aligned: AlignedDemonstrations
    """The demonstrations it was learned from."""
    forces: Movement | None = None
    """Movement learned from the demonstrated forces, over the same phases. Its six
    outputs are force and moment of the hand on what it holds, in the axes of the hand
    [N, N m]. None without forces."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]; divide rates by it for rates per s."""
        return self.aligned.duration

    def __post_init__(self) -> None:
        arrays = (field.name for field in fields(self))
        freeze(self, *(n for n in arrays if isinstance(getattr(self, n), np.ndarray)))

    def __repr__(self) -> str:
        """Return the method and its demonstrations in one line."""
        count, phases, _ = self.aligned.poses.shape
        lasting = f"{self.duration * self.aligned.end:.3g} s"
        if self.aligned.end < 1.0:
            lasting += f", continued to {self.duration:.3g} s"
        return (
            f"{type(self).__name__}({count} demonstrations, {phases} phases, {lasting})"
        )


class MomentMovement(LearnedMovement, ABC):
    """A movement whose rates are finite differences of its moments."""

    @abstractmethod
    def _moments(self, times: Times) -> Moments:
        """Mean and standard deviation of a repetition of the task [m, rad]."""

    @abstractmethod
    def _covariance(self, times: Times) -> Covariances:
        """Covariance over time of every output [m², rad²]."""

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution of the pose at phases ``times``, strictly increasing."""
        times = checked_times(times)
        mean, std = self._moments(times)
        covariance = partial(self._covariance, times)
        return GaussianTrajectory.from_moments(times, mean, std, covariance)


class EmpiricalDistribution:
    """Sample mean and sample standard deviation of aligned demonstrations, by phase.

    For methods without uncertainty. Between the phases of the alignment the
    demonstrations are interpolated linearly; for a single demonstration σ = 0.
    """

    def __init__(self, aligned: AlignedDemonstrations) -> None:
        self._aligned = aligned

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at phases ``times``; constant beyond the demonstrations."""
        phases, poses = self._aligned.times, self._aligned.poses
        curves = np.stack([interpolated(times, phases, pose) for pose in poses])
        deviations = curves - curves.mean(axis=0)
        root = deviations / np.sqrt(max(len(poses) - 1, 1))
        return GaussianTrajectory.from_moments(
            times=times,
            mean=curves.mean(axis=0),
            std=np.sqrt(np.sum(root**2, axis=0)),
            covariance_function=partial(np.einsum, "kmo,kno->omn", root, root),
        )


@runtime_checkable
class Adaptation(Protocol):
    """A distribution over poses on a fixed grid of M phases, updated online."""

    def observe(self, via_point: ViaPoint) -> None:
        """Condition on another via-point, in place."""

    @property
    def mean(self) -> Outputs:
        """Current mean on the grid [m, rad], read-only."""

    @property
    def std(self) -> Outputs:
        """Current standard deviation on the grid [m, rad]."""

    def trajectory(self) -> GaussianTrajectory:
        """The current distribution; later via-points do not change it."""


AdaptationForm = Callable[[Any, np.ndarray], Adaptation]
"""Starts the adaptation of a movement on a grid of phases (M,)."""
