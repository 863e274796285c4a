"""A motion as read from its file."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any, Final, Literal

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from gplfd_env.validation.named import nearest_name
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.records import own_arrays, owned

_LISTED: Final = 30  # Largest number of names in a message.
ROW: Final = 10
"""Samples in a row that tell a clock that restarts from samples that come late."""


@dataclass(frozen=True, kw_only=True, slots=True)
class RawRecording:
    """One motion of a hand as read from a file, before any check of its usability.

    Samples may be missing (NaN), repeated, out of order and in any unit;
    `gplfd_experiments.data.preparation` repairs and reports this.

    Raises:
        ValueError: The shapes do not belong together, or there are fewer than two
            samples.
    """

    name: str
    """Origin: the file, and the part of it."""
    positions: FloatArray
    """Positions of the hand, (N, 3), in `unit`."""
    unit: str | None
    """One of `settings.METRES`; None if the file states none."""
    times: FloatArray | None = None
    """Time stamps [s], (N,); None if the file has none."""
    quaternions: FloatArray | None = None
    """Quaternions, scalar first, of any sign and norm, (N, 4); or none."""
    reading: str = ""
    """What orientations were read from, if not from quaternions."""
    wrenches: FloatArray | None = None
    """Forces and moments [N, N m], (N, 6); or none."""
    forces_on: Literal["hand", "object"] | None = None
    """What the forces act on, if the file states that they are in the axes of the poses
    and free of bias and weight; None if it states nothing about its forces."""
    signals: Mapping[str, FloatArray] = field(default_factory=dict)
    """Other arrays, (N, d), such as "gripper"."""
    untimed: str = ""
    """Hint at possible times in a file without times; continues a message."""
    notes: tuple[str, ...] = ()
    """Notes of the reader of the file."""

    def __post_init__(self) -> None:
        for name in ("positions", "times", "quaternions", "wrenches"):
            if getattr(self, name) is not None:
                own_arrays(self, name)
        signals = {name: owned(array) for name, array in self.signals.items()}
        object.__setattr__(self, "signals", signals)
        rows = len(self.positions) if self.positions.ndim else 0
        for name, array, shape in (
            ("positions", self.positions, (rows, 3)),
            ("times", self.times, (rows,)),
            ("quaternions", self.quaternions, (rows, 4)),
            ("wrenches", self.wrenches, (rows, 6)),
            *((name, a, (rows, *a.shape[-1:])) for name, a in signals.items()),
        ):
            if array is not None and array.shape != shape:
                raise ValueError(
                    f"{self.name}: {name} must have shape {shape}, got {array.shape}"
                )
        if rows < 2:
            raise ValueError(
                f"{self.name} has {rows} samples; a motion needs at least two"
            )


def chosen(
    wanted: str | None, known: Mapping[str, Any], what: str, *, file: str
) -> tuple[str, Any]:
    """Return the selected item of a file, or the only one.

    Raises:
        ValueError: There is none, none of that name, or several without a selection.
    """
    if not known:
        raise ValueError(f"{file} has no {what}")
    names = ", ".join(sorted(known)[:_LISTED]) + (", …" if len(known) > _LISTED else "")
    if wanted is None:
        if len(known) > 1:
            raise ValueError(
                f"{file} has more than one {what}; choose with --body: {names}"
            )
        (wanted,) = known
    if wanted not in known:
        hint = nearest_name(wanted, known)
        raise ValueError(f"{file} has no {what} {wanted!r}{hint}; it has {names}")
    return wanted, known[wanted]


def restarts(times: FloatArray) -> list[int]:
    """Return the indices of time stamps, (N,), at which the clock begins again.

    The stamps before such an index are all later than those from it on, `ROW` of each.
    """
    places = np.flatnonzero(np.isfinite(times))
    if len(places) < 2:
        return []
    ends = ((ROW - 1, 0), (0, ROW - 1))
    first, last = (np.pad(times[places], end, mode="edge") for end in ends)
    lowest = sliding_window_view(first, ROW).min(axis=1)[:-1]
    highest = sliding_window_view(last, ROW).max(axis=1)[1:]
    return [int(place) for place in places[1:][highest < lowest]]
