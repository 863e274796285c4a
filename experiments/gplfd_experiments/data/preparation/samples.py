"""Samples of a motion, and how they are mended: units, stamps, quaternions, jumps.

Every step takes samples and gives samples and says what it did.
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any, Final

import numpy as np

from gplfd_experiments.data.raw import METRES, RawRecording
from gplfd_experiments.files.arrays import FloatArray

_NORM_TOLERANCE: Final = 0.05
"""A quaternion whose norm is further from one is none."""
_MOSTLY: Final = 0.5
"""Share of samples that must be usable."""
_NOWHERE: Final = 1e9
"""Coordinates beyond this, in any unit, and NaN are no position."""
_MOST_STEPS: Final = 10**6
"""A recording spans at most so many of its usual steps, or four times its samples."""
_FAST: Final = 5.0
"""Speed [m/s] that a hand hardly reaches."""
_SPIN: Final = 20.0
"""Angular speed [rad/s] that a hand hardly reaches."""
_OUTLYING: Final = 10.0
"""A jump is so many times as long as the usual step."""
_SPIKE: Final = 5
"""Samples that a tracker may lie elsewhere before it is back."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Note:
    """What a step of the preparation did or noticed."""

    text: str
    """In words, with numbers."""
    warning: bool = False
    """Whether a person should look at it."""


Notes = tuple[Note, ...]


@dataclass(frozen=True, kw_only=True, slots=True)
class Samples:
    """A motion between two steps of the preparation."""

    times: FloatArray
    """Time since the recording's first usable sample [s], (N,)."""
    poses: FloatArray
    """Positions [m] and unit quaternions, the scalar first, continuous in sign, (N, 7);
    of a motion without orientations that of no rotation."""
    signals: Mapping[str, FloatArray]
    """What else was recorded, (N, d) each."""

    def __getitem__(self, kept: Any) -> "Samples":
        """Return some of the samples, as NumPy indexes."""
        return Samples(
            times=self.times[kept],
            poses=self.poses[kept],
            signals={name: array[kept] for name, array in self.signals.items()},
        )

    @property
    def step(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.times)))


def turns(quaternions: FloatArray) -> FloatArray:
    """Return the angle [rad] between successive unit quaternions, (N - 1,)."""
    chords = np.linalg.norm(np.diff(quaternions, axis=0), axis=1)
    return np.asarray(4.0 * np.arcsin(np.clip(0.5 * chords, 0.0, 1.0)))


def usable(
    raw: RawRecording, units: str | None, recorded_rate: float | None
) -> tuple[Samples, Notes]:
    """Return the samples of a recording that are there, in metres and in order.

    Args:
        raw: The recording.
        units: Unit of its positions; None for what it says, else metres.
        recorded_rate: Its samples per second [Hz], where it has no time stamps.

    Raises:
        ValueError: It has no time stamps and no rate is given, hardly a sample is
            usable, or what should be quaternions are none.
    """
    notes = [Note(text=text, warning=True) for text in raw.notes]
    times = _stamps(raw, recorded_rate)
    quaternions, norms = _quaternions(raw)
    there = np.isfinite(times) & (norms > 0.0)
    there &= (np.abs(raw.positions) < _NOWHERE).all(axis=1)
    if np.count_nonzero(there) < max(2.0, _MOSTLY * len(there)):
        raise ValueError(
            f"{raw.name}: only {np.count_nonzero(there)} of {len(there)} samples have "
            "time, position and orientation; look at the recording"
        )
    if not there.all():
        missing = len(there) - np.count_nonzero(there)
        notes.append(Note(text=f"{missing} of {len(there)} samples missing"))
    unit = units or raw.unit
    notes += _unit_notes(raw, units)
    poses = np.hstack([raw.positions * METRES[unit or "m"], quaternions])
    signals = {name: _filled(times, array) for name, array in raw.signals.items()}
    samples = Samples(times=times, poses=poses, signals=signals)[there]
    try:
        samples, more = _in_order(samples)
    except ValueError as error:
        raise ValueError(f"{raw.name}: {error}") from error
    flips, samples = _continuous(samples)
    if flips:
        notes.append(Note(text=f"{flips} quaternions changed sign"))
    return samples, (*notes, *more)


def _stamps(raw: RawRecording, recorded_rate: float | None) -> FloatArray:
    if raw.times is not None:
        return raw.times
    if recorded_rate is None:
        raise ValueError(
            f"{raw.name} has no time stamps{raw.untimed or ';'} say how many samples "
            "it has per second, --recorded-rate 100"
        )
    return np.arange(len(raw.positions)) / recorded_rate


