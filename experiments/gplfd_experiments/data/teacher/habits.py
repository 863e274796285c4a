"""Faults of an untidy person and recording: haste, pauses, rests, lost samples."""

import math
from dataclasses import dataclass
from typing import Final

import numpy as np
from numpy.typing import NDArray

from gplfd_env.validation.fields import check_quantities, quantity
from gplfd_experiments.files.arrays import FloatArray

_LONGEST_BURST: Final = 6  # Samples that are lost at once, at most.


@dataclass(frozen=True, kw_only=True, slots=True)
class Habits:
    """How untidily a person moves and is recorded; by default not at all.

    Raises:
        ValueError: A field is not finite or outside its range.
        TypeError: A field is not a number.
    """

    haste: float = quantity(1.0, unit="", low=1.0, high=4.0)
    """A person is up to this many times faster or slower than the teacher (uniform in
    the logarithm), each time anew."""
    pauses: int = quantity(0, unit="pauses", low=0, high=20)
    """Pauses in the motion, at places drawn uniformly."""
    longest_pause: float = quantity(1.0, unit="s", low=0.1, high=10.0)
    """A pause lasts between a fifth of this and this."""
    backward: float = quantity(0.0, unit="rad", low=0.0, high=0.3)
    """In a pause the door goes back by up to this, and forward again."""
    longest_rest: float = quantity(0.0, unit="s", low=0.0, high=10.0)
    """Up to this long nothing happens before the motion."""
    cut: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Up to this share of the motion's duration is missing at the end."""
    dropped: float = quantity(0.0, unit="", low=0.0, high=0.5)
    """Share of the samples that are lost, in bursts of up to six."""
    outliers: int = quantity(0, unit="outliers", low=0, high=20)
    """Samples in which the hand is somewhere else."""
    outlier_distance: float = quantity(0.1, unit="m", low=0.0, high=1.0)
    """How far away it is then."""

    def __post_init__(self) -> None:
        check_quantities(self)


TIDY: Final = Habits()
"""The teacher as it always was."""

MESSY: Final = Habits(
    haste=2.0,
    pauses=2,
    longest_pause=1.0,
    backward=math.radians(3.0),
    longest_rest=1.0,
    cut=0.05,
    dropped=0.05,
    outliers=1,
)
"""An ordinary recording, not tidied up."""


def untidy_clock(
    habits: Habits, duration: float, rate: float, rng: np.random.Generator
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Draw when a person moves, pauses and goes back in a motion of a duration [s].

    Returns:
        Times [s] from 0, the motion's clock at these in [0, 1], which stands still in
        pauses, and by how much the door has gone back [rad], each (N,).
    """
    duration *= habits.haste ** rng.uniform(-1.0, 1.0)
    rest = habits.longest_rest * rng.uniform()
    places = np.sort(rng.uniform(0.1, 0.9, habits.pauses))
    lengths = habits.longest_pause * rng.uniform(0.2, 1.0, habits.pauses)
    depths = habits.backward * rng.uniform(0.0, 1.0, habits.pauses)
    end = rest + (1.0 - habits.cut * rng.uniform()) * duration + lengths.sum()
    times = np.arange(math.ceil(end * rate) + 1) / rate
    starts = rest + places * duration + np.cumsum(lengths) - lengths
    inside = np.clip((times[:, None] - starts) / lengths, 0.0, 1.0)
    clock = (times - rest - (lengths * inside).sum(axis=1)) / duration
    back = (depths * np.sin(np.pi * inside) ** 2).sum(axis=1)
    return times, np.clip(clock, 0.0, 1.0), back


def lose_samples(
    habits: Habits, poses: FloatArray, rng: np.random.Generator
) -> tuple[NDArray[np.bool_], FloatArray]:
    """Draw which samples of a recording are lost, and put outliers into the others.

    The first and the last sample are kept, and no outlier is among the first ten: a
    recording is taken relative to its first sample.

    Returns:
        Which samples are there, (N,), and all poses with outliers, (N, 6).
    """
    n = len(poses)
    kept = np.ones(n, dtype=bool)
    lost = min(round(habits.dropped * n), n - 2)
    while np.count_nonzero(~kept) < lost:
        start, length = rng.integers(1, n - 1), rng.integers(1, _LONGEST_BURST + 1)
        kept[start : min(start + length, n - 1)] = False
    poses = poses.copy()
    candidates = np.flatnonzero(kept)[10:-1]
    for index in rng.choice(candidates, min(habits.outliers, candidates.size), False):
        direction = rng.standard_normal(3)
        distance = np.linalg.norm(direction)
        poses[index, :3] += habits.outlier_distance * direction / distance
    return kept, poses
