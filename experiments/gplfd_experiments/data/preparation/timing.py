"""Repetitions, gaps, filtering and resampling of a motion."""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import partial
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.signal import butter, sosfiltfilt

from gplfd_experiments.data.preparation.samples import Notes, Samples
from gplfd_experiments.data.settings import Segments, likely_time_unit
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import interpolated

_SMOOTHING: Final = 0.05  # Standard deviation of the smoother of the poses [s].
_REACH: Final = 0.1  # Speed is computed from chords over twice this time [s].
_RESTING: Final = 0.05
"""A hand slower than this share of its fast speed, the 95th percentile, rests."""
_LEAST_REST: Final = 0.5  # Shortest rest between two repetitions [s].
_MARGIN: Final = 0.2  # Part of the rest kept on either side of a repetition [s].
_LEAST_PATH: Final = 0.3  # Shortest path of a repetition as a share of the longest.
_ORDER: Final = 4  # Order of the Butterworth filter.
_OVERSAMPLED: Final = 2.5  # Smallest number of samples per period of the cut-off.


def repetitions(samples: Samples, how: Segments, notes: Notes) -> list[Samples]:
    """Divide a motion into repetitions, see `ImportSettings.segment`."""
    if how == "none":
        return [samples]
    if how == "rests":
        spans, forth = _between_rests(samples)
        kept, others = np.count_nonzero(forth), np.count_nonzero(~forth)
        left_out = f", {others} other motions left out" if others else ""
        notes.add(f"{kept} repetitions between rests{left_out}")
        spans = spans[forth]
    else:
        spans = np.array(how)
    parts = []
    for start, end in spans:
        parts.append(_between(samples, start, end))
        if len(parts[-1].times) < 2:
            raise ValueError(
                f"there are no samples from {start:g} to {end:g} s after the first; "
                f"the recording lasts {samples.times[-1]:.3f} s"
            )
    return parts


def _between(samples: Samples, start: float, end: float) -> Samples:
    return samples[(samples.times >= start) & (samples.times <= end)]


def _between_rests(samples: Samples) -> tuple[FloatArray, NDArray[np.bool_]]:
    """Return spans between rests [s], (M, 2), and which are whole and not back."""
    # The speed of the smoothed hand in metres and half radians per second.
    times, step = samples.times, samples.step
    clock = np.arange(times[0], times[-1], step)
    columns = interpolated(clock, times, samples.poses)
    smooth = gaussian_filter1d(columns, _SMOOTHING / step, axis=0, mode="nearest")
    reach = max(1, round(_REACH / step))
    padded = np.pad(smooth, ((reach, reach), (0, 0)), mode="edge")
    chords = padded[2 * reach :] - padded[: -2 * reach]
    lengths = np.linalg.norm(chords, axis=1) / (2 * reach * step)
    speed = np.interp(times, clock, uniform_filter1d(lengths, 3))
    # Runs of motion, joined where the rest between them is short.
    moving = speed > _RESTING * np.percentile(speed, 95.0)
    edges = np.diff(np.concatenate([[False], moving, [False]]).astype(int))
    starts = times[np.flatnonzero(edges == 1)]
    ends = times[np.flatnonzero(edges == -1) - 1]
    apart = starts[1:] - ends[:-1] >= _LEAST_REST
    starts, ends = starts[np.r_[True, apart]], ends[np.r_[apart, True]]
    spans = np.column_stack([starts - _MARGIN, ends + _MARGIN])
    # Motions that are long enough, in the direction of the first.
    runs = [_between(samples, start, end).poses for start, end in spans]
    ways = np.array([np.linalg.norm(np.diff(p, axis=0), axis=1).sum() for p in runs])
    long = ways >= _LEAST_PATH * ways.max()
    moved = np.array([poses[-1] - poses[0] for poses in runs])
    return spans, long & (moved @ moved[np.argmax(long)] > 0.0)


