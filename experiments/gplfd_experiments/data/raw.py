"""A motion as its file has it: nothing converted but the notation of rotations."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Final

from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import freeze, read_only

METRES: Final[Mapping[str, float]] = {"m": 1.0, "cm": 0.01, "mm": 0.001, "in": 0.0254}
"""Units of length by name, in metres."""

SECONDS: Final[Mapping[str, float]] = {"s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9}
"""Units of time by name, in seconds."""

_USUAL_STEP: Final = (9e-4, 0.9)
"""Time between two samples of a hand [s]: 1.1 Hz to 1.1 kHz. The range spans a factor
of 1,000, as units of time do, so that at most one unit fits."""

RADIANS: Final[Mapping[str, float]] = {"rad": 1.0, "deg": math.pi / 180.0}
"""Units of angle by name, in radians."""


def likely_time_unit(step: float) -> str | None:
    """Return the unit in which a step between samples is usual for a hand.

    Args:
        step: Usual difference of two time stamps, as they are written.

    Returns:
        One of `SECONDS`; None where no unit fits.
    """
    shortest, longest = _USUAL_STEP
    fits = (unit for unit, s in SECONDS.items() if shortest <= step * s < longest)
    return next(fits, None)


@dataclass(frozen=True, kw_only=True, slots=True)
class RawRecording:
    """One motion of a hand: what a file says, whether or not it can be used.

    Samples may be missing (NaN), repeated, out of order and in any unit; that is what
    `gplfd_experiments.data.preparation` mends, and reports.

    Raises:
        ValueError: The shapes do not belong together, or there are fewer than two
            samples.
    """

    name: str
    """Where it comes from: the file, and what in it."""
    positions: FloatArray
    """Positions of the hand, (N, 3), in `unit`."""
    unit: str | None
    """One of `METRES`; None where the file does not say."""
    times: FloatArray | None = None
    """Time stamps [s], (N,); None where the file has none."""
    quaternions: FloatArray | None = None
    """Orientations as quaternions, the scalar first, of any sign and norm, (N, 4); None
    where only positions were recorded."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """What else was recorded, (N, d) each: "force" (force [N] and torque [N m], 6),
    "gripper" (1 or more)."""
    untimed: str = ""
    """Of a file whose time stamps were not found: what else it has, and how to say that
    it is the time; continues a message."""
    notes: tuple[str, ...] = ()
    """What the reader of the file found remarkable."""

    def __post_init__(self) -> None:
        freeze(self, "positions")
        for name in ("times", "quaternions"):
            if getattr(self, name) is not None:
                freeze(self, name)
        signals = {name: read_only(array) for name, array in self.signals.items()}
        object.__setattr__(self, "signals", signals)
        rows = len(self.positions) if self.positions.ndim else 0
        expected = {
            "positions": (self.positions, (rows, 3)),
            "times": (self.times, (rows,)),
            "quaternions": (self.quaternions, (rows, 4)),
            **{name: (a, (rows, *a.shape[1:2])) for name, a in signals.items()},
        }
        for name, (array, shape) in expected.items():
            if array is not None and (array.shape != shape or len(shape) > 2):
                raise ValueError(
                    f"{self.name}: {name} must have shape {shape}, got {array.shape}"
                )
        if rows < 2:
            raise ValueError(
                f"{self.name} has {rows} samples; a motion needs at least two"
            )
        if self.unit is not None and self.unit not in METRES:
            raise ValueError(
                f"{self.name}: unknown unit of length {self.unit!r:.40}; known are "
                f"{', '.join(METRES)}"
            )
