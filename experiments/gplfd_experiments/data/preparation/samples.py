"""Samples of a motion: repair, repetitions, gaps, filter and rate."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any, Final, NamedTuple

import numpy as np
import scipy
from numpy.typing import NDArray
from scipy.ndimage import gaussian_filter1d, uniform_filter1d
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import ROW, RawRecording, restarts
from gplfd_experiments.data.settings import (
    METRES,
    SECONDS,
    ImportSettings,
    Segments,
    likely_time_unit,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import interpolated

_NORM_TOLERANCE: Final = 0.05  # Largest error of the norm of a rotation's quaternion.
_LEAST_USABLE: Final = 0.5  # Smallest share of usable samples.
_LARGEST_LOST: Final = 0.05  # Share of samples with a repeated stamp that may move.
_LARGEST_POSITION: Final = 1e9  # Larger coordinates, in any unit, count as missing.
_LATEST: Final = 1e20  # Later times [s] count as missing.
_MOST_STEPS: Final = 10**6
"""Longest motion in usual time steps, unless four times its samples are more."""
_FASTEST, _FASTEST_TURN = 5.0, 20.0
"""Speeds of a hand [m/s, rad/s] above which a step may be a jump."""
_OUTLYING: Final = 10.0  # Smallest ratio of a jump to the usual step.
_APART: Final = 0.1  # Least distance from where a tracker is lost, per span.
_LONGEST_SPIKE: Final = 5  # Largest number of samples between a jump and the jump back.
_SMOOTHING: Final = 0.05  # Standard deviation of the smoother of the poses [s].
_REACH: Final = 0.1  # Speed is computed from chords over twice this time [s].
_RESTING: Final = 0.05
"""A hand slower than this share of its fast speed, the 95th percentile, rests."""
_LEAST_REST: Final = 0.5  # Shortest rest between two repetitions [s].
_MARGIN: Final = 0.2  # Part of the rest kept on either side of a repetition [s].
_LEAST_PATH: Final = 0.3  # Shortest path of a repetition as a share of the longest.
_ORDER: Final = 4  # Order of the Butterworth filter.
_OVERSAMPLED: Final = 2.5  # Smallest number of samples per period of the cut-off.


class Note(NamedTuple):
    """Text about a change or finding of a preparation step."""

    text: str
    warning: bool = False  # Whether it needs attention.


class Notes(list[Note]):
    """Notes of the steps of a preparation."""

    def add(self, text: str) -> None:
        """Add a note about a change."""
        self.append(Note(text))

    def warn(self, text: str) -> None:
        """Add a note that needs attention."""
        self.append(Note(text, warning=True))


@dataclass(frozen=True, kw_only=True, slots=True)
class Samples:
    """A motion between two steps of the preparation."""

    times: FloatArray  # Time since the first usable sample [s], (N,).
    poses: FloatArray
    """Positions [m] and unit quaternions, the scalar first, continuous in sign, (N, 7);
    the identity where a motion has no orientations."""
    wrenches: FloatArray | None
    """Forces and moments [N, N m], (N, 6), not finite if missing; or none. First as
    recorded, then as in a `Demonstration`."""
    signals: Mapping[str, FloatArray]  # Other recorded signals, (N, d) each.

    def __getitem__(self, kept: Any) -> "Samples":
        """Return some of the samples, as NumPy indexes."""
        return replace(self.mapped(lambda array: array[kept]), times=self.times[kept])

    def between(self, start: float, end: float) -> "Samples":
        """Return the samples in a span of time [s]."""
        return self[(self.times >= start) & (self.times <= end)]

    def mapped(self, change: Callable[[FloatArray], FloatArray]) -> "Samples":
        """Return samples with every array changed except the times."""
        return replace(
            self,
            poses=change(self.poses),
            wrenches=None if self.wrenches is None else change(self.wrenches),
            signals={name: change(array) for name, array in self.signals.items()},
        )

    @property
    def step(self) -> float:
        """The median time between two samples [s]."""
        return float(np.median(np.diff(self.times)))

    @property
    def positions(self) -> FloatArray:
        """Positions [m], (N, 3)."""
        return self.poses[:, :3]

    @property
    def rotations(self) -> Rotation:
        """The N orientations."""
        return Rotation.from_quat(self.poses[:, 3:], scalar_first=True)


def of_one_clock(raw: RawRecording, settings: ImportSettings) -> list[RawRecording]:
    """Divide a recording where its clock restarts; a few samples alone are left out."""
    starts = [] if raw.times is None else restarts(raw.times)
    if not starts or settings.recorded_rate is not None:
        return [raw]
    whole = np.split(np.arange(len(raw.positions)), starts)
    parts = []
    for number, rows in enumerate((r for r in whole if len(r) >= ROW), start=1):
        note = (
            f"samples {rows[0] + 1} to {rows[-1] + 1}, because the clock restarts; "
            "if the whole is one motion, say --recorded-rate HZ"
        )
        part, name = raw.part(rows), f"{raw.name} part {number}"
        parts.append(replace(part, name=name, notes=(*raw.notes, note)))
    return parts


def without_fillers(raw: RawRecording) -> RawRecording:
    """Return a motion without numbers that stand for missing ones, such as -9999.

    Such a number is the least or greatest of a column, comes again exactly, and is
    farther from all others than these are apart, but for a tenth at each end.
    """
    times, notes = [] if raw.times is None else [raw.times], list(raw.notes)
    data = np.column_stack([raw.positions, *times])
    for name, column in zip("xyzt", data.T, strict=False):
        alike = data[:, 3:] if name == "t" else data[:, :3]
        values = np.unique(column[np.isfinite(column)])
        ends = (values[[0, 1]], values[[-1, -2]]) if len(values) > 1 else ()
        for number, nearest in ends:
            filled = column == number
            count, others = int(filled.sum()), alike[~filled]
            others = others[np.isfinite(others).all(axis=1)]
            if count > 1 and len(others) >= max(ROW, count):
                span = np.ptp(np.quantile(others, [0.1, 0.9], axis=0), axis=0).max()
                if abs(number - nearest) > span > 0.0:
                    column[filled] = np.nan
                    text = f"{count} samples with {number:g} in {name}"
                    notes.append(f"{text} are taken as missing")
    clock = data[:, 3] if times else None
    return replace(raw, positions=data[:, :3], times=clock, notes=tuple(notes))


def usable(raw: RawRecording, settings: ImportSettings, notes: Notes) -> Samples:
    """Return the usable samples of a motion, in metres and in order of time."""
    for text in raw.notes:
        notes.warn(text)
    if raw.reading:
        notes.add(f"orientations are {raw.reading}")
    number, times, units = len(raw.positions), raw.times, settings.units
    if settings.recorded_rate is not None:
        if times is not None:
            notes.warn(f"its time stamps replaced: {settings.recorded_rate:g} Hz")
        times = np.arange(number) / settings.recorded_rate
    elif times is None:
        raise ValueError(
            "it has no time stamps; say how many samples it has per second, "
            "--recorded-rate 100, or what is the time, --columns t=NAME"
        )
    complete = np.abs(times) < _LATEST
    complete &= (np.abs(raw.positions) < _LARGEST_POSITION).all(axis=1)
    complete &= ~_lost(raw.positions, [0.0, 0.0, 0.0])
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (number, 1))
    if raw.quaternions is not None:
        norms = np.nan_to_num(np.linalg.norm(raw.quaternions, axis=1), posinf=0.0)
        turned = norms > 1e-6
        wrong = complete & turned & (np.abs(norms - 1.0) > _NORM_TOLERANCE)
        if wrong.any():
            index = int(np.argmax(wrong))
            raise ValueError(
                f"the quaternion of sample {index} has norm {norms[index]:.4g}, must "
                "be 1; are these its columns?"
            )
        quaternions = raw.quaternions / np.where(turned, norms, 1.0)[:, None]
        complete &= turned & ~_lost(quaternions, [1.0, 0.0, 0.0, 0.0])
    left = np.count_nonzero(complete)
    if left < max(2.0, _LEAST_USABLE * number):
        raise ValueError(
            f"only {left} of {number} samples have time, position and orientation; "
            "look at the recording"
        )
    if left < number:
        notes.add(f"{number - left} of {number} samples missing")
    if units is not None and raw.unit not in (None, units):
        notes.warn(f"read in {units}, although the file states {raw.unit}")
    elif units is None and raw.unit is None:
        notes.add("no unit given: taken as metres")
    signals = {name: signal.copy() for name, signal in raw.signals.items()}
    for column in (column for signal in signals.values() for column in signal.T):
        recorded = np.isfinite(column) & np.isfinite(times)
        if recorded.any() and not recorded.all():
            order = np.flatnonzero(recorded)[np.argsort(times[recorded], kind="stable")]
            column[:] = np.interp(times, times[order], column[order])
    positions = raw.positions * METRES[units or raw.unit or "m"]
    samples = Samples(
        times=times,
        poses=np.hstack([positions, quaternions]),
        wrenches=raw.wrenches,
        signals={name: np.nan_to_num(signal) for name, signal in signals.items()},
    )[complete]
    samples = _in_order(samples, notes)
    # The sign of each quaternion that is closer to the sample before.
    quaternions = samples.poses[:, 3:]
    overlap = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    changes = np.where(overlap < 0.0, -1.0, 1.0)
    if flips := np.count_nonzero(changes < 0.0):
        notes.add(f"{flips} quaternions changed sign")
    quaternions[1:] *= np.cumprod(changes)[:, None]
    return samples


def _lost(values: FloatArray, neutral: Sequence[float]) -> NDArray[np.bool_]:
    """Return which samples a lost tracker made exactly neutral, far from all others."""
    at_neutral = (values == neutral).all(axis=1)
    others = values[~at_neutral & np.isfinite(values).all(axis=1)]
    if len(others) < 2 or not at_neutral.any():
        return np.full(len(values), False)
    steps = np.linalg.norm(np.diff(others, axis=0), axis=1)
    usual = np.median(steps[steps > 0.0]) if steps.any() else 0.0
    distance = np.linalg.norm(others - neutral, axis=1).min()
    far = distance > max(_OUTLYING * usual, _APART * np.ptp(others, axis=0).max())
    return np.asarray(at_neutral & far)


def _in_order(samples: Samples, notes: Notes) -> Samples:
    """Return samples in order of time, from 0 and without repeated stamps."""
    if backwards := int(np.count_nonzero(np.diff(samples.times) < 0.0)):
        samples = samples[np.argsort(samples.times, kind="stable")]
        notes.warn(f"time stamps went back {backwards} times: sorted")
    first = np.concatenate([[True], np.diff(samples.times) > 0.0])
    if first.sum() < 2:
        raise ValueError("all samples have the same time stamp")
    if repeated := np.count_nonzero(~first):
        text = f"{repeated} samples with a repeated time stamp left out"
        moved = (np.diff(samples.poses, axis=0) != 0.0).any(axis=1) & ~first[1:]
        if np.count_nonzero(moved) > _LARGEST_LOST * len(first):
            step = float(np.ptp(samples.times)) / (len(first) - 1)
            step *= SECONDS[likely_time_unit(step) or "s"]
            notes.warn(
                f"{text}, which moved: time stamps are coarse; say --recorded-rate "
                f"{1.0 / step:.4g}"
            )
        else:
            notes.add(text)
        samples = samples[first]
    times = samples.times - samples.times[0]
    if not times[-1] <= samples.step * max(_MOST_STEPS, 4 * len(times)):
        raise ValueError(
            f"time stamps span {times[-1]:.3g} s in steps of usually "
            f"{samples.step:.3g} s; look at the first and the last, and at the unit"
        )
    return replace(samples, times=times)


def without_spikes(samples: Samples, notes: Notes) -> Samples:
    """Remove samples between two jumps of a tracker, and warn about single jumps."""
    steps = np.diff(samples.times)
    lengths = np.linalg.norm(np.diff(samples.positions, axis=0), axis=1)
    # The angle between two unit quaternions from the chord between them.
    chords = np.linalg.norm(np.diff(samples.poses[:, 3:], axis=0), axis=1)
    angles = np.asarray(4.0 * np.arcsin(np.clip(0.5 * chords, 0.0, 1.0)))
    jumps = np.full(len(steps), False)
    for sizes, limit in ((lengths, _FASTEST), (angles, _FASTEST_TURN)):
        usual = np.median(sizes[sizes > 0.0]) if (sizes > 0.0).any() else 0.0
        jumps |= (sizes > _OUTLYING * usual) & (sizes > limit * steps)
    if (usual_speed := np.median(lengths / steps)) > _FASTEST:
        notes.warn(
            f"it moves at {usual_speed:.0f} m/s: are several sources mixed, or is a "
            "unit wrong?"
        )
    kept, stay = np.full(len(samples.times), True), list[int]()
    for jump in np.flatnonzero(jumps).tolist():
        poses = samples.poses[[stay[-1] if stay else jump, jump, jump + 1]]
        away, left = np.linalg.norm(poses[1:] - poses[0], axis=1)
        if stay and jump - stay[-1] <= _LONGEST_SPIKE and left < 0.5 * away:
            kept[stay.pop() + 1 : jump + 1] = False
        else:
            stay.append(jump)
    if not kept.all():
        number = np.count_nonzero(~kept)
        notes.warn(f"{number} samples of short jumps of the tracker left out")
    if stay:
        first = stay[0]
        notes.warn(
            f"{len(stay)} jumps of the tracker, at {samples.times[first]:.2f} s by "
            f"{lengths[first]:.2g} m and {angles[first]:.2g} rad: cut there (--segment)"
        )
    return samples[kept]


def repetitions(samples: Samples, how: Segments, notes: Notes) -> list[Samples]:
    """Divide a motion into repetitions, see `ImportSettings.segment`."""
    if how == "none":
        return [samples]
    if how != "rests":
        parts = [samples.between(start, end) for start, end in how]
        for part, (start, end) in zip(parts, how, strict=True):
            if len(part.times) < 2:
                raise ValueError(
                    f"there are no samples from {start:g} to {end:g} s after the "
                    f"first; the recording lasts {samples.times[-1]:.3f} s"
                )
        return parts
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
    if not moving.any():
        return [samples]  # Its extent is refused with a message.
    edges = np.diff(np.concatenate([[False], moving, [False]]).astype(int))
    starts = times[np.flatnonzero(edges == 1)]
    ends = times[np.flatnonzero(edges == -1) - 1]
    apart = starts[1:] - ends[:-1] >= _LEAST_REST
    starts, ends = starts[np.r_[True, apart]], ends[np.r_[apart, True]]
    runs = [
        samples.between(start - _MARGIN, end + _MARGIN)
        for start, end in zip(starts, ends, strict=True)
    ]
    # Motions that are long enough, in the direction of the first.
    steps = [np.linalg.norm(np.diff(run.poses, axis=0), axis=1) for run in runs]
    ways = np.array([lengths.sum() for lengths in steps])
    long = ways >= _LEAST_PATH * ways.max()
    moved = np.array([run.poses[-1] - run.poses[0] for run in runs])
    forth = long & (moved @ moved[np.argmax(long)] > 0.0)
    kept, others = np.count_nonzero(forth), np.count_nonzero(~forth)
    left_out = f", {others} other motions left out" if others else ""
    notes.add(f"{kept} repetitions between rests{left_out}")
    return [run for run, whole in zip(runs, forth, strict=True) if whole]


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
    return replace(samples, wrenches=interpolated(times, times[felt], wrenches[felt]))


def filtered(samples: Samples, cutoff: float, notes: Notes) -> Samples:
    """Filter forwards and backwards; the cut-off [Hz] halves amplitudes, 0 is none."""
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
    sections = scipy.signal.butter(_ORDER, cutoff, fs=rate, output="sos")
    filtered = partial(scipy.signal.sosfiltfilt, sections, axis=0)
    return _unit_quaternions(even.mapped(filtered))


def at_rate(samples: Samples, rate: float, most: int) -> Samples:
    """Return the motion from time 0 at equal steps, at a rate of 0 [Hz] as it is."""
    if rate == 0.0:
        return samples
    start, end = samples.times[[0, -1]]
    number = round((end - start) * rate) + 1
    if number < 3:
        raise ValueError(
            f"it lasts {end - start:.2g} s: is the unit of its times right? say "
            "--time-unit, or a higher --rate"
        )
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
