"""Distributions over poses along the task, and via-points."""

import csv
import math
from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, partial
from numbers import Real
from pathlib import Path
from typing import Final

import numpy as np
import scipy

from gplfd_policies.arrays.records import freeze, read_only, short_repr
from gplfd_policies.arrays.resolution import FINEST
from gplfd_policies.arrays.shapes import (
    Bool,
    Covariances,
    Float,
    Int,
    Outputs,
    Pose,
    Times,
)
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.demonstrations.path_similarity import SizePosterior

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
        raise ValueError(
            f"predict needs a list of finite phases, at least one; got {times}."
        )
    return times


@dataclass(frozen=True, kw_only=True)
class GaussianTrajectory:
    """A Gaussian distribution over poses at M times, outputs independent.

    Units: times in phase, poses in metres and radians (task frame), rates per unit
    phase.
    """

    times: Times
    """Phases."""
    mean: Outputs
    """Mean pose."""
    std: Outputs
    """Standard deviation of a repetition of the task: the uncertainty of the mean and
    the spread r(t) of the demonstrations together (Eq. 11 of arXiv:2002.09979)."""
    mean_rate: Outputs
    """Derivative of the mean."""
    std_rate: Outputs
    """Derivative of the standard deviation."""
    covariance_function: Callable[[], np.ndarray] = field(repr=False)
    """Function that computes `covariance`, which few callers need."""
    degrees_of_freedom: float | None = None
    """Degrees of freedom of `std`, for Student-t quantiles; None means normal."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        freeze(self, *_ARRAYS)

    @classmethod
    def from_moments(
        cls,
        times: Times,
        mean: Outputs,
        std: Outputs,
        covariance_function: Callable[[], np.ndarray],
    ) -> "GaussianTrajectory":
        """Return a distribution whose rates are central differences of its moments.

        For methods without derivatives, at increasing times; std is NaN for a method
        without standard deviations. A single time has rate zero.
        """
        if (np.diff(times) <= 0.0).any():
            raise ValueError(
                "rates are differences, which need strictly increasing phases; got "
                f"{times}."
            )

        def rate(curve: np.ndarray) -> np.ndarray:
            if len(times) < 2:
                return np.zeros_like(curve)
            gradient: np.ndarray = np.gradient(curve, times, axis=0)
            return gradient

        return cls(
            times=times,
            mean=mean,
            std=std,
            mean_rate=rate(mean),
            std_rate=rate(std),
            covariance_function=covariance_function,
        )

    @cached_property
    def covariance(self) -> Covariances:
        """Covariance over time of every output; computed on first use."""
        return read_only(self.covariance_function())

    def __getitem__(
        self, rows: slice | Int[np.ndarray, " N"] | Bool[np.ndarray, " M"]
    ) -> "GaussianTrajectory":
        """Return the same distribution at some of its times."""
        return replace(
            self,
            **{name: getattr(self, name)[rows] for name in _ARRAYS},
            covariance_function=partial(_covariance_between, self, rows),
        )

    def interval(self, level: float = 0.95) -> tuple[Outputs, Outputs]:
        """Lower and upper bound of the central interval that holds ``level``.

        Uses Student-t quantiles where `degrees_of_freedom` is given: with few
        demonstrations the spread itself is uncertain.

        Raises:
            ValueError: if ``level`` is not in (0, 1).
        """
        width = self._quantile(level) * self.std
        return self.mean - width, self.mean + width

    def inside(
        self,
        poses: Float[np.ndarray, "*K M 6"],
        level: float = 0.95,
        *,
        normal: bool = False,
    ) -> Bool[np.ndarray, "*K M 6"]:
        """Return which numbers of ``poses`` are inside their central intervals.

        The poses [m, rad] are observed at `times`. With ``normal`` the quantiles are
        normal for every method; those of `interval` account for few demonstrations.
        False where the standard deviation is NaN.
        """
        width = self._quantile(level, normal) * np.maximum(self.std, FINEST)
        return np.asarray(np.abs(poses - self.mean) <= width)

    def coverage(
        self,
        poses: Float[np.ndarray, "*K M 6"],
        level: float = 0.95,
        *,
        normal: bool = False,
    ) -> float:
        """Return the share of the numbers of ``poses`` that are `inside`.

        Arguments are as for `inside`. The share equals ``level`` if the distribution is
        right, and is NaN for a method without standard deviations. NaN is ignored.
        """
        if np.isnan(self.std).any():
            return np.nan
        return float(
            np.mean(self.inside(poses, level, normal=normal)[~np.isnan(poses)])
        )

    def nlpd(self, poses: Float[np.ndarray, "*K M 6"]) -> float:
        """Return the negative log predictive density per number: less is better.

        It is the mean of ½ log 2π + log σ + ½ ((y − μ)/σ)² over all numbers y of
        ``poses`` at `times` [m, rad], each with its own normal distribution. NaN in
        ``poses`` is ignored; without standard deviations the result is NaN.
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

    def samples(
        self, count: int, rng: np.random.Generator
    ) -> Float[np.ndarray, "S M 6"]:
        """Draw ``count`` trajectories, shape (count, M, 6)."""
        draws = np.empty((count, *self.mean.shape))
        for output, covariance in enumerate(self.covariance):
            # Smooth trajectories have singular covariances: eigenvalues, not Cholesky.
            values, vectors = np.linalg.eigh(covariance)
            root = vectors * np.sqrt(np.maximum(values, 0.0))
            normal = rng.standard_normal((count, len(values)))
            draws[:, :, output] = self.mean[:, output] + normal @ root.T
        return draws

    def to_csv(self, path: str | Path, *, duration: float) -> None:
        """Write the trajectory to a table for a robot, complete or absent.

        `CSV_COLUMNS` are its columns; the lines before the table state the frame. There
        is one row per time, so predict at the times that the robot needs::

            times = np.arange(0.0, duration, 0.01)
            skill.predict(times / duration).to_csv("opening.csv", duration=duration)

        Args:
            path: file to write; an existing one is replaced.
            duration: duration of phases 0 to 1 [s], such as ``skill.duration``.

        Raises:
            ValueError: if the duration is not positive and finite, the times do not
                increase, or a pose is not finite.
        """
        if not 0.0 < duration < np.inf:
            raise ValueError(
                f"duration must be positive and finite [s], got {duration}."
            )
        times, poses = duration * self.times, self.mean
        if not (np.diff(times) > 0.0).all():
            raise ValueError(
                f"the times of a table must increase strictly, got {times}"
            )
        if not np.isfinite(poses).all():
            raise ValueError(
                "the poses of a table must be finite; found NaN or infinity"
            )
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


