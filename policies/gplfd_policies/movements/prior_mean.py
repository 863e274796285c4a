"""What is known of a movement before any demonstration: a prior mean.

The m(t) of Eq. (1) in Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, where it is zero for want of knowledge.
`gplfd_policies.movements.residual` learns around it.
"""

from dataclasses import dataclass
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float
from scipy.interpolate import PchipInterpolator

from gplfd_policies.arrays.records import freeze, short_repr


@runtime_checkable
class PriorMean(Protocol):
    """Poses that are expected where nothing was demonstrated.

    Phases are those of the aligned demonstrations, 0 at their start and 1 at their end;
    methods that go on beyond it (`gplfd_policies.registry.method.Method.beyond`) also
    ask for later ones. Rotation vectors are on the same branch as theirs.
    """

    def mean(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Poses [m, rad] at phases, task frame."""
        ...

    def rate(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Their derivative, per unit phase."""
        ...


@dataclass(frozen=True, kw_only=True)
class PosePath:
    """A prior mean through given poses; read-only.

    Between them each output follows a cubic without overshoot: it never leaves the
    range of its two neighbours. Before the first and after the last it stays there.
    The mean of other demonstrations is one with ``PosePath(phases=aligned.times,
    poses=aligned.poses.mean(axis=0))``.

    Raises:
        ValueError: If a shape is wrong, an entry is not finite, or the phases do not
            increase strictly.
    """

    phases: Float[np.ndarray, " N"]
    """At least two phases, strictly increasing; may lie outside [0, 1]."""
    poses: Float[np.ndarray, "N 6"]
    """Pose at each of them [m, rad], task frame."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        freeze(self, "phases", "poses")
        phases, poses = self.phases, self.poses
        if phases.ndim != 1 or phases.size < 2 or poses.shape != (phases.size, 6):
            raise ValueError(
                "a path needs phases of shape (N,) and poses of shape (N, 6), N at "
                f"least 2; got {phases.shape} and {poses.shape}"
            )
        if not (np.isfinite(phases).all() and np.isfinite(poses).all()):
            raise ValueError("phases and poses of a path must be finite")
        if np.any(np.diff(phases) <= 0.0):
            raise ValueError(f"phases of a path must increase strictly, got {phases}")

    @cached_property
    def _curve(self) -> PchipInterpolator:
        return PchipInterpolator(self.phases, self.poses, axis=0)

    def mean(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Poses [m, rad] at phases."""
        within = np.clip(times, self.phases[0], self.phases[-1])
        poses: np.ndarray = self._curve(within)
        return poses

    def rate(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Derivative of the poses, per unit phase; zero beyond the ends."""
        within = (times >= self.phases[0]) & (times <= self.phases[-1])
        rate: np.ndarray = np.where(within[:, None], self._curve(times, nu=1), 0.0)
        return rate


@dataclass(frozen=True, kw_only=True)
class Stretched:
    """A prior mean of a task that is longer by a factor: phase s is its s × factor."""

    of: PriorMean
    """The prior mean of the shorter task."""
    factor: float
    """How much longer the task is, as durations are compared."""

    def mean(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Poses [m, rad] at phases of the longer task."""
        return self.of.mean(self.factor * times)

    def rate(self, times: Float[np.ndarray, " M"]) -> Float[np.ndarray, "M 6"]:
        """Derivative of the poses, per unit phase of the longer task."""
        return self.factor * self.of.rate(self.factor * times)
