"""Folds: left-out demonstrations, their phases, and learning from the others.

Learning uses neither poses nor timing of left-out demonstrations. By the completion
index, Eq. (16) of Arduengo et al., arXiv:2002.09979, a left-out pose belongs to the
phase at which the learned demonstrations had completed the same share of their paths.
"""

import math
import time
import warnings
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Final, Literal, TypeVar, get_args

import numpy as np
import scipy
from numpy.typing import NDArray

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_env.spatial.turns import accumulated_rotvecs
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import FINEST, interpolated
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.alignment import task_completion_index
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.movements.movement import GaussianTrajectory, Movement
from gplfd_policies.movements.prior_mean import PriorMean
from gplfd_policies.registry.method import Method, TrainingInput

_LOADED: Final = ("interpolate", "linalg", "ndimage", "optimize", "special")
"""Parts of SciPy that methods load on first use; loading is excluded from learning."""

ResultT = TypeVar("ResultT")

HeldOut = Literal["demonstration", "radius"]
"""Unit that a learning test leaves out, see `folds`."""
HELD_OUT: Final[tuple[HeldOut, ...]] = get_args(HeldOut)

# Weight of time in the completion index, which is constant while the hand rests, and
# ω₁ of Eq. (17), as in every policy's alignment.
_CLOCK_SHARE, _ROTATION_WEIGHT = 1e-6, 0.5


@dataclass(frozen=True, kw_only=True, slots=True)
class Fold:
    """Demonstrations for learning, and left-out demonstrations to predict."""

    training: tuple[Demonstration, ...]
    left_out: tuple[Demonstration, ...]


def by_door(
    demonstrations: Sequence[Demonstration], per_door: int
) -> list[Sequence[Demonstration]]:
    """Group demonstrations that come door after door."""
    starts = range(0, len(demonstrations), per_door)
    return [demonstrations[first : first + per_door] for first in starts]


