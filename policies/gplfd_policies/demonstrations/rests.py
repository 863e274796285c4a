"""Rests in recordings: where they are, and demonstrations without them.

People press the button, wait, move, wait, and press it again. A rest is no part of the
task: kept, it becomes a stretch of phase in which nothing moves, and a hand that stands
still there could be at any phase of it.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.ndimage import gaussian_filter1d

from gplfd_env.spatial.se3 import pose_distance, pose_steps
from gplfd_policies.demonstrations.demonstration import Demonstration

_BLUR: Final = 0.015
"""Standard deviation of the smoother under which speed is measured, as a share of the
demonstration."""

_HALF_CHORD: Final = 0.02
"""Speed is that of chords over twice this share of the demonstration."""

_FAST: Final = 95.0
"""Percentile of the speed that counts as the motion's fast speed."""

_SLOW: Final = 0.05
"""A hand that is slower than this share of the fast speed may be resting."""

_UNMOVED: Final = 0.01
"""Share of the path's length that a resting hand covers at most. One that is slow but
comes further is unlatching a door, or feeling its way."""

_LONGEST: Final = 0.10
"""Share of the moving time for which it may only be starting, stopping or hesitating. A
minimum-jerk motion is that slow for 6 % of its time at either end."""

_WORTH_SAYING: Final = 0.02
"""Share of the recorded time whose loss a user is told of."""

_KEPT: Final = 0.05
"""Share of the moving time that is left of a rest."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Rest:
    """A part of a recording that was left out because nothing moved."""

    start: float
    """When it begins, on the recording's own clock [s]."""
    end: float
    """When it ends [s]."""


def without_rests(
    demonstration: Demonstration,
) -> tuple[Demonstration, tuple[Rest, ...]]:
    """Return a demonstration whose rests are shortened to those of a gentle motion.

    A hand rests where its speed, of chords of the smoothed path, stays below 5 % of the
    motion's fast speed for longer than 10 % of the time that is left for moving, and
    where it covers less than 1 % of the way: one that unlatches a door is slow, too. Of
    a rest 5 % of that time is kept, next to the motion, so that starting and stopping
    gently survives. Everything is relative to the demonstration: neither the rate of
    the recording nor its duration or size matters, and noise only through the smoother.

    Args:
        demonstration: The recording.

    Returns:
        The recording without what was left out, its clock closed over the gaps; and
        what was left out, in order.
    """
    times = demonstration.times
    smooth = _smooth(demonstration)
    slow = _slow(demonstration, smooth)
    unmoved = _UNMOVED * float(pose_steps(smooth).sum())
    moving = float(np.diff(times)[~slow[1:]].sum())
    rests = tuple(
        rest
        for first, last in _runs(slow)
        if times[last] - times[first] > _LONGEST * moving
        and float(pose_distance(smooth[last], smooth[first], 0.5)) <= unmoved
        for rest in [_left_out(times, first, last, _KEPT * moving)]
    )
    kept, clock = np.full(times.shape, True), times.copy()
    for rest in rests:
        kept &= (times < rest.start) | (times >= rest.end)
        clock[times >= rest.end] -= rest.end - rest.start
    if not rests or np.count_nonzero(kept) < 2:
        return demonstration, ()
    poses = demonstration.poses[kept]
    return Demonstration(times=clock[kept], poses=poses), rests


def moving_span(demonstration: Demonstration) -> tuple[float, float]:
    """Return when a demonstration begins and ends without the rests at its ends [s].

    Of these as much is kept as `without_rests` keeps; those in between stay.
    """
    start, end = (float(demonstration.times[place]) for place in (0, -1))
    first, last = start, end
    _, rests = without_rests(demonstration)
    for rest in rests:
        if rest.start <= first:
            start = rest.end
        if rest.end >= last:
            end = rest.start
    return start, end


def warn_of_rests(
    demonstrations: Sequence[Demonstration], rests: Sequence[tuple[Rest, ...]]
) -> None:
    """Warn once if a fiftieth of the recorded time or more was left out.

    Args:
        demonstrations: The recordings.
        rests: What was left out of each.

    Warns:
        UserWarning: If so.
    """
    lengths = [rest.end - rest.start for each in rests for rest in each]
    whole = sum(float(one.times[-1] - one.times[0]) for one in demonstrations)
    if sum(lengths) < _WORTH_SAYING * whole:
        return
    resting = sum(bool(each) for each in rests)
    warnings.warn(
        f"rests: {resting} of {len(rests)} demonstrations stand still for a while; "
        f"{sum(lengths):.2g} of {whole:.2g} s were left out, up to {max(lengths):.2g} "
        "s at a time. The result's `rests` say where; align(..., trim_rests=False) "
        "keeps them.",
        UserWarning,
        stacklevel=3,
    )


def _smooth(demonstration: Demonstration) -> Float[np.ndarray, "N 6"]:
    """Return the path without its fast noise."""
    poses = demonstration.poses
    # Continued by its mirror image: a path that ends at rest stays there.
    return np.asarray(
        gaussian_filter1d(poses, _BLUR * len(poses), axis=0, mode="reflect")
    )


def _slow(demonstration: Demonstration, smooth: Float[np.ndarray, "N 6"]) -> np.ndarray:
    """Say of each sample whether the hand may be resting there."""
    times = demonstration.times
    reach = _HALF_CHORD * (times[-1] - times[0])
    ends = [np.clip(times + side, times[0], times[-1]) for side in (-reach, reach)]
    before, after = (
        np.column_stack([np.interp(end, times, output) for output in smooth.T])
        for end in ends
    )
    speed: Float[np.ndarray, " N"]
    speed = np.asarray(pose_distance(after, before, 0.5)) / (ends[1] - ends[0])
    return np.asarray(speed < _SLOW * np.percentile(speed, _FAST))


def _runs(slow: np.ndarray) -> list[tuple[int, int]]:
    """Return the first and the last sample of every stretch that is slow."""
    edges = np.diff(np.concatenate([[False], slow, [False]]).astype(int))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _left_out(
    times: Float[np.ndarray, " N"], first: int, last: int, kept: float
) -> Rest:
    """Return what is left out of a rest of which some time is kept beside motion."""
    start, end = float(times[first]), float(times[last])
    if first > 0 and last < len(times) - 1:
        return Rest(start=start + 0.5 * kept, end=end - 0.5 * kept)
    if first > 0:
        return Rest(start=start + kept, end=end)
    return Rest(start=start, end=end - kept)
