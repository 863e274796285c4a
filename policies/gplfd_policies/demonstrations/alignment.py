"""Temporal alignment of demonstrations with different timing.

Demonstrations are matched where the same share of the task is completed, by the task
completion index of `gplfd_policies.demonstrations.completion`. Equation numbers refer
to Arduengo et al., *Gaussian-Process-based Robot Learning from Demonstration*,
arXiv:2002.09979.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes, pose_distance
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.arrays.shapes import Float, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations
from gplfd_policies.demonstrations.completion import measure_completion, warn_of_noise
from gplfd_policies.demonstrations.demonstration import (
    Demonstration,
    checked_demonstrations,
)
from gplfd_policies.demonstrations.dynamic_time_warping import dynamic_time_warping
from gplfd_policies.demonstrations.rests import Rest, warn_of_rests, without_rests

_TIME_SHARE: Final = 1e-6
"""Share of normalised time added to the completion index: it orders the samples of a
rest, where the index is constant, and shifts other matches by no more than this."""
_STEPS: Final = 100
"""Number of equal steps of completion at which directions of motion are compared."""
_HALF_CHORD: Final = 4
"""Half of the length of chords that define directions, in steps: above sensor noise."""
_SLOWEST: Final = 0.1
"""Chords shorter than this share of the median, as at a reversal, have less weight."""
_TETHER: Final = 0.5
"""Cost of a difference of completion by one; opposite directions have the cost two."""
_BLUR: Final = 2.0
"""Standard deviation, in steps, of the filter that smooths the stepwise correction."""

AlignmentMethod = Literal["interpolation", "directions", "dtw", "dtw-euclidean"]
"""Ways to match demonstrations, see `align`."""

Samples = Float[np.ndarray, " N"]
"""One number per sample of a demonstration."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Course:
    """One demonstration on its own normalised time, with its completion index."""

    clock: Samples
    """Time from 0 to 1."""
    poses: Float[np.ndarray, "N 6"]
    completion: Samples

    @property
    def progress(self) -> Samples:
        """The completion index, made strictly increasing also during rests."""
        return np.asarray(
            (1.0 - _TIME_SHARE) * self.completion + _TIME_SHARE * self.clock
        )

    def at(self, clock: Times) -> Outputs:
        """Return the poses at given normalised times."""
        last = len(self.clock) - 2
        before = np.clip(np.searchsorted(self.clock, clock) - 1, 0, last)
        start, step = self.clock[before], np.diff(self.clock)[before]
        share = ((clock - start) / step)[:, None]
        resampled: np.ndarray = (1.0 - share) * self.poses[before]
        resampled += share * self.poses[before + 1]
        return resampled


Matched = tuple[Float[np.ndarray, "K M 6"], Float[np.ndarray, "K M"]]
"""Poses of K demonstrations at M phases, and their clocks there."""
CostRow = Callable[[_Course, int, _Course], Samples]
"""Costs of matching a sample of the first demonstration with each of the second."""


