"""Temporal alignment of demonstrations with different timing.

Rests are left out first: a rest is not a part of the task, and the phase of a hand at
rest is ambiguous. Then demonstrations are matched where the same share of the task is
completed. Equation numbers refer to Arduengo et al., arXiv:2002.09979.
"""

import warnings
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Final, Literal, get_args

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes, pose_distance, pose_steps
from gplfd_env.spatial.turns import accumulated_rotvecs
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.arrays.shapes import Float, Int, Outputs, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations, Rest
from gplfd_policies.demonstrations.demonstration import (
    Demonstration,
    checked_demonstrations,
    turned,
)

_NOISY_LENGTH_RATIO: Final = 1.1
"""Length of a path over its denoised length above which a warning is issued."""
_BANDWIDTH: Final = 0.015
"""σ of the filter, as a share of the demonstration: shorter than intended motions."""
_REACH: Final = 4.0
"""Half-width at which the filter's weights are cut off, in standard deviations."""
_TIME_SHARE: Final = 1e-6
"""Share of normalised time in the completion index: it orders the samples of a rest."""
LARGEST_TABLE: Final = 10**8
"""Greatest number of cells: two sequences of 10,000, a few seconds and 100 MB."""
_DIAGONAL, _UP, _LEFT = np.int8(0), np.int8(1), np.int8(2)
_HALF_CHORD: Final = 0.02
"""Half of the chords that define the speed, as a share of the demonstration."""
_FAST: Final = 95.0  # percentile of the speed that counts as the motion's fast speed
_SLOW: Final = 0.05  # A hand slower than this share of the fast speed may be at rest
_UNMOVED: Final = 0.01
"""Largest share of the path's length covered during a rest, not a slow search."""
_LONGEST: Final = 0.10  # least duration of a rest, as a share of the moving time
_WORTH_SAYING: Final = 0.02  # fraction of trimmed time above which a warning is issued
_KEPT: Final = 0.05  # share of the moving time to which a rest is shortened
_TILTED: Final = np.radians(10.0)
"""Largest tilt of a motion that turns by more than 300° [rad]."""
_WORTH_LEARNING: Final = np.radians(1.0)
"""Tilt of such a motion above which a warning is issued [rad]."""

AlignmentMethod = Literal["interpolation", "dtw", "dtw-euclidean"]
"""Ways to match demonstrations, see `align`."""

PerSample = Float[np.ndarray, " N"]  # One number per sample of a demonstration.
Matched = tuple[Float[np.ndarray, "K M 6"], Float[np.ndarray, "K M"]]
"""Poses of K demonstrations at M phases, and their clocks there."""


