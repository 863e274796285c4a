"""From recordings as they are to demonstrations that something can learn from.

One way through, `prepare`, and a note of everything that was done or noticed on it:
samples are mended, repetitions found, the hand's offset added, noise filtered, rests at
the ends cut, the frame changed, and samples made even.
"""

import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from gplfd_experiments.data.preparation.frames import in_frame, offset_by
from gplfd_experiments.data.preparation.hinge import suspicious_order
from gplfd_experiments.data.preparation.samples import (
    Note,
    Notes,
    Samples,
    usable,
    without_spikes,
)
from gplfd_experiments.data.preparation.settings import Preparation
from gplfd_experiments.data.preparation.timing import (
    at_rate,
    checked_gaps,
    filtered,
    outliers,
    repetitions,
)
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.one_thread import one_thread
from gplfd_policies.demonstrations.alignment import align
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.rests import moving_span

_LARGE: Final = 3.0
"""A hand that moves further [m] is hardly recorded in metres."""
_SMALL: Final = 0.01
"""Neither is one that moves less [m]."""
_MOST_SAMPLES: Final = 10**6
"""Samples that are made of all recordings together; an hour at 100 Hz has 360,000."""
_MOST_MADE: Final = 20
"""Or so many times as many as were recorded, if that is more."""
_COMPARED: Final = 100
"""Samples on which motions are compared."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Motion:
    """One repetition, ready to be learned from."""

    name: str
    """Where it comes from."""
    demonstration: Demonstration
    """The motion in the wanted frame."""
    signals: Mapping[str, FloatArray]
    """What else was recorded, at the same times, (N, d) each."""
    radius: float | None
    """Of the hinge that was found [m]."""
    recorded: Samples
    """The motion as it was recorded, but for its unit and the missing samples."""
    notes: Notes
    """What was done and noticed."""


@one_thread
def prepare(
    recordings: Sequence[RawRecording],
    settings: Preparation,
    *,
    recorded_rate: float | None = None,
) -> tuple[Motion, ...]:
    """Make demonstrations of recordings.

    Args:
        recordings: As their files have them.
        settings: What is to be done.
        recorded_rate: Samples per second of recordings without time stamps [Hz].

    Returns:
        The motions, in order, each with notes of what was done and noticed.

    Raises:
        ValueError: A recording cannot be used; the message names it and says why.
    """
    recorded = sum(len(raw.positions) for raw in recordings)
    left = max(_MOST_SAMPLES, _MOST_MADE * recorded)
    motions: list[Motion] = []
    for raw in recordings:
        made = _motions(raw, settings, recorded_rate, left)
        left -= sum(len(motion.demonstration.times) for motion in made)
        motions += made
    if not motions:
        raise ValueError("there is no recording")
    return _compared(motions)


def _motions(
    raw: RawRecording, settings: Preparation, recorded_rate: float | None, most: int
) -> list[Motion]:
    """Prepare the repetitions of one recording, of at most so many samples together."""
    if settings.offset is not None and raw.quaternions is None:
        raise ValueError(f"{raw.name} has no orientations, which an offset needs")
    samples, notes = usable(raw, settings.units, recorded_rate)
    samples, spikes = without_spikes(samples)
    try:
        parts, found = repetitions(samples, settings.segments)
    except ValueError as error:
        raise ValueError(f"{raw.name}: {error}") from error
    motions = []
    for number, part in enumerate(parts, start=1):
        name = raw.name if len(parts) == 1 else f"{raw.name} #{number}"
        # What holds of the whole recording is said once.
        said = (*notes, *spikes, *found) if number == 1 else ()
        try:
            motion = _motion(name, part, settings, said, most)
        except ValueError as error:
            raise ValueError(f"{name}: {error}") from error
        most -= len(motion.demonstration.times)
        motions.append(motion)
    return motions


def _motion(
    name: str, recorded: Samples, settings: Preparation, notes: Notes, most: int
) -> Motion:
    """Prepare one repetition."""
    gaps = checked_gaps(recorded, settings.largest_gap)
    samples = offset_by(recorded, settings.offset)
    suspicions = _suspicions(samples)
    samples, smooth = filtered(samples, settings.cutoff)
    samples, rests = _trimmed(samples) if settings.trim_rests else (samples, ())
    samples, radius, framed = in_frame(samples, settings.frame)
    samples = at_rate(samples, settings.rate, most)
    poses = samples.poses
    return Motion(
        name=name,
        demonstration=Demonstration.from_quaternions(
            samples.times, poses[:, :3], poses[:, 3:]
        ),
        signals=samples.signals,
        radius=radius,
        recorded=recorded,
        notes=(*notes, *gaps, *suspicions, *smooth, *rests, *framed),
    )


def _suspicions(samples: Samples) -> Notes:
    """Notice what is hardly true of a hand."""
    texts = []
    span = float(np.ptp(samples.poses[:, :3], axis=0).max())
    if span > _LARGE:
        unit = "millimetres" if span > 100.0 * _LARGE else "centimetres"
        texts.append(f"it spans {span:.3g} m: are positions in {unit}? say --units")
    elif span < _SMALL:
        texts.append(f"it spans {1e3 * span:.2g} mm: is the unit right? say --units")
    order = suspicious_order(samples.poses)
    if order is not None and np.ptp(samples.poses[:, 3:], axis=0).any():
        texts.append(order)
    return tuple(Note(text=text, warning=True) for text in texts)


def _trimmed(samples: Samples) -> tuple[Samples, Notes]:
    """Cut rests at the ends."""
    poses = samples.poses
    motion = Demonstration.from_quaternions(samples.times, poses[:, :3], poses[:, 3:])
    start, end = moving_span(motion)
    kept = (samples.times >= start) & (samples.times <= end)
    if kept.all():
        return samples, ()
    cut = start - samples.times[0], samples.times[-1] - end
    text = f"rests of {cut[0]:.2f} s at the start and {cut[1]:.2f} s at the end cut"
    return samples[kept], (Note(text=text),)


def _compared(motions: Sequence[Motion]) -> tuple[Motion, ...]:
    """Name motions that are unlike the others."""
    if len(motions) < 4:
        return tuple(motions)
    with warnings.catch_warnings():
        # Of noise in the recordings: who learns from them is told.
        warnings.simplefilter("ignore", UserWarning)
        aligned = align(
            [motion.demonstration for motion in motions],
            n_samples=_COMPARED,
            trim_rests=False,
        )
    unlike = outliers(list(aligned.poses))
    far = Note(text="unlike the others: look at it", warning=True)
    return tuple(
        replace(motion, notes=(*motion.notes, far)) if place in unlike else motion
        for place, motion in enumerate(motions)
    )
