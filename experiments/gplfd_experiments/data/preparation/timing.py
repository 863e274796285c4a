"""Repetitions, gaps, filtering and resampling."""

from collections.abc import Sequence
from dataclasses import replace
from itertools import pairwise
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from gplfd_experiments.data.preparation.samples import Note, Notes, Samples
from gplfd_experiments.data.preparation.settings import Segments
from gplfd_experiments.data.raw import likely_time_unit
from gplfd_experiments.files.arrays import FloatArray

_SMOOTH: Final = 0.05
"""Standard deviation of the smoother under which speed is measured [s]."""
_REACH: Final = 0.1
"""Speed is that of chords over twice this time [s]."""
_SLOW: Final = 0.05
"""A hand slower than this share of its fast speed, the 95th percentile, rests."""
_LONG: Final = 0.5
"""A rest between two repetitions is at least so long [s]."""
_MARGIN: Final = 0.2
"""Of the rest on either side of a repetition so much is kept [s]."""
_SHORT: Final = 0.3
"""A repetition's path is at least this share of the longest one's."""
_BACK: Final = 0.5
"""A hand has turned round once it came back by this share of its usual way."""
_WHOLE: Final = 0.7
"""A repetition goes at least this share of the usual way from turn to turn."""
_TRIFLE: Final = 0.1
"""What goes less is no attempt at one."""
_ORDER: Final = 4
"""Of the Butterworth filter."""
_OVERSAMPLED: Final = 2.5
"""Samples per period of the cut-off that filtering takes."""


def repetitions(samples: Samples, how: Segments) -> tuple[list[Samples], Notes]:
    """Part a recording into repetitions.

    Args:
        samples: The recording.
        how: See `Preparation.segments`.

    Raises:
        ValueError: Times are given between which there is no motion, or turns are to
            be found where nothing moves.
    """
    if how == "none":
        return [samples], ()
    if isinstance(how, str):
        ways = {"rests": _between_rests, "turns": _between_turns}
        return ways[how](samples)
    parts = []
    for start, end in how:
        inside = (samples.times >= start) & (samples.times <= end)
        if np.count_nonzero(inside) < 2:
            raise ValueError(
                f"there are no samples from {start:g} to {end:g} s after the first; "
                f"the recording lasts {samples.times[-1]:.3f} s"
            )
        parts.append(samples[inside])
    return parts, ()


def _between_rests(samples: Samples) -> tuple[list[Samples], Notes]:
    """Return what lies between rests, but for motions back and trifles."""
    speed = _speed(samples)
    moving = np.asarray(speed > _SLOW * np.percentile(speed, 95.0))
    spans: list[list[float]] = []
    for first, last in _runs(moving):
        start, end = float(samples.times[first]), float(samples.times[last])
        if spans and start - spans[-1][1] < _LONG:
            spans[-1][1] = end
        else:
            spans.append([start, end])
    parts = []
    for start, end in spans:
        inside = samples.times >= start - _MARGIN
        inside &= samples.times <= end + _MARGIN
        parts.append(samples[inside])
    ways = [float(_path(part)) for part in parts]
    ahead = [
        part for part, way in zip(parts, ways, strict=True) if way >= _SHORT * max(ways)
    ]
    direction = _displacement(ahead[0])
    forth = [part for part in ahead if _displacement(part) @ direction > 0.0]
    text = f"{len(forth)} repetitions between rests"
    if len(forth) < len(ahead):
        text += f", {len(ahead) - len(forth)} motions back left out"
    if len(ahead) < len(parts):
        text += f", {len(parts) - len(ahead)} short motions left out"
    return forth, (Note(text=text),)


