"""The interface of learned movements: distributions over poses at any phase.

Movements are `gplfd_policies.movements.skill.Skill` and the baselines; most adapt.
"""

import csv
import math
import textwrap
from abc import ABC, abstractmethod
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, fields, replace
from functools import cached_property, partial
from numbers import Real
from pathlib import Path
from typing import Any, Final, Protocol, runtime_checkable

import numpy as np
import scipy

from gplfd_policies.arrays.records import FINEST, interpolated, own_arrays, short_repr
from gplfd_policies.arrays.shapes import Bool, Covariances, Float, Outputs, Pose, Times
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.path_similarity import SizePosterior

Moments = tuple[Outputs, Outputs]
"""Mean and standard deviation at M phases, or mean and variance."""
Poses = Float[np.ndarray, "*K M 6"]

CSV_COLUMNS: Final = (
    "time [s],x [m],y [m],z [m],qx,qy,qz,qw,std_x [m],std_y [m],std_z [m],"
    "std_rx [rad],std_ry [rad],std_rz [rad]"
)
"""First line of the table: quantities and their units."""

_CSV_HEADER: Final = """\
# A trajectory of the hand by gplfd, version 1.
# Frame: as demonstrated. On doors: origin at the closed handle, x pulls, y up, z = x
# cross y; orientations are relative to that of the hand at the closed door.
# qx, qy, qz, qw is a unit quaternion, the scalar last, its sign continuous in time.
# std_x to std_rz are standard deviations of a repetition of the task: of the position
# and of the rotation vector; nan where the method has none.
"""
"""Lines before the table."""


def checked_times(times: np.ndarray) -> Times:
    """Return the phases of a prediction as floats; raise if empty or not finite."""
    times = np.asarray(times, dtype=np.float64)
    if times.ndim != 1 or times.size == 0 or not np.isfinite(times).all():
        raise ValueError(f"predict needs finite phases, at least one: {times}")
    return times


