"""Converts motions from files to demonstrations, with notes on every change."""

import itertools
import math
import warnings
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_experiments.data.preparation import frames
from gplfd_experiments.data.preparation import samples as steps
from gplfd_experiments.data.preparation.samples import Notes, Samples
from gplfd_experiments.data.raw import RawRecording
from gplfd_experiments.data.settings import ImportSettings
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import interpolated
from gplfd_policies.demonstrations.alignment import align, moving_span
from gplfd_policies.demonstrations.demonstration import Demonstration

# Spans of a motion outside of which its unit is probably not the metre [m].
_SMALL, _LARGE = 0.01, 3.0
_MOST_SAMPLES: Final = 10**6
"""Largest number of resulting samples of all motions; an hour at 100 Hz has 360,000."""
_MOST_MADE: Final = 20  # Or this multiple of the recorded samples, if that is more.
_COMPARED: Final = 100  # Number of samples for comparing motions.
_SAME: Final = np.repeat([1e-4, 1e-3], 3)  # Copies differ by less at each [m, rad].


@dataclass(frozen=True, kw_only=True, slots=True)
class PreparedMotion:
    """One repetition, prepared for learning."""

    name: str  # Its origin.
    demonstration: Demonstration  # The motion in the wanted frame.
    signals: Mapping[str, FloatArray]
    """Recorded signals other than poses and wrenches, at the same times, (N, d)."""
    radius: float | None  # Radius of the estimated hinge [m].
    circle: float | None  # Radius of the circle on which it moves as with a door [m].
    recorded: Samples
    """The recorded motion, changed only by its unit and missing samples."""
    notes: Notes  # Changes and findings.


def prepare(
    recordings: Sequence[RawRecording], settings: ImportSettings
) -> tuple[PreparedMotion, ...]:
    """Make demonstrations from motions, with notes; ValueError names one that fails."""
    complete = map(steps.without_fillers, recordings)
    parts = [steps.of_one_clock(raw, settings) for raw in complete]
    recordings = list(itertools.chain(*parts))
    recorded = sum(len(raw.positions) for raw in recordings)
    left = max(_MOST_SAMPLES, _MOST_MADE * recorded)
    motions: list[PreparedMotion] = []
    for raw in recordings:
        if settings.offset is not None and raw.quaternions is None:
            raise ValueError(f"{raw.name} has no orientations, which an offset needs")
        # Notes about the whole are those of its first repetition.
        notes = Notes()
        name = raw.name
        try:
            samples = steps.without_spikes(steps.usable(raw, settings, notes), notes)
            samples = frames.wrenches_of_the_hand(samples, raw, settings, notes)
            spans = steps.repetitions(samples, settings.segment, notes)
            for number, part in enumerate(spans, start=1):
                name = raw.name if len(spans) == 1 else f"{raw.name} #{number}"
                motions.append(_motion(name, part, settings, notes, left, raw.reading))
                left -= len(motions[-1].demonstration.times)
                notes = Notes()
        except ValueError as error:
            doubts = [note.text for note in notes if note.warning]
            raise ValueError("; ".join([f"{name}: {error}", *doubts])) from error
    if not motions:
        raise ValueError("there is no recording")
    ways = np.empty((len(motions), _COMPARED, 6))  # Poses at equal steps of time.
    for place, motion in enumerate(motions):
        times, poses = motion.demonstration.times, motion.demonstration.poses
        equal = np.linspace(times[0], times[-1], _COMPARED)
        ways[place] = interpolated(equal, times, poses)
        apart = np.abs(ways[:place] - ways[place]) <= _SAME
        if (same := np.flatnonzero(apart.all(axis=(1, 2)))).size:
            motion.notes.warn(f"the same motion as {same[0]}: leave it out")
    turning = [motion for motion in motions if motion.circle]
    if settings.frame in ("first-pose", "recorded") and turning:
        others = f", as {len(turning) - 1} more do" if len(turning) > 1 else ""
        turning[0].notes.warn(
            f"moves on a circle of radius {turning[0].circle:.2f} m{others}: to open "
            "doors with it, say --frame hinge"
        )
    if len(motions) >= 4:
        # Warnings about noise are issued when demonstrations are learned.
        with warnings.catch_warnings(action="ignore", category=UserWarning):
            demonstrations = [motion.demonstration for motion in motions]
            aligned = align(demonstrations, n_samples=_COMPARED, trim_rests=False)
        for place, text in outliers(list(aligned.poses)).items():
            motions[place].notes.warn(f"unlike the others: {text}")
    return tuple(motions)


def _motion(
    name: str,
    recorded: Samples,
    settings: ImportSettings,
    notes: Notes,
    most: int,
    reading: str,
) -> PreparedMotion:
    """Prepare one repetition with a limited number of samples."""
    samples = steps.bridged(recorded, settings.largest_gap, notes)
    samples = frames.offset_by(samples, settings.offset)
    span = float(np.ptp(samples.positions, axis=0).max())
    if not _SMALL <= span <= _LARGE:
        notes.warn(f"it spans {span:.3g} m: is the unit right? say --units")
    samples = steps.filtered(samples, settings.cutoff, notes)
    if not settings.keep_rests:
        start, end = moving_span(_demonstration(samples))
        before, after = start - samples.times[0], samples.times[-1] - end
        if before > 0.0 or after > 0.0:
            samples = samples.between(start, end)
            notes.add(
                f"rests of {before:.2f} s at the start and {after:.2f} s at the end cut"
            )
    opening = frames.on_circle(samples)
    doubt = frames.doubtful_rotation(opening.poses, reading)
    if doubt is not None and np.ptp(samples.poses[:, 3:], axis=0).any():
        notes.warn(doubt)
    if settings.frame == "hinge" and len(opening.times) < len(samples.times):
        reach = opening.times[0] - samples.times[0]
        retreat = samples.times[-1] - opening.times[-1]
        notes.warn(
            f"{reach:.2f} s of reach at the start and {retreat:.2f} s of retreat at "
            "the end cut: they are off the circle of the hinge"
        )
        samples = opening
    samples, radius = frames.in_frame(samples, settings.frame, notes)
    samples = steps.at_rate(samples, settings.rate, most)
    return PreparedMotion(
        name=name,
        demonstration=_demonstration(samples),
        signals=samples.signals,
        radius=radius,
        circle=frames.radius_of_door(opening.poses),
        recorded=recorded,
        notes=notes,
    )


def _demonstration(samples: Samples) -> Demonstration:
    return Demonstration.from_quaternions(
        samples.times,
        samples.positions,
        samples.poses[:, 3:],
        wrenches=samples.wrenches,
    )


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