def align(
    demonstrations: Sequence[Demonstration],
    *,
    method: AlignmentMethod = "interpolation",
    n_samples: int = 200,
    rotation_weight: float = 0.5,
    denoise: bool = True,
    trim_rests: bool = True,
) -> AlignedDemonstrations:
    """Align demonstrations of different timing to common phases.

    * ``"interpolation"`` (default) inverts each completion index exactly. The phase at
      a given completion is the mean over the demonstrations of their normalised times
      there, so that the common timing (starting and stopping gently) is kept.
    * ``"directions"`` does the same with a corrected completion index, so that the
      hands move in the same directions, see `corrected_completions`: for demonstrations
      from different starts, with repeated parts, or with parts of different sizes.
    * ``"dtw"`` is the published method: dynamic time warping on |ζ_a - ζ_b| against the
      demonstration with most samples, matches averaged per sample. If ζ rises strictly,
      it finds the same matches to within half a sample, but stepwise.
    * ``"dtw-euclidean"`` warps on the distance of poses, Eq. (17). It mistakes
      intermediate points of a long path for the end of a short one (Fig. 3b), and is
      only for comparison.

    Args:
        demonstrations: At least one; lengths, sample rates and durations may differ.
        method: One of the above.
        n_samples: Number of equally spaced phases from 0 to 1.
        rotation_weight: ω₁ of Eq. (17), within [0, 1].
        denoise: Whether completion is measured on the denoised paths; the resulting
            poses are always interpolated from the recorded samples.
        trim_rests: Whether periods without motion are left out first, see
            `gplfd_policies.demonstrations.rests`. If they are kept, rests in all
            demonstrations become rests of the result.

    Returns:
        The aligned demonstrations with their mean duration, the clock of each, and the
        wrenches of those that have them.

    Raises:
        TypeError: If the demonstrations are not a sequence of demonstrations.
        ValueError: If another argument is not as described.

    Warns:
        UserWarning: If sensor noise makes a path more than 1.1 times longer, or if
            rests were left out.
    """
    methods = get_args(AlignmentMethod)
    if method not in methods:
        raise ValueError(f"method must be one of {sorted(methods)}, got {method!r}")
    if n_samples < 2:
        raise ValueError(f"n_samples must be at least 2, got {n_samples}")
    demonstrations = checked_demonstrations(demonstrations)
    if not demonstrations:
        raise ValueError("at least one demonstration is needed, got none")
    rests: tuple[tuple[Rest, ...], ...] = ()
    if trim_rests:
        recorded = demonstrations
        demonstrations, rests = zip(*map(without_rests, recorded), strict=True)
        warn_of_rests(recorded, rests)
    measured = [
        measure_completion(demo, rotation_weight, denoise) for demo in demonstrations
    ]
    warn_of_noise([length_ratio for _, length_ratio in measured], denoise)

    # Normalise time, and unwrap the rotations from the first demonstration's branch.
    courses = []
    for demo, (completion, _) in zip(demonstrations, measured, strict=True):
        times, poses = demo.times, demo.poses
        branch = np.stack([demonstrations[0].poses[0, 3:], poses[0, 3:]])
        first = unwrap_rotvecs(branch)[1]
        if not np.array_equal(first, poses[0, 3:]):
            # A demonstration is continuous: its branch is that of its first sample.
            rotvecs = unwrap_rotvecs(np.vstack([first, poses[1:, 3:]]))
            poses = np.hstack([poses[:, :3], rotvecs])
        clock = (times - times[0]) / (times[-1] - times[0])
        courses.append(_Course(clock=clock, poses=poses, completion=completion))

    def completion_cost(reference: _Course, row: int, other: _Course) -> np.ndarray:
        return np.asarray(np.abs(other.completion - reference.completion[row]))

    def pose_cost(reference: _Course, row: int, other: _Course) -> np.ndarray:
        return pose_distance(other.poses, reference.poses[row], rotation_weight)

    phases = np.linspace(0.0, 1.0, n_samples)
    if method == "dtw":
        aligned, clocks = _warped(courses, phases, completion_cost)
    elif method == "dtw-euclidean":
        aligned, clocks = _warped(courses, phases, pose_cost)
    else:
        if method == "directions":
            corrected = corrected_completions(
                [course.progress for course in courses],
                [course.poses for course in courses],
                rotation_weight,
            )
            courses = [
                replace(course, completion=completion)
                for course, completion in zip(courses, corrected, strict=True)
            ]
        aligned, clocks = _interpolated(courses, phases)
    durations = [float(demo.times[-1] - demo.times[0]) for demo in demonstrations]
    return AlignedDemonstrations(
        times=phases,
        poses=aligned,
        duration=float(np.mean(durations)),
        rests=rests,
        clocks=clocks,
        wrenches=_felt(demonstrations, clocks),
    )


def _felt(
    demonstrations: Sequence[Demonstration], clocks: Float[np.ndarray, "K M"]
) -> Float[np.ndarray, "K M 6"] | None:
    """Return the wrenches at shares of the durations, in the hand's axes."""
    if all(demo.wrenches is None for demo in demonstrations):
        return None
    felt = np.full((*clocks.shape, 6), np.nan)
    for wrenches, demo, clock in zip(felt, demonstrations, clocks, strict=True):
        if demo.wrenches is not None:
            rotvecs = demo.poses[:, None, 3:]
            turned = into_axes(rotvecs, demo.wrenches.reshape(-1, 2, 3)).reshape(-1, 6)
            times = demo.times[0] + clock * (demo.times[-1] - demo.times[0])
            wrenches[:] = interpolated(times, demo.times, turned)
    return felt