@dataclass(frozen=True, kw_only=True)
class GaussianTrajectory:
    """A Gaussian distribution over poses at M phases, outputs independent.

    Poses are in the task frame [m, rad], rates per unit phase.
    """

    times: Times
    mean: Outputs
    std: Outputs
    """Standard deviation of a repetition: the uncertainty of the mean and the spread
    r(t) of the demonstrations together (Eq. 11 of arXiv:2002.09979)."""
    mean_rate: Outputs
    std_rate: Outputs
    covariance_function: Callable[[], np.ndarray] = field(repr=False)
    """Computes `covariance`, which few callers need."""
    degrees_of_freedom: float | None = None
    """Degrees of freedom of `std`, for Student-t quantiles; None means normal."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        own_arrays(self, *_ARRAYS)

    @classmethod
    def from_moments(
        cls,
        times: Times,
        mean: Outputs,
        std: Outputs,
        covariance_function: Callable[[], np.ndarray],
    ) -> "GaussianTrajectory":
        """Return a distribution whose rates are central differences of its moments.

        Times increase; std is NaN for a method without it. A single time has rate zero.
        """
        if (np.diff(times) <= 0.0).any():
            raise ValueError(f"differences need strictly increasing phases: {times}")
        mean_rate, std_rate = (
            np.gradient(curve, times, axis=0)
            if len(times) > 1
            else np.zeros_like(curve)
            for curve in (mean, std)
        )
        return cls(
            times=times,
            mean=mean,
            std=std,
            mean_rate=mean_rate,
            std_rate=std_rate,
            covariance_function=covariance_function,
        )

    @cached_property
    def covariance(self) -> Covariances:
        """Covariance over time of every output; computed on first use."""
        return np.array(self.covariance_function(), dtype=np.float64, order="C")

    def __getitem__(self, rows: slice | np.ndarray) -> "GaussianTrajectory":
        """Return the same distribution at some of its times."""
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in _ARRAYS},
            covariance_function=partial(self._covariance_between, rows),
        )

    def _covariance_between(self, rows: slice | np.ndarray) -> np.ndarray:
        return self.covariance[:, rows][:, :, rows]

    def interval(self, level: float = 0.95) -> tuple[Outputs, Outputs]:
        """Return the bounds of the central intervals that hold ``level``, in (0, 1)."""
        width = self._quantile(level) * self.std
        return self.mean - width, self.mean + width

    def inside(
        self, poses: Poses, level: float = 0.95, *, normal: bool = False
    ) -> Bool[np.ndarray, "*K M 6"]:
        """Return which numbers of ``poses`` are inside their central intervals.

        The poses [m, rad] are observed at `times`. With ``normal`` the quantiles are
        normal for every method. False where the standard deviation is NaN.
        """
        width = self._quantile(level, normal) * np.maximum(self.std, FINEST)
        return np.asarray(np.abs(poses - self.mean) <= width)

    def coverage(
        self, poses: Poses, level: float = 0.95, *, normal: bool = False
    ) -> float:
        """Return the share of the numbers of ``poses`` that are `inside`.

        It equals ``level`` if the distribution is right, and is NaN for a method
        without standard deviations. NaN in the poses is ignored.
        """
        if np.isnan(self.std).any():
            return np.nan
        inside = self.inside(poses, level, normal=normal)
        return float(np.mean(inside[~np.isnan(poses)]))

    def nlpd(self, poses: Poses) -> float:
        """Return the negative log predictive density per number: less is better.

        It is the mean of ½ log 2π + log σ + ½ ((y − μ)/σ)² over all numbers y of
        ``poses`` at `times` [m, rad] but NaN; NaN without standard deviations.
        """
        std = np.maximum(self.std, FINEST)
        error = (poses - self.mean) / std
        terms = 0.5 * np.log(2.0 * np.pi) + np.log(std) + 0.5 * error**2
        return float(np.mean(terms[~np.isnan(poses)]))

    def _quantile(self, level: float, normal: bool = False) -> float:
        """Return half of the width of an interval, in standard deviations."""
        if not 0.0 < level < 1.0:
            raise ValueError(f"level must be in (0, 1), got {level}.")
        upper = 0.5 * (1.0 + level)
        if normal or self.degrees_of_freedom is None:
            return float(scipy.special.ndtri(upper))
        return float(scipy.special.stdtrit(self.degrees_of_freedom, upper))

    def to_csv(self, path: str | Path, *, duration: float) -> None:
        """Write the trajectory to a table for a robot, complete or absent.

        Its columns are `CSV_COLUMNS`, its rows the times, so predict at the times that
        the robot needs. The duration is that of phases 0 to 1 [s]::

            times = np.arange(0.0, duration, 0.01)
            skill.predict(times / duration).to_csv("opening.csv", duration=duration)

        Raises:
            ValueError: A duration not above 0, a pose not finite, times not increasing.
        """
        if not 0.0 < duration < np.inf:
            raise ValueError(f"duration must be positive and finite [s]: {duration}")
        times, poses = duration * self.times, self.mean
        if not (np.diff(times) > 0.0).all():
            raise ValueError(f"the times of a table must increase strictly: {times}")
        if not np.isfinite(poses).all():
            raise ValueError("the poses of a table must be finite")
        rotvecs = poses[:, 3:]
        # As continuous as the rotation vectors, without comparing neighbouring samples.
        half = 0.5 * np.linalg.norm(rotvecs, axis=1, keepdims=True)
        quaternions = np.hstack([0.5 * np.sinc(half / math.pi) * rotvecs, np.cos(half)])
        table = np.hstack([times[:, None], poses[:, :3], quaternions, self.std])
        with (
            complete_or_absent(path) as temporary,
            temporary.open("w", encoding="utf-8", newline="") as file,
        ):
            file.write(f"{_CSV_HEADER}{CSV_COLUMNS}\n")
            csv.writer(file, lineterminator="\n").writerows(table.tolist())


_ARRAYS = ("times", "mean", "std", "mean_rate", "std_rate")


def white_covariance(variance: Outputs) -> Covariances:
    """Covariance over time of poses that deviate independently from time to time."""
    diagonal: np.ndarray = variance.T[:, :, None] * np.eye(len(variance))
    return diagonal


@dataclass(frozen=True, kw_only=True, slots=True)
class ViaPoint:
    """A pose to be reached at a phase, with its strength.

    Raises:
        ValueError: if the phase is not a finite number, the pose is infinite, or a
            noise is negative or not one number or six.
    """

    phase: float
    """Phase; the task runs from 0 to 1."""
    pose: Pose
    """Pose [m, rad] in the task frame; NaN for unconstrained outputs."""
    std: float | Pose = 1e-3
    """Standard deviation of the via-point [m, rad], one number or one per output: a
    small one is strong. Infinity for unconstrained outputs."""
    along: float | Pose = 0.0
    """Signed effect on each output [m, rad] of one standard deviation of an error that
    all outputs share: dμ/ds σ_s for a phase of the standard deviation σ_s."""
    sizes: SizePosterior | None = None
    """Estimate of size and heading from the path so far, if known."""

    def __post_init__(self) -> None:
        if not (isinstance(self.phase, Real) and math.isfinite(self.phase)):
            raise ValueError(
                f"The phase of a via-point must be a finite number, got {self.phase!r}."
            )
        pose = np.array(self.pose, dtype=np.float64)
        if pose.shape != (6,) or np.isinf(pose).any():
            raise ValueError(
                "A via-point pose has six finite entries (x, y, z, θu_x, θu_y, θu_z), "
                f"or NaN for outputs left free; got {pose} of shape {pose.shape}."
            )
        std, along = _of_outputs("std", self.std), _of_outputs("along", self.along)
        if not ((std >= 0.0).all() and np.isfinite(along).all()):
            raise ValueError(
                "A via-point's std must be >= 0 and its along finite, got "
                f"{std} and {along}."
            )
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "std", std)
        object.__setattr__(self, "along", along)

    @property
    def own_variance(self) -> Pose:
        """σ_v² of every output; infinite for unconstrained outputs."""
        std = np.asarray(self.std)
        return np.asarray(np.where(np.isnan(self.pose), np.inf, std) ** 2)

    @property
    def noise_variance(self) -> Pose:
        """Total variance of each output's error, if outputs are treated separately."""
        return np.asarray(self.own_variance + np.asarray(self.along) ** 2)