def bridged(samples: Samples, largest: float, notes: Notes) -> Samples:
    """Refuse a gap longer than the largest [s], and fill those of the wrenches.

    Missing wrenches are interpolated; with a longer gap all of them are left out.
    """
    times, wrenches, step = samples.times, samples.wrenches, samples.step
    longest = max(largest, 1.5 * step)

    def longest_gap(stamps: FloatArray) -> tuple[float, str]:
        place = int(np.argmax(np.diff(stamps)))
        gap = float(stamps[place + 1] - stamps[place])
        return gap, (
            f"for {gap:.2f} s from {stamps[place]:.2f} s on; cut there (--segment "
            "rests, or times), or bridge it in a straight line with --largest-gap "
            f"{gap + 0.01:.2f}"
        )

    gap, where = longest_gap(times)
    if gap > longest:
        raise ValueError(f"there is no sample {where}")
    if gaps := np.count_nonzero(np.diff(times) > 2.5 * step):
        notes.add(f"{gaps} gaps bridged, the longest of {gap:.2g} s")
    if wrenches is None or (felt := np.isfinite(wrenches).all(axis=1)).all():
        return samples
    gap, where = longest_gap(np.concatenate([times[:1], times[felt], times[-1:]]))
    if not felt.any() or gap > longest:
        notes.warn(f"forces left out: there are none {where}")
        return replace(samples, wrenches=None)
    notes.add(f"forces of {np.count_nonzero(~felt)} samples interpolated")
    filled = interpolated(times, times[felt], wrenches[felt])
    return replace(samples, wrenches=filled)


def filtered(samples: Samples, cutoff: float, notes: Notes) -> Samples:
    """Filter poses, wrenches and signals at equal steps, forwards and backwards.

    The cut-off is the frequency whose amplitude is halved [Hz]; 0 for no filter.
    """
    if cutoff == 0.0:
        return samples
    rate = 1.0 / samples.step
    start, end = samples.times[[0, -1]]
    number = round(float(end - start) * rate) + 1
    if rate < _OVERSAMPLED * cutoff or number <= 6 * _ORDER:
        notes.add(f"not filtered: {len(samples.times)} samples at {rate:.3g} Hz")
        return samples
    even = _resampled(samples, np.linspace(start, end, number))
    rate = (number - 1) / float(end - start)
    sections = butter(_ORDER, cutoff, fs=rate, output="sos")
    return _unit_quaternions(even.mapped(partial(sosfiltfilt, sections, axis=0)))


def at_rate(samples: Samples, rate: float, most: int) -> Samples:
    """Return the motion from time 0 at equal steps, at a rate of 0 [Hz] as it is."""
    if rate == 0.0:
        return samples
    start, end = samples.times[[0, -1]]
    number = max(2, round((end - start) * rate) + 1)
    if number > most:
        likely = likely_time_unit(samples.step) or "s"
        hint = f"; are times in {likely}? say --time-unit {likely}" * (likely != "s")
        raise ValueError(
            f"at {rate:g} samples per second it has {number:,} samples, but at most "
            f"{most:,} more are allowed; give a lower --rate, or cut it{hint}"
        )
    even = _resampled(samples, np.linspace(start, end, number))
    return replace(even, times=even.times - start)


def _resampled(samples: Samples, times: FloatArray) -> Samples:
    """Return the motion at other times, linearly interpolated."""
    at_times = samples.mapped(partial(interpolated, times, samples.times))
    return _unit_quaternions(replace(at_times, times=times))


def _unit_quaternions(samples: Samples) -> Samples:
    quaternions = samples.poses[:, 3:]
    norms = np.linalg.norm(quaternions, axis=1, keepdims=True)
    return replace(samples, poses=np.hstack([samples.positions, quaternions / norms]))


def outliers(ways: Sequence[FloatArray]) -> dict[int, str]:
    """Describe motions whose position or rotation is far from the others', by index.

    Their greatest distance from the median motion is more than 3.5 robust standard
    deviations above the usual one (so is one normal motion of 4,000), more than three
    times the median distance, and more than 20 mm or 5°, the difference of careful
    repetitions by hand. The motions are poses at the same phases [m, rad], (M, 6) each.
    """
    apart = np.stack(ways) - np.median(np.stack(ways), axis=0)
    unlike: dict[int, str] = {}
    for part, scale, unit, axes, least in (
        (apart[:, :, :3], 1e3, "mm", "along", 20.0),
        (apart[:, :, 3:], math.degrees(1.0), "deg", "about", 5.0),
    ):
        distances = scale * np.linalg.norm(part, axis=2)
        greatest = distances.max(axis=1)
        usual = float(np.median(greatest))
        spread = 1.4826 * float(np.median(np.abs(greatest - usual)))
        far = greatest > max(usual + 3.5 * spread, 3.0 * usual, least)
        for place in map(int, np.flatnonzero(far)):
            phase = int(distances[place].argmax())
            axis = int(np.abs(part[place, phase]).argmax())
            sign = "-" if part[place, phase, axis] < 0.0 else "+"
            before = f"{unlike[place]}; " if place in unlike else ""
            unlike[place] = (
                f"{before}{greatest[place]:.0f} {unit} from the median motion, most "
                f"{axes} {sign}{'xyz'[axis]}, at {100 * phase / (len(part[0]) - 1):.0f}"
                f" % of the path (usual: {usual:.0f} {unit})"
            )
    return unlike
