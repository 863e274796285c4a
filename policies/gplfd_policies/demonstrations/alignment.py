"""Temporal alignment: one clock for demonstrations of different timing.

Demonstrations are matched where the same part of the task is done, measured by the task
completion index of `gplfd_policies.demonstrations.completion`. Equation numbers refer
to Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Literal

import numpy as np
from jaxtyping import Float

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import pose_distance
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.completion import measure_completion, warn_of_noise
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.directions import corrected_completions
from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping
from gplfd_policies.demonstrations.rests import Rest, warn_of_rests, without_rests

_TIME_SHARE = 1e-6
"""Share of normalised time mixed into the completion: it orders the samples of a rest,
where completion stands still, and moves no other match by more than this."""


AlignmentMethod = Literal["interpolation", "directions", "dtw", "dtw-euclidean"]
"""Ways to match demonstrations, see `align`."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Course:
    """One demonstration on its own normalised clock, with its completion."""

    clock: Float[np.ndarray, " N"]
    """Time from 0 to 1."""
    poses: Float[np.ndarray, "N 6"]
    completion: Float[np.ndarray, " N"]


def align(
    demonstrations: Sequence[Demonstration],
    *,
    method: AlignmentMethod = "interpolation",
    n_samples: int = 200,
    rotation_weight: float = 0.5,
    denoise: bool = True,
    trim_rests: bool = True,
) -> AlignedDemonstrations:
    """Bring demonstrations of different timing onto one phase axis.

    * ``"interpolation"`` (default) inverts each completion index exactly. The phase at
      a given completion is the mean over the demonstrations of their normalised times
      there, so that the common timing (starting and stopping gently) survives.
    * ``"directions"`` does the same after completion was corrected so that the hands
      move in the same directions, see `gplfd_policies.demonstrations.directions`: for
      demonstrations from different starts, with stretches done twice, or with parts of
      other sizes.
    * ``"dtw"`` is the published method: dynamic time warping on |ζ_a - ζ_b| against the
      demonstration with the most samples, matches averaged per sample of it. Where ζ
      rises strictly, it finds the same matches to within half a sample, as a staircase.
    * ``"dtw-euclidean"`` warps on the distance of poses, Eq. (17). It mistakes
      intermediate points of a long path for the end of a short one (Fig. 3b), and is
      here for comparison.

    Args:
        demonstrations: At least one; lengths, rates and durations may differ freely.
        method: One of the above.
        n_samples: Number of equally spaced phases from 0 to 1.
        rotation_weight: ω₁ of Eq. (17), within [0, 1].
        denoise: Whether completion is measured on the denoised paths; the resulting
            poses are interpolated from the samples as recorded in any case.
        trim_rests: Whether stretches in which nothing moves are left out first, see
            `gplfd_policies.demonstrations.rests`. Kept, rests that all demonstrations
            make become rests of the result.

    Returns:
        The aligned demonstrations with the mean duration and each one's clock.

    Raises:
        ValueError: If an argument is not as described.

    Warns:
        UserWarning: If sensor noise makes a path more than 1.1 times as long, or rests
            were left out.
    """
    if method not in _METHODS:
        raise ValueError(f"method must be one of {sorted(_METHODS)}, got {method!r}")
    if n_samples < 2:
        raise ValueError(f"n_samples must be at least 2, got {n_samples}")
    if not demonstrations:
        raise ValueError("at least one demonstration is needed, got none")
    rests: tuple[tuple[Rest, ...], ...] = ()
    if trim_rests:
        recorded = demonstrations
        demonstrations, rests = zip(*map(without_rests, recorded), strict=True)
        warn_of_rests(recorded, rests)
    completions = [
        measure_completion(demo, rotation_weight, denoise) for demo in demonstrations
    ]
    warn_of_noise(completions, denoise)
    start = demonstrations[0].poses[0]
    courses = [
        _course(demo, completion.index, start)
        for demo, completion in zip(demonstrations, completions, strict=True)
    ]
    phases = np.linspace(0.0, 1.0, n_samples)
    poses, clocks = _METHODS[method](courses, phases, rotation_weight)
    durations = [float(demo.times[-1] - demo.times[0]) for demo in demonstrations]
    return AlignedDemonstrations(
        times=phases,
        poses=poses,
        duration=float(np.mean(durations)),
        rests=rests,
        clocks=clocks,
    )


def _course(
    demonstration: Demonstration,
    completion: Float[np.ndarray, " N"],
    start: Float[np.ndarray, " 6"],
) -> _Course:
    """Normalise time, and unwrap the rotations from the branch of `start`."""
    times, poses = demonstration.times, demonstration.poses
    clock = (times - times[0]) / (times[-1] - times[0])
    first = unwrap_rotvecs(np.stack([start[3:], poses[0, 3:]]))[1]
    if not np.array_equal(first, poses[0, 3:]):
        # A demonstration is continuous: where its first sample stays, all do.
        rotvecs = unwrap_rotvecs(np.vstack([first, poses[1:, 3:]]))
        poses = np.hstack([poses[:, :3], rotvecs])
    return _Course(clock=clock, poses=poses, completion=completion)