def _between_turns(samples: Samples) -> tuple[list[Samples], Notes]:
    """Return what goes from one turn to the next, in the direction of the first.

    A turn is an extreme of the position along its first principal direction.
    """
    clock, smooth = _smoothed(samples)
    offsets = smooth[:, :3] - smooth[:, :3].mean(axis=0)
    way = offsets @ np.linalg.svd(offsets, full_matrices=False)[2][0]
    low, high = np.percentile(way, [5.0, 95.0])
    if not high > low:
        raise ValueError("positions stay where they are: nothing turns round there")
    spans = list(pairwise(_turns(way, _BACK * (high - low))))
    lengths = np.array([way[last] - way[first] for first, last in spans])
    attempt = np.abs(lengths) >= _TRIFLE * np.abs(lengths).max()
    whole = np.abs(lengths) >= _WHOLE * np.median(np.abs(lengths[attempt]))
    forth = whole & (lengths * lengths[np.argmax(whole)] > 0.0)
    parts = []
    for first, last in np.array(spans)[forth]:
        inside = (samples.times >= clock[first]) & (samples.times <= clock[last])
        parts.append(samples[inside])
    text = f"{len(parts)} repetitions between turns"
    if back := np.count_nonzero(whole & ~forth):
        text += f", {back} motions back left out"
    if rest := np.count_nonzero(attempt & ~whole):
        text += f", {rest} incomplete left out"
    return parts, (Note(text=text),)


def _turns(way: FloatArray, least: float) -> list[int]:
    """Return first and last index, and extremes that a course comes back from."""
    turns, top, bottom, heading = [0], 0, 0, 0
    values = way.tolist()
    for place, value in enumerate(values):
        top = place if value > values[top] else top
        bottom = place if value < values[bottom] else bottom
        if heading >= 0 and values[top] - value >= least:
            turns.append(top)
            heading, bottom = -1, place
        elif heading <= 0 and value - values[bottom] >= least:
            turns.append(bottom)
            heading, top = 1, place
    turns += [top if heading > 0 else bottom, len(values) - 1]
    return sorted(set(turns))


def _smoothed(samples: Samples) -> tuple[FloatArray, FloatArray]:
    """Return equal steps of time, and the smoothed poses at them."""
    times, step = samples.times, samples.step
    clock = np.arange(times[0], times[-1], step)
    columns = _resampled(times, samples.poses, clock)
    smooth = gaussian_filter1d(columns, _SMOOTH / step, axis=0, mode="nearest")
    return clock, np.asarray(smooth)


def _speed(samples: Samples) -> FloatArray:
    """Return the speed of the smoothed hand, metres and half radians per second."""
    times, step = samples.times, samples.step
    clock, smooth = _smoothed(samples)
    reach = max(1, round(_REACH / step))
    padded = np.pad(smooth, ((reach, reach), (0, 0)), mode="edge")
    chords = padded[2 * reach :] - padded[: -2 * reach]
    # In metres, and a quaternion moves by half the angle: a mix that suits a hand.
    lengths = np.linalg.norm(chords, axis=1) / (2 * reach * step)
    return np.interp(times, clock, uniform_filter1d(lengths, 3))


def _runs(flags: NDArray[np.bool_]) -> list[tuple[int, int]]:
    """Return first and last index of every run of true."""
    edges = np.diff(np.concatenate([[False], flags, [False]]).astype(int))
    first, last = np.flatnonzero(edges == 1), np.flatnonzero(edges == -1) - 1
    return list(zip(first.tolist(), last.tolist(), strict=True))


def _path(samples: Samples) -> float:
    return float(np.linalg.norm(np.diff(samples.poses, axis=0), axis=1).sum())


def _displacement(samples: Samples) -> FloatArray:
    return np.asarray(samples.poses[-1] - samples.poses[0])


def checked_gaps(samples: Samples, largest: float) -> Notes:
    """Tell of gaps between samples.

    Raises:
        ValueError: One is longer than the largest that may be bridged [s].
    """
    steps = np.diff(samples.times)
    longest = int(np.argmax(steps))
    gap, when = float(steps[longest]), float(samples.times[longest])
    if gap > max(largest, 1.5 * samples.step):
        raise ValueError(
            f"there is no sample for {gap:.2f} s from {when:.2f} s on; cut there "
            "(--segment rests, or times), or bridge it in a straight line with "
            f"--largest-gap {gap + 0.01:.2f}"
        )
    gaps = int(np.count_nonzero(steps > 2.5 * samples.step))
    if not gaps:
        return ()
    return (Note(text=f"{gaps} gaps bridged, the longest of {gap:.2g} s"),)


