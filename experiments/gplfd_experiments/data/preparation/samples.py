"""Samples of a motion, and their repair: units, stamps, quaternions, jumps."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from gplfd_experiments.data.raw import ROW, RawRecording, restarts
from gplfd_experiments.data.settings import METRES, ImportSettings
from gplfd_experiments.files.arrays import FloatArray

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


class Note(NamedTuple):
    """Text about a change or finding of a preparation step."""

    text: str
    warning: bool = False
    """Whether it needs attention."""


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

    times: FloatArray
    """Time since the first usable sample [s], (N,)."""
    poses: FloatArray
    """Positions [m] and unit quaternions, the scalar first, continuous in sign, (N, 7);
    the identity where a motion has no orientations."""
    wrenches: FloatArray | None
    """Forces and moments [N, N m], (N, 6), not finite if missing; or none. First as
    recorded, then as in a `Demonstration`."""
    signals: Mapping[str, FloatArray]
    """Other recorded signals, (N, d) each."""

    def __getitem__(self, kept: Any) -> "Samples":
        """Return some of the samples, as NumPy indexes."""
        return replace(self.mapped(lambda array: array[kept]), times=self.times[kept])

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


def usable(raw: RawRecording, settings: ImportSettings, notes: Notes) -> Samples:
    """Return the usable samples of a motion, in metres and in order of time.

    Raises:
        ValueError: It has no time stamps and no rate is given, too few samples are
            usable, or the quaternions are invalid.
    """
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
        problem = "; ".join([f"{raw.name} has no time stamps", *raw.notes])
        raise ValueError(
            f"{problem}; say how many samples it has per second, --recorded-rate 100, "
            "or what is the time, --columns t=NAME"
        )
    complete = np.abs(times) < _LATEST
    complete &= (np.abs(raw.positions) < _LARGEST_POSITION).all(axis=1)
    complete &= ~_lost(raw.positions, [0.0, 0.0, 0.0])
    quaternions = np.tile([1.0, 0.0, 0.0, 0.0], (number, 1))
    if raw.quaternions is not None:
        norms = np.nan_to_num(np.linalg.norm(raw.quaternions, axis=1), posinf=0.0)
        turned = norms > 1e-6
        wrong = turned & (np.abs(norms - 1.0) > _NORM_TOLERANCE)
        if wrong.any():
            index = int(np.argmax(wrong))
            raise ValueError(
                f"{raw.name}: the quaternion of sample {index} has norm "
                f"{norms[index]:.4g}, must be 1; are these its columns?"
            )
        quaternions = raw.quaternions / np.where(turned, norms, 1.0)[:, None]
        complete &= turned & ~_lost(quaternions, [1.0, 0.0, 0.0, 0.0])
    left = np.count_nonzero(complete)
    if left < max(2.0, _LEAST_USABLE * number):
        raise ValueError(
            f"{raw.name}: only {left} of {number} samples have time, position and "
            "orientation; look at the recording"
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
            column[:] = np.interp(times, times[recorded], column[recorded])
    positions = raw.positions * METRES[units or raw.unit or "m"]
    samples = Samples(
        times=times,
        poses=np.hstack([positions, quaternions]),
        wrenches=raw.wrenches,
        signals={name: np.nan_to_num(signal) for name, signal in signals.items()},
    )[complete]
    samples = _in_order(samples, raw.name, notes)
    # The sign of each quaternion that is closer to the sample before.
    quaternions = samples.poses[:, 3:]
    overlap = np.einsum("ij,ij->i", quaternions[1:], quaternions[:-1])
    changes = np.where(overlap < 0.0, -1.0, 1.0)
    if flips := np.count_nonzero(changes < 0.0):
        notes.add(f"{flips} quaternions changed sign")
    signs = np.concatenate([[1.0], np.cumprod(changes)])
    return replace(
        samples, poses=np.hstack([samples.positions, quaternions * signs[:, None]])
    )


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


def _in_order(samples: Samples, name: str, notes: Notes) -> Samples:
    """Return samples in order of time, from 0 and without repeated stamps."""
    if backwards := int(np.count_nonzero(np.diff(samples.times) < 0.0)):
        samples = samples[np.argsort(samples.times, kind="stable")]
        notes.warn(f"time stamps went back {backwards} times: sorted")
    first = np.concatenate([[True], np.diff(samples.times) > 0.0])
    if repeated := np.count_nonzero(~first):
        text = f"{repeated} samples with a repeated time stamp left out"
        moved = (np.diff(samples.poses, axis=0) != 0.0).any(axis=1) & ~first[1:]
        if np.count_nonzero(moved) > _LARGEST_LOST * len(first):
            rate = (len(first) - 1) / np.ptp(samples.times)
            notes.warn(
                f"{text}, which moved: time stamps are coarse; say --recorded-rate "
                f"{rate:.3g}"
            )
        else:
            notes.add(text)
        samples = samples[first]
    if len(samples.times) < 2:
        raise ValueError(f"{name}: all samples have the same time stamp")
    times = samples.times - samples.times[0]
    if not times[-1] <= samples.step * max(_MOST_STEPS, 4 * len(times)):
        raise ValueError(
            f"{name}: time stamps span {times[-1]:.3g} s in steps of usually "
            f"{samples.step:.3g} s; look at the first and the last, and at the unit"
        )
    return replace(samples, times=times)


def without_spikes(samples: Samples, notes: Notes) -> Samples:
    """Remove samples between two jumps of the tracker, and warn about single jumps.

    A jump is a step far longer than usual and faster than a hand.
    """
    steps = np.diff(samples.times)
    lengths = np.linalg.norm(np.diff(samples.positions, axis=0), axis=1)
    # The angle between two unit quaternions from the chord between them.
    chords = np.linalg.norm(np.diff(samples.poses[:, 3:], axis=0), axis=1)
    angles = np.asarray(4.0 * np.arcsin(np.clip(0.5 * chords, 0.0, 1.0)))
    jumps = np.full(len(steps), False)
    for sizes, limit in ((lengths, _FASTEST), (angles, _FASTEST_TURN)):
        usual = np.median(sizes[sizes > 0.0]) if (sizes > 0.0).any() else 0.0
        jumps |= (sizes > _OUTLYING * usual) & (sizes > limit * steps)
    kept, stay = np.full(len(samples.times), True), list[int]()
    for jump in np.flatnonzero(jumps).tolist():
        if stay and jump - stay[-1] <= _LONGEST_SPIKE:
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
