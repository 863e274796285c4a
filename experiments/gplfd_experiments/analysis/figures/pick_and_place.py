"""Synthetic pick-and-place motions for Figs. 2 to 4, whose data are not public.

The motions have the properties that the paper states: both ends are constrained and the
path between them is free, or the shelf is at one of two heights.
"""

from dataclasses import dataclass
from typing import Final

import numpy as np

from gplfd_experiments.data.teacher.random_motion import (
    minimum_jerk,
    smooth_functions,
    uneven_timing,
)
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies import AlignedDemonstrations, Demonstration

HEIGHT: Final = 1
"""Output in figures of one dimension: y, upwards."""

PHASES: Final = np.linspace(0.0, 1.0, 201)
PHASES.flags.writeable = False
"""Phases of `constrained_set`, (201,)."""

_CORRELATION: Final = 0.25
"""Correlation length of the deviation of a repetition, in phase."""

_RATE: Final = 60.0
"""Sampling rate of `shelf_motions` [Hz]."""


def true_spread(phases: FloatArray) -> FloatArray:
    """Standard deviation of the height between repetitions [m]: 3 mm at both ends."""
    return 0.003 + 0.037 * np.sin(np.pi * phases) ** 2


def true_height(phases: FloatArray) -> FloatArray:
    """Mean height [m]: over an obstacle, onto something 0.1 m higher."""
    return 0.1 * minimum_jerk(phases) + 0.2 * np.sin(np.pi * phases) ** 2


def deviations(count: int, rng: np.random.Generator) -> FloatArray:
    """Draw deviations of repetitions from the mean [m or rad], (``count``, 201)."""
    unit = smooth_functions(PHASES, _CORRELATION, count, rng)
    return true_spread(PHASES) * unit.T


def constrained_set(count: int, rng: np.random.Generator) -> AlignedDemonstrations:
    """Draw repetitions at `PHASES` of a task whose ends are constrained."""
    poses = deviations(6 * count, rng).reshape(count, 6, PHASES.size).swapaxes(1, 2)
    poses[:, :, 0] += 0.5 * minimum_jerk(PHASES)
    poses[:, :, HEIGHT] += true_height(PHASES)
    return AlignedDemonstrations(times=PHASES, poses=poses)


@dataclass(frozen=True, kw_only=True, slots=True)
class ShelfMotion:
    """One placing of an object on a shelf."""

    level: float
    """Height of the shelf [m]."""
    demonstration: Demonstration
    progress: FloatArray
    """True progress in the task at each sample, (N,), 0 to 1."""


def shelf_motions(
    levels: tuple[float, ...], per_level: int, rng: np.random.Generator
) -> tuple[ShelfMotion, ...]:
    """Place objects with uneven timing; the path to a high shelf passes lower ones."""
    motions = []
    for level, level_rng in zip(levels, rng.spawn(len(levels)), strict=True):
        for own in level_rng.spawn(per_level):
            duration = own.uniform(2.5, 5.0)
            times = np.arange(round(duration * _RATE) + 1) / _RATE
            progress = minimum_jerk(uneven_timing(times / times[-1], 0.6, own))
            poses = 0.002 * smooth_functions(times, 0.8, 6, own)
            poses[:, 0] += 0.15 * progress
            poses[:, HEIGHT] += level * progress + 0.02 * np.sin(np.pi * progress)
            motion = ShelfMotion(
                level=level,
                demonstration=Demonstration(times=times, poses=poses),
                progress=progress,
            )
            motions.append(motion)
    return tuple(motions)