def folds(
    doors: Sequence[Sequence[Demonstration]], held_out: str, seed: int
) -> tuple[Fold, ...]:
    """Split demonstrations into folds.

    * "demonstration": each of two folds leaves out one demonstration of another door.
      The seed selects them in turn, so that all are left out equally often.
    * "radius": one fold leaves out all demonstrations of the middle door, the other
      those of an outer door, in turn the smallest and the largest.
    """
    if held_out == "radius":
        outer = 0 if seed % 2 == 0 else len(doors) - 1
        places = [
            {(door, number) for number in range(len(doors[door]))}
            for door in (len(doors) // 2, outer)
        ]
    else:
        turns = (seed, seed + 1)
        chosen = [(turn % len(doors), turn // len(doors)) for turn in turns]
        places = [{(door, number % len(doors[door]))} for door, number in chosen]
    every = {
        (door, number): demonstration
        for door, demonstrations in enumerate(doors)
        for number, demonstration in enumerate(demonstrations)
    }
    return tuple(
        Fold(
            training=tuple(d for place, d in every.items() if place not in out),
            left_out=tuple(d for place, d in every.items() if place in out),
        )
        for out in places
    )


@dataclass(frozen=True, kw_only=True, slots=True)
class OnPhases:
    """A left-out demonstration on the phases of a movement."""

    phases: FloatArray
    """Phase of every sample, strictly increasing, (N,)."""
    poses: FloatArray
    """Its poses, (N, 6) [m, rad]."""
    moving: NDArray[np.bool_] = field(default_factory=lambda: np.ones(6, dtype=bool))
    """Outputs that move in this task, (6,); constant ones are not scored."""

    def scored(self, poses: FloatArray) -> FloatArray:
        """Return poses with NaN for constant outputs, (M, 6)."""
        return np.where(self.moving, poses, np.nan)

    def thinned(self, count: int) -> "OnPhases":
        """Return the demonstration at equal steps of its own time."""
        samples = np.arange(len(self.phases), dtype=np.float64)
        wanted = np.linspace(0.0, samples[-1], count)
        return OnPhases(
            phases=np.interp(wanted, samples, self.phases),
            poses=interpolated(wanted, samples, self.poses),
            moving=self.moving,
        )

    def at(self, phases: FloatArray) -> FloatArray:
        """Return its poses at phases of the movement, (M, 6)."""
        return interpolated(phases, self.phases, self.poses)


def aligned_to(
    demonstration: Demonstration, aligned: AlignedDemonstrations
) -> OnPhases:
    """Align a demonstration to others by its own completion index."""
    each = [_progress(aligned.times, poses) for poses in aligned.poses]
    learned = np.mean(each, axis=0)
    turned, _ = accumulated_rotvecs(demonstration.poses[:, 3:])  # as those learned
    poses = np.hstack([demonstration.poses[:, :3], turned])
    progress = _progress(demonstration.times, poses)
    return OnPhases(phases=np.interp(progress, learned, aligned.times), poses=poses)


def _progress(times: FloatArray, poses: FloatArray) -> FloatArray:
    """Completion from 0 to 1, strictly increasing, (N,)."""
    recorded = Demonstration(times=times, poses=poses)
    index, _ = task_completion_index(recorded, _ROTATION_WEIGHT)
    clock = (times - times[0]) / (times[-1] - times[0])
    return np.asarray((1.0 - _CLOCK_SHARE) * index + _CLOCK_SHARE * clock)


def learn(
    method: Method,
    demonstrations: Sequence[Demonstration],
    seed: int,
    prior: PriorMean | None = None,
) -> tuple[Movement, float]:
    """Learn, and return the movement and the CPU time of this thread [s].

    The time includes alignment and a first prediction, to which some methods defer
    work. There are no warnings of few or noisy demonstrations.
    """
    training = TrainingInput(demonstrations=demonstrations, seed=seed, prior_mean=prior)
    for name in _LOADED:
        getattr(scipy, name)
    # Left-out demonstrations end at the end of the others.
    within = replace(method, pipeline=replace(method.pipeline, beyond=0.0))
    with warnings.catch_warnings(action="ignore", category=UserWarning):
        movement, learning_s = cpu_seconds(lambda: within.learn(training))
        _, prediction_s = cpu_seconds(lambda: movement.predict(np.array([0.0, 1.0])))
    return movement, learning_s + prediction_s


def cpu_seconds(action: Callable[[], ResultT]) -> tuple[ResultT, float]:
    """Return the result of an action and its CPU time in this thread [s]."""
    started = time.thread_time()
    result = action()
    return result, time.thread_time() - started


def rms_distance(poses: FloatArray, truth: FloatArray) -> float:
    """Root mean square of the distances between positions [m]; poses (M, 6)."""
    return root_mean_square(np.linalg.norm(poses[:, :3] - truth[:, :3], axis=1))


def rms_rotation(poses: FloatArray, truth: FloatArray) -> float:
    """Root mean square of the angles between orientations [rad], Eq. (18)."""
    return root_mean_square(rotation_distance(poses[:, 3:], truth[:, 3:]))


def root_mean_square(values: FloatArray | Sequence[float]) -> float:
    """Return the root of the mean of the squares."""
    return math.sqrt(float(np.mean(np.square(values))))


def spread_followed(std: FloatArray, poses: FloatArray) -> float | None:
    """Correlation of a standard deviation (M, 6) and demonstrations' spread (K, M, 6).

    It is computed from the logarithms over the phases and averaged over the outputs
    with a varying spread: 1 for a copy, 0 for a constant. None if the standard
    deviations are NaN, or if no spread varies.
    """
    spread = poses.std(axis=0, ddof=1)
    if not np.isfinite(std).all():
        return None
    logs = [np.log(np.maximum(values, FINEST)) for values in (std, spread)]
    got, true = (values - values.mean(axis=0) for values in logs)
    varies = np.sum(true**2, axis=0) > 0.0
    if not varies.any():
        return None
    scale = np.sqrt(np.sum(got**2, axis=0) * np.sum(true**2, axis=0))
    followed = np.sum(got * true, axis=0) / np.where(scale > 0.0, scale, 1.0)
    return float(np.mean(followed[varies]))


def accuracy(
    predicted: GaussianTrajectory, truth: FloatArray, scored: FloatArray | None = None
) -> Mapping[str, float | None]:
    """Score a prediction of poses (M, 6) [m, rad] that were left out.

    Quantiles are those of a normal distribution for every method. Density and coverage
    exclude numbers where ``scored`` is NaN.
    """
    scored = truth if scored is None else scored
    coverage = {
        f"coverage_{percent}": none_if_nan(
            predicted.coverage(scored, percent / 100, normal=True)
        )
        for percent in (50, 90, 95)
    }
    return {
        "rmse_position_m": rms_distance(predicted.mean, truth),
        "rmse_rotation_rad": rms_rotation(predicted.mean, truth),
        "nlpd": none_if_nan(predicted.nlpd(scored)),
        **coverage,
    }


def none_if_nan(number: float) -> float | None:
    """Return a number, or None for the NaN of a method without standard deviations."""
    return None if math.isnan(number) else number


def averaged(scores: Sequence[Mapping[str, float | None]]) -> dict[str, float | None]:
    """Average scores of the same names; None if all are missing.

    Errors, named ``rmse_...``, are averaged as squares.
    """
    means: dict[str, float | None] = {}
    for name in scores[0]:
        values = [value for score in scores if (value := score[name]) is not None]
        mean = root_mean_square if name.startswith("rmse_") else np.mean
        means[name] = float(mean(values)) if values else None
    return means