def _covariance_between(
    trajectory: GaussianTrajectory, rows: slice | np.ndarray
) -> Float[np.ndarray, "6 N N"]:
    """Covariance between some of the times of a trajectory."""
    between: np.ndarray = trajectory.covariance[:, rows][:, :, rows]
    return between


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
    """Pose (x, y, z, θu_x, θu_y, θu_z) in the task frame [m, rad]; NaN for
    unconstrained outputs."""
    std: float | Pose = 1e-3
    """Standard deviation of the via-point [m, rad], one number or one per output: a
    small one is strong. Infinity for unconstrained outputs."""
    along: float | Pose = 0.0
    """Signed effect on each output [m, rad] of one standard deviation of an error that
    all outputs share. If the phase of an observation has the standard deviation σ_s, it
    is dμ/ds σ_s: the pose may be displaced along the path."""
    sizes: SizePosterior | None = None
    """Estimate of size and heading from the path so far, if known."""

    def __post_init__(self) -> None:
        if not (isinstance(self.phase, Real) and math.isfinite(self.phase)):
            raise ValueError(
                f"The phase of a via-point must be a finite number, got {self.phase!r}."
            )
        pose = read_only(self.pose)
        if pose.shape != (6,):
            raise ValueError(
                "A via-point pose has six entries (x, y, z, θu_x, θu_y, θu_z), NaN for "
                f"outputs left free; got shape {pose.shape}."
            )
        if np.isinf(pose).any():
            raise ValueError(
                f"A via-point pose must be finite, or NaN for outputs left free; got "
                f"{pose}."
            )
        std = _of_outputs("std", self.std)
        if not (std >= 0.0).all():
            raise ValueError(f"Via-point standard deviations must be >= 0, got {std}.")
        along = _of_outputs("along", self.along)
        if not np.isfinite(along).all():
            raise ValueError(
                f"A via-point's error along the path must be finite, got {along}."
            )
        object.__setattr__(self, "pose", pose)
        object.__setattr__(self, "std", std)
        object.__setattr__(self, "along", along)

    @property
    def own_variance(self) -> Pose:
        """σ_v² of every output; infinite for unconstrained outputs."""
        std = np.asarray(self.std)
        variance: np.ndarray = np.where(np.isnan(self.pose), np.inf, std) ** 2
        return variance

    @property
    def noise_variance(self) -> Pose:
        """Total variance of each output's error, if outputs are treated separately."""
        return np.asarray(self.own_variance + np.asarray(self.along) ** 2)


def _of_outputs(name: str, value: float | Pose) -> Pose:
    """Return one number per output."""
    numbers = np.asarray(value)
    if numbers.shape not in ((), (1,), (6,)):
        raise ValueError(
            f"ViaPoint.{name} must be one number or six [m, rad], one per output; got "
            f"shape {numbers.shape}."
        )
    return read_only(np.broadcast_to(numbers, (6,)))