def _of_outputs(name: str, value: float | Pose) -> Pose:
    """Return one number per output."""
    numbers = np.asarray(value)
    if numbers.shape not in ((), (1,), (6,)):
        raise ValueError(
            f"ViaPoint.{name} must be one number or six [m, rad], got {numbers.shape}"
        )
    return np.full(6, numbers, dtype=np.float64)


@runtime_checkable
class Predictor(Protocol):
    """Something that predicts a distribution over poses."""

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at phases ``times``; std is NaN if the method has none."""


@runtime_checkable
class Movement(Predictor, Protocol):
    """Something that predicts, learned from aligned demonstrations."""

    @property
    def aligned(self) -> AlignedDemonstrations:
        """The demonstrations it was learned from."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]."""


@runtime_checkable
class Adaptable(Movement, Protocol):
    """A movement with its own conditioning on via-points."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> Movement:
        """Return the movement conditioned on further via-points."""


@dataclass(frozen=True, kw_only=True, repr=False)
class LearnedMovement:
    """Base class of movements, with their demonstrations."""

    aligned: AlignedDemonstrations
    """The demonstrations it was learned from."""
    forces: Movement | None = None
    """Movement learned from the demonstrated forces, over the same phases, if any. Its
    outputs are force and moment on what the hand holds, in the hand's axes [N, N m]."""

    @property
    def duration(self) -> float:
        """Nominal duration of phases 0 to 1 [s]; divide rates by it for rates per s."""
        return self.aligned.duration

    def __post_init__(self) -> None:
        for name in (entry.name for entry in fields(self)):
            if isinstance(getattr(self, name), np.ndarray):
                own_arrays(self, name)

    def __repr__(self) -> str:
        """Return the method and its demonstrations in one line."""
        count, phases, _ = self.aligned.poses.shape
        lasting = f"{self.duration * self.aligned.end:.3g} s"
        if self.aligned.end < 1.0:
            lasting += f", continued to {self.duration:.3g} s"
        name = type(self).__name__
        return f"{name}({count} demonstrations, {phases} phases, {lasting})"


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