Matched = tuple[Float[np.ndarray, "K M 6"], Float[np.ndarray, "K M"]]
"""Poses of K courses at M phases, and their clocks there."""


def _by_completion(
    courses: Sequence[_Course], phases: Float[np.ndarray, " M"], rotation_weight: float
) -> Matched:
    """Match equal completion exactly, on the mean clock."""
    del rotation_weight  # already in the completion
    return _interpolated(courses, phases)


def _by_direction(
    courses: Sequence[_Course], phases: Float[np.ndarray, " M"], rotation_weight: float
) -> Matched:
    """Match completion that directions have corrected, on the mean clock."""
    corrected = corrected_completions(
        [_rising(course) for course in courses],
        [course.poses for course in courses],
        rotation_weight,
    )
    courses = [
        replace(course, completion=completion)
        for course, completion in zip(courses, corrected, strict=True)
    ]
    return _interpolated(courses, phases)


def _rising(course: _Course) -> Float[np.ndarray, " N"]:
    """Return the completion, rising also where nothing moves."""
    rising: np.ndarray = (
        1.0 - _TIME_SHARE
    ) * course.completion + _TIME_SHARE * course.clock
    return rising


def _interpolated(
    courses: Sequence[_Course], phases: Float[np.ndarray, " M"]
) -> Matched:
    """Return all courses where their completions are equal."""
    progress = [_rising(course) for course in courses]
    # Between these knots every clock is linear in progress, so their mean is too, and
    # inverting it by linear interpolation is exact.
    knots = np.unique(np.concatenate(progress))
    mean_clock = np.mean(
        [
            np.interp(knots, rising, course.clock)
            for rising, course in zip(progress, courses, strict=True)
        ],
        axis=0,
    )
    wanted = np.interp(phases, mean_clock, knots)
    clocks = [
        np.interp(wanted, rising, course.clock)
        for rising, course in zip(progress, courses, strict=True)
    ]
    poses = [
        _resampled(clock, course) for clock, course in zip(clocks, courses, strict=True)
    ]
    return np.stack(poses), np.stack(clocks)


def _resampled(
    clock: Float[np.ndarray, " M"], course: _Course
) -> Float[np.ndarray, "M 6"]:
    """Return the poses of a course at other times of its clock."""
    last = len(course.clock) - 2
    before = np.clip(np.searchsorted(course.clock, clock) - 1, 0, last)
    start, step = course.clock[before], np.diff(course.clock)[before]
    share = ((clock - start) / step)[:, None]
    resampled: np.ndarray = (1.0 - share) * course.poses[before]
    resampled += share * course.poses[before + 1]
    return resampled


def _warped(
    courses: Sequence[_Course],
    phases: Float[np.ndarray, " M"],
    cost_row: Callable[[_Course, int, _Course], Float[np.ndarray, " N"]],
) -> Matched:
    """Warp every course onto the one with the most samples; average its matches."""
    reference = max(courses, key=lambda course: len(course.clock))
    aligned, clocks = [], []
    for course in courses:
        if course is reference:
            # Matched with itself, every sample meets itself.
            aligned.append(_resampled(phases, course))
            clocks.append(phases)
            continue
        path = dynamic_time_warping(
            lambda row, course=course: cost_row(reference, row, course),  # type: ignore[misc]
            len(reference.clock),
        )
        matches = np.bincount(path.rows)
        means = [
            np.bincount(path.rows, weights=column[path.columns]) / matches
            for column in (course.clock, *course.poses.T)
        ]
        matched = _Course(
            clock=reference.clock,
            poses=np.column_stack(means[1:]),
            completion=reference.completion,
        )
        aligned.append(_resampled(phases, matched))
        clocks.append(np.interp(phases, reference.clock, means[0]))
    return np.stack(aligned), np.stack(clocks)


def _warped_by_completion(
    courses: Sequence[_Course], phases: Float[np.ndarray, " M"], rotation_weight: float
) -> Matched:
    """Warp with the cost |ζ_a - ζ_b|."""
    del rotation_weight  # already in the completion

    def cost_row(reference: _Course, row: int, other: _Course) -> np.ndarray:
        return np.asarray(np.abs(other.completion - reference.completion[row]))

    return _warped(courses, phases, cost_row)


def _warped_by_pose(
    courses: Sequence[_Course], phases: Float[np.ndarray, " M"], rotation_weight: float
) -> Matched:
    """Warp with the distance of poses, Eq. (17), as the cost."""

    def cost_row(reference: _Course, row: int, other: _Course) -> np.ndarray:
        return pose_distance(other.poses, reference.poses[row], rotation_weight)

    return _warped(courses, phases, cost_row)


_METHODS = {
    "interpolation": _by_completion,
    "directions": _by_direction,
    "dtw": _warped_by_completion,
    "dtw-euclidean": _warped_by_pose,
}
