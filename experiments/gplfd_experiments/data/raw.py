"""A motion as read from its file."""

from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from typing import Any, Final, Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import own_arrays

_LISTED: Final = 30  # Largest number of names in a message.
ROW: Final = 10
"""Samples in a row that tell a clock that restarts from samples that come late."""
_WIDTHS: Final = {"positions": (3,), "times": (), "quaternions": (4,), "wrenches": (6,)}
"""Arrays of a recording, and the shape of a sample of each."""


@dataclass(frozen=True, slots=True)
class RawRecording:
    """One motion of a hand as read from a file, before any check of its usability.

    Samples may be missing (NaN), repeated, out of order and in any unit;
    `gplfd_experiments.data.preparation` repairs and reports this. Raises ValueError for
    shapes that do not belong together, and for fewer than two samples.
    """

    name: str  # Origin: the file, and the part of it.
    positions: FloatArray  # Positions of the hand, (N, 3), in `unit`.
    unit: str | None  # One of `settings.METRES`; None if the file states none.
    times: FloatArray | None = None  # Time stamps [s], (N,); None if the file has none.
    quaternions: FloatArray | None = None
    """Quaternions, scalar first, of any sign and norm, (N, 4); or none."""
    reading: str = ""  # What orientations were read from, if not from quaternions.
    wrenches: FloatArray | None = None  # Forces and moments [N, N m], (N, 6); or none.
    forces_on: Literal["hand", "object"] | None = None
    """What the forces act on, if the file states that they are in the axes of the poses
    and free of bias and weight; None if it states nothing about its forces."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other arrays, (N, d), such as "gripper"."""
    notes: tuple[str, ...] = ()  # Notes of the reader of the file.

    def __post_init__(self) -> None:
        rows = len(self.positions)
        if rows < 2:
            raise ValueError(f"{self.name} has {rows} samples; a motion needs two")
        for name, width in _WIDTHS.items():
            array = getattr(self, name)
            if array is not None and array.shape != (rows, *width):
                raise ValueError(
                    f"{self.name}: {name} must have shape {(rows, *width)}, got "
                    f"{array.shape}"
                )
        own_arrays(self, *_WIDTHS)

    def part(self, rows: Any) -> "RawRecording":
        """Return the recording of some samples, as NumPy indexes."""
        arrays = {name: getattr(self, name) for name in _WIDTHS}
        selected = {n: array[rows] for n, array in arrays.items() if array is not None}
        signals = {name: signal[rows] for name, signal in self.signals.items()}
        return replace(self, signals=signals, **selected)


def chosen(
    wanted: str | None, items: Mapping[str, Any], what: str, *, file: str
) -> tuple[str, Any]:
    """Return the selected item of a file, or the only one; raise ValueError without."""
    if not items:
        raise ValueError(f"{file} has no {what}")
    names = ", ".join(sorted(items)[:_LISTED]) + (", …" if len(items) > _LISTED else "")
    if wanted is None and len(items) > 1:
        raise ValueError(f"{file} has more than one {what}; choose by --body: {names}")
    wanted = next(iter(items)) if wanted is None else wanted
    if wanted not in items:
        hint = nearest_name(wanted, items)
        raise ValueError(f"{file} has no {what} {wanted!r}{hint}; it has {names}")
    return wanted, items[wanted]


def restarts(times: FloatArray) -> list[int]:
    """Return the indices at which a clock, (N,), restarts, with `ROW` later before."""
    places = np.flatnonzero(np.isfinite(times))
    if len(places) < 2:
        return []
    ends = ((ROW - 1, 0), (0, ROW - 1))
    first, last = (np.pad(times[places], end, mode="edge") for end in ends)
    lowest = sliding_window_view(first, ROW).min(axis=1)[:-1]
    highest = sliding_window_view(last, ROW).max(axis=1)[1:]
    return [int(place) for place in places[1:][highest < lowest]]