@dataclass(frozen=True, kw_only=True, repr=False)
class EmpiricalDistribution(LearnedMovement):
    """Sample mean and sample standard deviation of aligned demonstrations, by phase.

    Between phases the demonstrations are interpolated. It is the learner that every
    other one has to beat, and stands in for methods without uncertainty.
    """

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at phases ``times``; constant beyond the demonstrations."""
        phases, poses = self.aligned.times, self.aligned.poses
        curves = np.stack([interpolated(times, phases, pose) for pose in poses])
        deviations = curves - curves.mean(axis=0)
        root = deviations / np.sqrt(max(len(poses) - 1, 1))
        return GaussianTrajectory.from_moments(
            times=times,
            mean=curves.mean(axis=0),
            std=np.sqrt(np.sum(root**2, axis=0)),
            covariance_function=partial(np.einsum, "kmo,kno->omn", root, root),
        )


@dataclass(frozen=True, kw_only=True, repr=False)
class FittedMovement(LearnedMovement):
    """What a user's learner has fitted, as a movement; made by `as_movement`."""

    predictor: Any

    def predict(self, times: Times) -> GaussianTrajectory:
        """The distribution at phases ``times``; raises ValueError without them."""
        prediction = self.predictor.predict(times)
        if isinstance(prediction, GaussianTrajectory):
            return prediction
        try:
            mean, std = (np.array(curves, dtype=float) for curves in prediction)
        except (TypeError, ValueError):
            mean = std = np.empty(0)
        shape = (len(times), 6)
        sound = mean.shape == std.shape == shape and np.isfinite(mean + std).all()
        if not sound or np.any(std < 0.0):
            raise ValueError(
                f"predict() of {type(self.predictor).__name__} must return a "
                f"GaussianTrajectory, or mean and standard deviation of shape {shape}, "
                f"finite, and no σ < 0; got {textwrap.shorten(repr(prediction), 80)}"
            )
        covariance = partial(white_covariance, std**2)
        return GaussianTrajectory.from_moments(times, mean, std, covariance)


class AdaptableFit(FittedMovement):
    """What a user's learner has fitted, with ``adapt``; made by `as_movement`."""

    def adapt(self, via_points: Sequence[ViaPoint]) -> Movement:
        """Return the movement conditioned on further via-points."""
        return as_movement(self.predictor.adapt(via_points), self.aligned)


def as_movement(fitted: object, aligned: AlignedDemonstrations) -> Movement:
    """Return what a user's ``fit`` or ``adapt`` returned as a movement.

    Raises a ValueError if it has no method ``predict``.
    """
    if isinstance(fitted, Movement):
        return fitted
    if not callable(getattr(fitted, "predict", None)):
        raise ValueError(
            "fit() and adapt() of a learner must return an object with predict(phases),"
            f" not {textwrap.shorten(repr(fitted), 80)}"
        )
    adapts = callable(getattr(fitted, "adapt", None))
    kind = AdaptableFit if adapts else FittedMovement
    return kind(aligned=aligned, predictor=fitted)


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
