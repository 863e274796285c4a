"""Detection and removal of rests in recordings.

People start the recording, wait, move, wait, and stop it. A rest is not a part of the
task: if it is kept, it becomes an interval of phase without motion, and the phase of a
hand at rest there is ambiguous.
"""

import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.se3 import pose_distance, pose_steps
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.demonstrations.demonstration import Demonstration

_BLUR: Final = 0.015
"""Standard deviation of the filter for the measurement of speed, as a share of the
demonstration."""
_HALF_CHORD: Final = 0.02
"""Half of the length of chords that define the speed, as a share of the
demonstration."""
_FAST: Final = 95.0
"""Percentile of the speed that counts as the motion's fast speed."""
_SLOW: Final = 0.05
"""A hand slower than this share of the fast speed may be at rest."""
_UNMOVED: Final = 0.01
"""Largest share of the path's length covered during a rest: a slow hand that covers
more is unlatching a door or searching for contact."""
_LONGEST: Final = 0.10
"""Least duration of a rest, as a share of the moving time: shorter ones are starts,
stops or hesitation."""
_WORTH_SAYING: Final = 0.02
"""Fraction of trimmed time above which a warning is issued."""
_KEPT: Final = 0.05
"""Share of the moving time to which a rest is shortened."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Rest:
    """A part without motion that was left out, by the time stamps [s]."""

    start: float
    end: float


def without_rests(
    demonstration: Demonstration,
) -> tuple[Demonstration, tuple[Rest, ...]]:
    """Return a demonstration with shortened rests, and the parts left out.

    A hand is at rest if its speed, from chords of the smoothed path, stays below 5 % of
    the motion's fast speed for more than 10 % of the moving time, and if it covers less
    than 1 % of the path. 5 % of the moving time is kept next to the motion, so that
    gentle starts and stops are kept.
    """
    times, poses = demonstration.times, demonstration.poses
    # Extended by its mirror image, so that a path that ends at rest stays at rest.
    blurred = scipy.ndimage.gaussian_filter1d
    smooth = np.asarray(blurred(poses, _BLUR * len(poses), axis=0, mode="reflect"))
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
        if not times[last] - times[first] > _LONGEST * moving:
            continue
        if not float(pose_distance(smooth[last], smooth[first], 0.5)) <= unmoved:
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
    if not rests or np.count_nonzero(remaining) < 2:
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
    """Warn once if 2 % of the recorded time or more was left out as rests."""
    lengths = [rest.end - rest.start for left_out in rests for rest in left_out]
    whole = sum(float(motion.times[-1] - motion.times[0]) for motion in demonstrations)
    if sum(lengths) < _WORTH_SAYING * whole:
        return
    resting = sum(bool(left_out) for left_out in rests)
    warnings.warn(
        f"rests: {resting} of {len(rests)} demonstrations stand still for a while; "
        f"{sum(lengths):.2g} of {whole:.2g} s were left out, up to {max(lengths):.2g} "
        "s at a time. The result's `rests` say where; align(..., trim_rests=False) "
        "keeps them.",
        UserWarning,
        stacklevel=3,
    )