def _quaternions(raw: RawRecording) -> tuple[FloatArray, FloatArray]:
    """Return unit quaternions and their recorded norms, 0 where there is none."""
    if raw.quaternions is None:
        return np.tile([1.0, 0.0, 0.0, 0.0], (len(raw.positions), 1)), np.ones(
            len(raw.positions)
        )
    norms = np.nan_to_num(np.linalg.norm(raw.quaternions, axis=1), posinf=0.0)
    given = norms > 1e-6
    wrong = given & (np.abs(norms - 1.0) > _NORM_TOLERANCE)
    if wrong.any():
        index = int(np.argmax(wrong))
        raise ValueError(
            f"{raw.name}: the quaternion of sample {index} has norm "
            f"{norms[index]:.4g}, and rotations have norm 1; are these the columns of "
            "the quaternion?"
        )
    norms = np.where(given, norms, 0.0)
    unit = np.divide(raw.quaternions, np.where(given, norms, 1.0)[:, None])
    return unit, norms


def _unit_notes(raw: RawRecording, units: str | None) -> list[Note]:
    if units is not None and raw.unit not in (None, units):
        return [Note(text=f"taken in {units}, the file says {raw.unit}", warning=True)]
    if units is None and raw.unit is None:
        return [Note(text="no unit given: taken as metres")]
    return []


def _filled(times: FloatArray, signal: FloatArray) -> FloatArray:
    """Fill a signal's missing samples in a straight line."""
    filled = np.array(signal)
    for column in filled.T:
        known = np.isfinite(column) & np.isfinite(times)
        if known.any() and not known.all():
            column[:] = np.interp(times, times[known], column[known])
    return np.nan_to_num(filled)


def _in_order(samples: Samples) -> tuple[Samples, Notes]:
    """Sort by time, keep one sample of each, and count from the first."""
    notes = []
    backwards = int(np.count_nonzero(np.diff(samples.times) < 0.0))
    if backwards:
        samples = samples[np.argsort(samples.times, kind="stable")]
        text = f"time stamps went back {backwards} times: sorted"
        notes.append(Note(text=text, warning=True))
    first = np.concatenate([[True], np.diff(samples.times) > 0.0])
    if not first.all():
        repeated = len(first) - np.count_nonzero(first)
        samples = samples[first]
        notes.append(Note(text=f"{repeated} samples with the time of another left out"))
    if len(samples.times) < 2:
        raise ValueError("all samples have the same time stamp")
    times = samples.times - samples.times[0]
    if not times[-1] <= samples.step * max(_MOST_STEPS, 4 * len(times)):
        raise ValueError(
            f"time stamps span {times[-1]:.3g} s in steps of usually "
            f"{samples.step:.3g} s; look at the first and the last, and at the unit"
        )
    return replace(samples, times=times), tuple(notes)


def _continuous(samples: Samples) -> tuple[int, Samples]:
    """Let quaternions keep their sign; return how many changed it."""
    quaternions = samples.poses[:, 3:]
    overlap = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    changes = np.where(overlap < 0.0, -1.0, 1.0)
    signs = np.concatenate([[1.0], np.cumprod(changes)])
    poses = np.hstack([samples.poses[:, :3], quaternions * signs[:, None]])
    flips = int(np.count_nonzero(changes < 0.0))
    return flips, replace(samples, poses=poses)


def without_spikes(samples: Samples) -> tuple[Samples, Notes]:
    """Leave out the few samples that a tracker saw elsewhere, and tell of jumps.

    A jump is a step far longer than usual and faster than a hand. Where another one
    leads back at once, the samples between are left out; where not, the jump stays.
    """
    steps = np.diff(samples.times)
    lengths = np.linalg.norm(np.diff(samples.poses[:, :3], axis=0), axis=1)
    angles = turns(samples.poses[:, 3:])
    jumps = np.full(len(steps), False)
    for sizes, limit in ((lengths, _FAST), (angles, _SPIN)):
        usual = np.median(sizes[sizes > 0.0]) if (sizes > 0.0).any() else 0.0
        jumps |= (sizes > _OUTLYING * usual) & (sizes > limit * steps)
    kept, left = np.full(len(samples.times), True), list(np.flatnonzero(jumps))
    for out, back in pairwise(np.flatnonzero(jumps)):
        if back - out <= _SPIKE and out in left:
            kept[out + 1 : back + 1] = False
            left = [jump for jump in left if jump not in (out, back)]
    notes = []
    if not kept.all():
        number = len(kept) - np.count_nonzero(kept)
        text = f"{number} samples where the tracker saw it elsewhere left out"
        notes.append(Note(text=text, warning=True))
    if left:
        first = left[0]
        text = (
            f"{len(left)} jumps of the tracker, at {samples.times[first]:.2f} s by "
            f"{lengths[first]:.2g} m and {angles[first]:.2g} rad: cut there (--segment)"
        )
        notes.append(Note(text=text, warning=True))
    return samples[kept], tuple(notes)