def _interpolated(courses: Sequence[_Course], phases: Times) -> Matched:
    """Match demonstrations at equal completion, on their mean clock."""
    progress = [course.progress for course in courses]
    # Between these knots every clock is linear in progress, and so is their mean. Thus
    # inversion by linear interpolation is exact.
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
    poses = [course.at(clock) for clock, course in zip(clocks, courses, strict=True)]
    return np.stack(poses), np.stack(clocks)


def _warped(courses: Sequence[_Course], phases: Times, cost_row: CostRow) -> Matched:
    """Warp demonstrations onto the one with most samples; average the matches."""
    reference = max(courses, key=lambda course: len(course.clock))
    aligned, clocks = [], []
    for course in courses:
        if course is reference:
            # The reference itself: every sample is matched with itself.
            aligned.append(course.at(phases))
            clocks.append(phases)
            continue
        rows, columns = dynamic_time_warping(
            lambda row, course=course: cost_row(reference, row, course),  # type: ignore[misc]
            len(reference.clock),
        )
        matches = np.bincount(rows)
        means = [
            np.bincount(rows, weights=column[columns]) / matches
            for column in (course.clock, *course.poses.T)
        ]
        matched = replace(reference, poses=np.column_stack(means[1:]))
        aligned.append(matched.at(phases))
        clocks.append(np.interp(phases, reference.clock, means[0]))
    return np.stack(aligned), np.stack(clocks)


def corrected_completions(
    completions: Sequence[Float[np.ndarray, " _"]],
    poses: Sequence[Float[np.ndarray, "_ 6"]],
    rotation_weight: float,
) -> list[Float[np.ndarray, " _"]]:
    """Return completion indices at which demonstrations move in the same directions.

    The completion index is comparable only if the parts of the task are equal shares of
    every path. This fails if a hand starts from farther away or does a part twice.
    Therefore the directions of each demonstration at equal steps of completion are
    matched with their mean, by dynamic time warping with the cost
    ``|u_a - u_b|² + (ζ_a - ζ_b)² / 4``, and the resulting correction is smoothed.
    """
    steps = np.linspace(0.0, 1.0, _STEPS)
    scale = np.repeat(np.sqrt([1.0 - rotation_weight, rotation_weight]), 3)
    # Unit vectors along each path, shorter at reversals.
    directions = []
    for index, recorded in zip(completions, poses, strict=True):
        ends = ((_HALF_CHORD, _HALF_CHORD), (0, 0))
        padded = np.pad(scale * interpolated(steps, index, recorded), ends, mode="edge")
        chords = padded[2 * _HALF_CHORD :] - padded[: -2 * _HALF_CHORD]
        lengths = np.linalg.norm(chords, axis=1)
        least = max(_SLOWEST * float(np.median(lengths)), np.finfo(np.float64).tiny)
        directions.append(chords / np.maximum(lengths, least)[:, None])
    common = np.mean(directions, axis=0)

    corrected = []
    for index, along in zip(completions, directions, strict=True):

        def cost_row(row: int, along: np.ndarray = along) -> np.ndarray:
            apart = np.sum((common - along[row]) ** 2, axis=1)
            return np.asarray(apart + (_TETHER * (steps - steps[row])) ** 2)

        rows, columns = dynamic_time_warping(cost_row, len(steps))
        matches = np.bincount(rows)
        stairs = np.bincount(rows, weights=steps[columns]) / matches
        correction = scipy.ndimage.gaussian_filter1d(
            stairs - steps, _BLUR, mode="nearest"
        )
        # Ends stay matched to ends.
        correction -= (1.0 - steps) * correction[0] + steps * correction[-1]
        rising = np.clip(np.maximum.accumulate(steps + correction), 0.0, 1.0)
        corrected.append(np.interp(index, steps, rising))
    return corrected