def filtered(samples: Samples, cutoff: float | None) -> tuple[Samples, Notes]:
    """Filter poses and signals, forwards and backwards.

    Args:
        samples: At any times; they become equal steps.
        cutoff: Frequency that is halved [Hz]; None to leave the samples as they are.
    """
    if cutoff is None:
        return samples, ()
    rate = 1.0 / samples.step
    span = float(samples.times[-1] - samples.times[0])
    number = round(span * rate) + 1
    if rate < _OVERSAMPLED * cutoff or number <= 6 * _ORDER:
        text = f"not filtered: {len(samples.times)} samples at {rate:.3g} Hz"
        return samples, (Note(text=text),)
    clock = np.linspace(samples.times[0], samples.times[-1], number)
    even = resampled(samples, clock)
    sections = butter(_ORDER, cutoff, fs=(number - 1) / span, output="sos")

    def low_passed(columns: FloatArray) -> FloatArray:
        return np.asarray(sosfiltfilt(sections, columns, axis=0))

    signals = {name: low_passed(array) for name, array in even.signals.items()}
    return replace(even, poses=_unit(low_passed(even.poses)), signals=signals), ()


def resampled(samples: Samples, times: FloatArray) -> Samples:
    """Return the motion at other times, quaternions on the arc between neighbours."""
    return Samples(
        times=times,
        poses=_unit(_resampled(samples.times, samples.poses, times)),
        signals={
            name: _resampled(samples.times, array, times)
            for name, array in samples.signals.items()
        },
    )


def at_rate(samples: Samples, rate: float | None, most: int) -> Samples:
    """Return the motion from time 0 at equal steps; as it is where no rate is given.

    Args:
        samples: At any times.
        rate: Samples per second [Hz].
        most: Samples that may be made.

    Raises:
        ValueError: There would be more.
    """
    if rate is None:
        return samples
    start, end = samples.times[[0, -1]]
    number = max(2, round((end - start) * rate) + 1)
    if number > most:
        likely = likely_time_unit(samples.step)
        hint = "" if likely in (None, "s") else f": are times in {likely}? say "
        raise ValueError(
            f"it lasts {end - start:.6g} s with a sample every {samples.step:.3g} s"
            + (f"{hint}--time-unit {likely}. At" if hint else "; at")
            + f" {rate:g} samples per second that makes {number:,}, and {most:,} are "
            "left to make of these files; give a lower --rate, or cut it (--segment)"
        )
    even = resampled(samples, np.linspace(start, end, number))
    return replace(even, times=even.times - start)


def _resampled(
    times: FloatArray, columns: FloatArray, wanted: FloatArray
) -> FloatArray:
    return np.column_stack([np.interp(wanted, times, column) for column in columns.T])


def _unit(poses: FloatArray) -> FloatArray:
    norms = np.linalg.norm(poses[:, 3:], axis=1, keepdims=True)
    return np.hstack([poses[:, :3], poses[:, 3:] / norms])


def outliers(ways: Sequence[FloatArray]) -> list[int]:
    """Return which of several motions on one clock are far from the others.

    Args:
        ways: Poses of each [m, rad], (M, 6).

    Returns:
        Their places. Far is further from the median motion than 3.5 times what is
        usual (median absolute deviation, as of a normal distribution) and twice the
        median distance.
    """
    if len(ways) < 4:
        return []
    stacked = np.stack(ways)
    apart = np.linalg.norm(stacked - np.median(stacked, axis=0), axis=2).mean(axis=1)
    middle = float(np.median(apart))
    spread = 1.4826 * float(np.median(np.abs(apart - middle)))
    far = (apart > middle + 3.5 * spread) & (apart > 2.0 * middle)
    return [int(place) for place in np.flatnonzero(far)]