@dataclass(frozen=True, kw_only=True, slots=True)
class _Course:
    """One demonstration on its own normalised time, with its completion index."""

    clock: PerSample
    """Time from 0 to 1."""
    poses: Float[np.ndarray, "N 6"]
    completion: PerSample

    def at(self, clock: Times) -> Outputs:
        """Return the poses at normalised times."""
        last = len(self.clock) - 2
        before = np.clip(np.searchsorted(self.clock, clock) - 1, 0, last)
        start, step = self.clock[before], np.diff(self.clock)[before]
        share = ((clock - start) / step)[:, None]
        resampled: np.ndarray = (1.0 - share) * self.poses[before]
        resampled += share * self.poses[before + 1]
        return resampled


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
      a completion is the mean of the demonstrations' normalised times there, so that
      the common timing (starting and stopping gently) is kept.
    * ``"dtw"`` is the published method: dynamic time warping on |ζ_a - ζ_b| against the
      demonstration with most samples, matches averaged per sample.
    * ``"dtw-euclidean"`` warps on the distance of poses, Eq. (17). It mistakes
      intermediate points of a long path for the end of a short one (Fig. 3b).

    Args:
        demonstrations: At least one; lengths, sample rates and durations may differ.
        method: One of the above.
        n_samples: Number of equally spaced phases from 0 to 1.
        rotation_weight: ω₁ of Eq. (17), within [0, 1].
        denoise: Whether completion is measured on the denoised paths.
        trim_rests: Whether periods without motion are left out, see `without_rests`.

    Raises:
        TypeError: If the demonstrations are not a sequence of demonstrations.
        ValueError: If another argument is not as described.

    Warns: UserWarning: Noise makes a path over 1.1 times longer, or rests are left out.
    """
    methods = get_args(AlignmentMethod)
    if method not in methods:
        raise ValueError(f"method must be one of {sorted(methods)}, got {method!r}")
    if n_samples < 2:
        raise ValueError(f"n_samples must be at least 2, got {n_samples}")
    demonstrations = checked_demonstrations(demonstrations)
    if not demonstrations:
        raise ValueError("at least one demonstration is needed, got none")
    recorded = demonstrations = _regular(demonstrations)
    rests: tuple[tuple[Rest, ...], ...] = ()
    if trim_rests:
        demonstrations, rests = zip(*map(without_rests, recorded), strict=True)
    measured = [
        task_completion_index(motion, rotation_weight, denoise)
        for motion in demonstrations
    ]
    _warn(recorded, rests, [length_ratio for _, length_ratio in measured], denoise)

    # Normalise time, and unwrap the rotations from the first demonstration's branch.
    courses = []
    for demo, (completion, _) in zip(demonstrations, measured, strict=True):
        times, poses = demo.times, demo.poses
        branch = np.stack([demonstrations[0].poses[0, 3:], poses[0, 3:]])
        first = unwrap_rotvecs(branch)[1]
        if not np.array_equal(first, poses[0, 3:]):
            rotvecs = unwrap_rotvecs(np.vstack([first, poses[1:, 3:]]))
            poses = np.hstack([poses[:, :3], rotvecs])
        clock = (times - times[0]) / (times[-1] - times[0])
        courses.append(_Course(clock=clock, poses=poses, completion=completion))

    phases = np.linspace(0.0, 1.0, n_samples)
    if method == "interpolation":
        aligned, clocks = _interpolated(courses, phases)
    else:
        weight = rotation_weight if method == "dtw-euclidean" else None
        aligned, clocks = _warped(courses, phases, weight)
    wrenches = None
    if any(demo.wrenches is not None for demo in demonstrations):
        # At the same shares of the durations, in the hand's axes.
        wrenches = np.full((*clocks.shape, 6), np.nan)
        for felt, demo, clock in zip(wrenches, demonstrations, clocks, strict=True):
            if demo.wrenches is not None:
                rotvecs = demo.poses[:, None, 3:]
                local = into_axes(rotvecs, demo.wrenches.reshape(-1, 2, 3))
                times = demo.times[0] + clock * (demo.times[-1] - demo.times[0])
                felt[:] = interpolated(times, demo.times, local.reshape(-1, 6))
    durations = [float(demo.times[-1] - demo.times[0]) for demo in demonstrations]
    return AlignedDemonstrations(
        times=phases,
        poses=aligned,
        duration=float(np.mean(durations)),
        rests=rests,
        clocks=clocks,
        wrenches=wrenches,
    )


def _regular(demonstrations: Sequence[Demonstration]) -> tuple[Demonstration, ...]:
    """Return demonstrations whose rotation vectors can be learned beyond 300°."""
    regular, tilts = [], [0.0]
    for number, demo in enumerate(demonstrations):
        rotvecs, tilt = accumulated_rotvecs(demo.poses[:, 3:])
        tilts.append(tilt)
        if tilt > _TILTED:
            raise ValueError(
                f"demonstration {number} turns by {turned(demo):.0f} degrees, and by "
                f"{np.degrees(tilt):.0f} degrees about other axes: turns of more than "
                "300 degrees are learned about one axis, within "
                f"{np.degrees(_TILTED):.0f} degrees. Cut the motion, or give poses "
                "relative to the first (relative_to_first(), --frame first-pose)"
            )
        poses = np.hstack([demo.poses[:, :3], rotvecs])
        regular.append(demo if not tilt else replace(demo, poses=poses))
    if max(tilts) > _WORTH_LEARNING:
        warnings.warn(
            f"turns: up to {max(map(turned, demonstrations)):.0f} degrees about one "
            f"axis; tilts, here up to {np.degrees(max(tilts)):.1f} degrees, are not "
            "learned near full turns.",
            stacklevel=3,
        )
    return tuple(regular)


def _interpolated(courses: Sequence[_Course], phases: Times) -> Matched:
    """Match demonstrations at equal completion, on their mean clock."""
    progress = [
        (1.0 - _TIME_SHARE) * course.completion + _TIME_SHARE * course.clock
        for course in courses
    ]
    pairs = list(zip(progress, courses, strict=True))
    # Between these knots clocks and their mean are linear: the inversion is exact.
    knots = np.unique(np.concatenate(progress))
    mean_clock = np.mean(
        [np.interp(knots, rising, course.clock) for rising, course in pairs], axis=0
    )
    wanted = np.interp(phases, mean_clock, knots)
    clocks = [np.interp(wanted, rising, course.clock) for rising, course in pairs]
    poses = [course.at(clock) for clock, course in zip(clocks, courses, strict=True)]
    return np.stack(poses), np.stack(clocks)


def _warped(
    courses: Sequence[_Course], phases: Times, rotation_weight: float | None
) -> Matched:
    """Warp demonstrations onto the longest one, by poses if there is a weight."""
    reference = max(courses, key=lambda course: len(course.clock))
    aligned, clocks = [], []
    for course in courses:
        if course is reference:
            aligned.append(course.at(phases))
            clocks.append(phases)
            continue

        def cost_row(row: int, course: _Course = course) -> PerSample:
            if rotation_weight is None:
                apart = course.completion - reference.completion[row]
                return np.asarray(np.abs(apart))
            return pose_distance(course.poses, reference.poses[row], rotation_weight)

        rows, columns = dynamic_time_warping(cost_row, len(reference.clock))
        matches = np.bincount(rows)
        means = [
            np.bincount(rows, weights=column[columns]) / matches
            for column in (course.clock, *course.poses.T)
        ]
        matched = replace(reference, poses=np.column_stack(means[1:]))
        aligned.append(matched.at(phases))
        clocks.append(np.interp(phases, reference.clock, means[0]))
    return np.stack(aligned), np.stack(clocks)


def dynamic_time_warping(
    cost_row: Callable[[int], Float[np.ndarray, " M"]], n_rows: int
) -> tuple[Int[np.ndarray, " P"], Int[np.ndarray, " P"]]:
    """Match two sequences with steps (1, 0), (0, 1), (1, 1) of equal weight.

    Returns the indices of the first and of the second sequence along the match with
    least cost. They never decrease, and ends are matched to ends.

    The recursion D_ij = c_ij + min(D_{i-1,j}, D_{i-1,j-1}, D_{i,j-1}) runs along each
    row without a loop: with S the cumulated cost of the row and v_j the cheaper of the
    two entries above, D_ij - S_j = min over l ≤ j of (v_l - S_{l-1}). A cell is a byte.
    """
    total = np.cumsum(cost_row(0))
    if n_rows * len(total) > LARGEST_TABLE:
        raise ValueError(
            f"dynamic time warping of {n_rows:,} and {len(total):,} samples compares "
            f"at most {LARGEST_TABLE:,} pairs: give fewer samples, or align by "
            'method="interpolation" (policy gp), which takes any number'
        )
    above = np.empty_like(total)
    choices = np.empty((n_rows, len(total)), dtype=np.int8)
    choices[0] = _LEFT
    for index in range(1, n_rows):
        costs = cost_row(index)
        choice = choices[index, 1:]
        np.less(total[1:], total[:-1], out=choice.view(np.bool_))  # up or diagonal
        above[0] = total[0]
        np.minimum(total[1:], total[:-1], out=above[1:])
        cumulated = costs.cumsum()
        total = cumulated + np.minimum.accumulate(above - (cumulated - costs))
        choices[index, 0] = _UP
        np.copyto(choice, _LEFT, where=total[:-1] < above[1:])
    # Follow the choices from the last cell back to the first.
    row, column = choices.shape[0] - 1, choices.shape[1] - 1
    path = [(row, column)]
    while row or column:
        choice = choices[row, column]
        row -= choice != _LEFT
        column -= choice != _UP
        path.append((row, column))
    rows, columns = np.array(path[::-1], dtype=np.int64).T
    return rows, columns


def task_completion_index(
    demonstration: Demonstration, rotation_weight: float = 0.5, denoise: bool = True
) -> tuple[PerSample, float]:
    """Return ζ, and the length of the path over its length without noise, about 1.

    ζ is the share of the path's length covered up to each sample, Eq. (16). As printed,
    it measures mainly noise (`test_phase_error_with_noise_stays_below`), which is
    therefore removed first by a Gaussian filter, also if motion capture has filtered it
    (`test_phase_error_with_filtered_noise_stays_below`).
    """
    poses = demonstration.poses
    raw = pose_steps(poses, rotation_weight)
    if np.sum(raw) <= 0.0:
        raise ValueError(
            "the demonstration does not move under rotation_weight="
            f"{rotation_weight}: 0 counts translation only, 1 rotation only"
        )
    clean, size = raw, len(poses)
    bandwidth = _BANDWIDTH * size
    reach = int(_REACH * bandwidth + 0.5)
    if reach > 0:
        path = np.ascontiguousarray(poses.T)
        # Extended by point reflection at the ends, which keeps the ends in place.
        before = 2.0 * path[:, :1] - path[:, reach:0:-1]
        after = 2.0 * path[:, -1:] - path[:, -2 : -reach - 2 : -1]
        extended = np.concatenate([before, path, after], axis=1)
        # By Fourier transform: a direct sum would cost O(N²).
        length = scipy.fft.next_fast_len(extended.shape[1], real=True)
        half = np.exp(-0.5 * (np.arange(reach + 1) / bandwidth) ** 2)
        weights = np.zeros(length)
        weights[: reach + 1] = half
        weights[-reach:] = half[:0:-1]
        weights /= weights.sum()
        # The weights are even, so their spectrum is real.
        spectrum = scipy.fft.rfft(extended, length) * scipy.fft.rfft(weights).real
        smooth = scipy.fft.irfft(spectrum, length)[:, reach : reach + size]
        smoothed = pose_steps(smooth.T, rotation_weight)
        # If nothing exceeds the noise, only the raw path can be used.
        clean = smoothed if np.sum(smoothed) > 0.0 else raw
    index = np.concatenate([[0.0], np.cumsum(clean if denoise else raw)])
    index /= index[-1]
    return index, float(np.sum(raw)) / float(np.sum(clean))


def without_rests(
    demonstration: Demonstration,
) -> tuple[Demonstration, tuple[Rest, ...]]:
    """Return a demonstration with shortened rests, and the parts left out.

    A hand is at rest if its speed, from chords of the smoothed path, stays below 5 % of
    the motion's fast speed for more than 10 % of the moving time, and if it covers less
    than 1 % of the path. Next to the motion 5 % of the moving time is kept.
    """
    times, poses = demonstration.times, demonstration.poses
    # Extended by its mirror image, so that a path that ends at rest stays at rest.
    blurred, width = scipy.ndimage.gaussian_filter1d, _BANDWIDTH * len(poses)
    regular = np.hstack([poses[:, :3], accumulated_rotvecs(poses[:, 3:])[0]])
    smooth = np.asarray(blurred(regular, width, axis=0, mode="reflect"))
    # Slow intervals, from first to last sample.
    reach = _HALF_CHORD * (times[-1] - times[0])
    ends = [np.clip(times + side, times[0], times[-1]) for side in (-reach, reach)]
    before, after = (interpolated(end, times, smooth) for end in ends)
    speed = np.asarray(pose_distance(after, before, 0.5)) / (ends[1] - ends[0])
    slow = speed < _SLOW * np.percentile(speed, _FAST)
    edges = np.diff(np.concatenate([[False], slow, [False]]).astype(int))
    starts, stops = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1

    unmoved = _UNMOVED * float(pose_steps(smooth).sum())
    moving = float(np.diff(times)[~slow[1:]].sum())
    kept = _KEPT * moving
    rests = []
    for first, last in zip(starts.tolist(), stops.tolist(), strict=True):
        start, end = float(times[first]), float(times[last])
        resting = float(pose_distance(smooth[last], smooth[first], 0.5)) <= unmoved
        if not (end - start > _LONGEST * moving and resting):
            continue
        if first > 0 and last < len(times) - 1:
            rests.append(Rest(start=start + 0.5 * kept, end=end - 0.5 * kept))
        elif first > 0:
            rests.append(Rest(start=start + kept, end=end))
        else:
            rests.append(Rest(start=start, end=end - kept))

    remaining, clock = np.full(times.shape, True), times.copy()
    for rest in rests:
        remaining &= (times < rest.start) | (times >= rest.end)
        clock[times >= rest.end] -= rest.end - rest.start
    if not rests or np.count_nonzero(remaining) < 3:
        return demonstration, ()
    wrenches = demonstration.wrenches
    trimmed = Demonstration(
        times=clock[remaining],
        poses=poses[remaining],
        wrenches=None if wrenches is None else wrenches[remaining],
    )
    return trimmed, tuple(rests)


def moving_span(demonstration: Demonstration) -> tuple[float, float]:
    """Return start and end of a demonstration without rests at its ends [s]."""
    start, end = first, last = demonstration.times[[0, -1]].tolist()
    _, rests = without_rests(demonstration)
    for rest in rests:
        if rest.start <= first:
            start = rest.end
        if rest.end >= last:
            end = rest.start
    return start, end


def _warn(
    recorded: Sequence[Demonstration],
    rests: Sequence[tuple[Rest, ...]],
    ratios: Sequence[float],
    denoise: bool,
) -> None:
    """Warn once of rests, and once of paths that are longer than without noise."""
    lengths = [rest.end - rest.start for left_out in rests for rest in left_out]
    whole = sum(float(motion.times[-1] - motion.times[0]) for motion in recorded)
    if sum(lengths) >= _WORTH_SAYING * whole:
        resting = sum(bool(left_out) for left_out in rests)
        warnings.warn(
            f"rests: {resting} of {len(rests)} demonstrations stand still for a while; "
            f"{sum(lengths):.2g} of {whole:.2g} s were left out, up to "
            f"{max(lengths):.2g} s at a time.",
            stacklevel=3,
        )
    if noisy := sum(ratio > _NOISY_LENGTH_RATIO for ratio in ratios):
        slow = "the raw path, and mostly follows slow time; pass denoise=True."
        warnings.warn(
            f"sensor noise: {noisy} of {len(ratios)} demonstrations have a raw path "
            f"more than {_NOISY_LENGTH_RATIO} times as long as the denoised one (up to "
            f"{max(ratios):.2f} times). Completion was computed from "
            f"{'the denoised path.' if denoise else slow}",
            stacklevel=3,
        )
