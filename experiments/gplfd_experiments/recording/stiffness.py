"""How stiff the hand is at every moment: one colour in the scene, and a lane over time.

Doors vary in two horizontal directions, along the pull (x) and across it (z). Colours
show the mean of the stiffness in both.
"""

import functools
from collections.abc import Iterator, Mapping
from types import MappingProxyType
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, stages
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.part import Part
from gplfd_experiments.recording.stream import moving, seconds, static

LANE: Final = f"{stages.ENTITY}/stiffness"
"""Entity of the lane that says how stiff the hand is."""

SCALE: Final[Mapping[float, Colour]] = MappingProxyType(
    {100.0: (120, 90, 255), 300.0: (235, 85, 160), 500.0: (255, 236, 120)}
)
"""Colour by stiffness [N/m], linear between these: violet is soft, yellow is stiff."""

LEVELS: Final[Mapping[str, float]] = MappingProxyType(
    {
        "soft, < 200 N/m": 100.0,
        "medium": 300.0,
        "stiff, > 400 N/m": 500.0,
    }
)
"""States of the lane, each in the colour of this stiffness [N/m]."""

_EDGES: Final = (200.0, 400.0)
"""Between the states [N/m]."""

AVERAGED: Final = 0.25
"""Over how long what is shown is averaged [s]. σ grows from one via-point to the next
and falls there, three to ten times per second."""


def recent_mean(values: FloatArray, dt: float) -> FloatArray:
    """Return the mean of the last `AVERAGED` seconds up to every row.

    Rows that are not finite do not count, and have no mean. It depends on no later row.

    Args:
        values: (T, ...).
        dt: Time between two rows [s].
    """
    window = max(1, round(AVERAGED / dt))
    finite = np.isfinite(values)
    start = np.zeros((window, *values.shape[1:]))
    sums = np.cumsum(np.concatenate([start, np.where(finite, values, 0.0)]), axis=0)
    counts = np.cumsum(np.concatenate([start, finite]), axis=0)
    total, count = sums[window:] - sums[:-window], counts[window:] - counts[:-window]
    mean: FloatArray = np.where(finite, total / np.maximum(count, 1.0), np.nan)
    return mean


def shown_stiffness(log: EpisodeLog) -> FloatArray:
    """Return the mean stiffness of x and z, averaged over time, (T,) [N/m]."""
    mean: FloatArray = recent_mean(log.stiffness[:, [0, 2]].mean(axis=1), log.dt)
    return mean


def colour_of(stiffness: FloatArray, unknown: Colour) -> NDArray[np.uint8]:
    """Return the colours of stiffnesses (N,) [N/m], (N, 3) in 0 to 255.

    Args:
        stiffness: NaN where a policy has none.
        unknown: Colour of those.
    """
    known = np.isfinite(stiffness)
    channels = [
        np.interp(np.where(known, stiffness, 0.0), list(SCALE), channel)
        for channel in zip(*SCALE.values(), strict=True)
    ]
    tints = np.where(known[:, None], np.stack(channels, axis=1), unknown)
    return tints.round().astype(np.uint8)


def stiffness_lane(part: Part) -> Iterator[Chunk]:
    """Return when the hand became soft or stiff; nothing for policies without σ."""
    shown = shown_stiffness(part.log)
    if not part.shows(shown):
        return
    known = np.isfinite(shown)
    level = np.where(known, np.digitize(shown, _EDGES), -1)
    rows = np.flatnonzero(np.diff(level, prepend=-1))
    rows = rows[(rows >= part.first_row) & known[rows]]
    if part.begins(shown):
        yield _lane_style()
    if rows.size:
        names = [list(LEVELS)[level[row]] for row in rows]
        columns = rr.StateChange.columns(state=names)
        yield moving(LANE, seconds(part.log.times[rows]), columns)


@functools.cache
def _lane_style() -> Chunk:
    names = list(LEVELS)
    tints = colour_of(np.array(list(LEVELS.values())), colours.HAND)
    return static(LANE, rr.StateConfiguration(values=names, labels=names, colors=tints))
