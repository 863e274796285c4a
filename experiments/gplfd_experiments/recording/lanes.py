"""Coloured lanes over time: stages of the task, and stiffness of the hand.

Doors vary in two horizontal directions, along the pull (x) and across it (z). Colours
of the stiffness, in the lane and in the scene, show its mean over both directions.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_env.task.opening import STALL_ANGLE
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording.colours import BEFORE, FORCE, HAND, TRUTH, Colour
from gplfd_experiments.recording.stream import moving, static
from gplfd_policies.arrays.records import interpolated

ROOT: Final = "/stage"
"""Entity of the stages, above that of every other lane."""
SCALE: Final[Mapping[float, Colour]] = {
    100.0: (120, 90, 255),
    300.0: (235, 85, 160),
    500.0: (255, 236, 120),
}
"""Colour by stiffness [N/m], interpolated linearly: violet is soft, yellow is stiff."""
LEVELS: Final[Mapping[str, Colour]] = dict(
    zip(("soft, < 200 N/m", "medium", "stiff, > 400 N/m"), SCALE.values(), strict=True)
)
"""States of the lane of the stiffness, and their colours."""

_EDGES: Final = (200.0, 400.0)  # Between the states of the stiffness [N/m].
# σ grows between via-points and drops at each, three to ten times per second.
_AVERAGED: Final = 0.25  # Averaging time of displayed values [s].
_ROOM: Final = 1.02  # End of the lane of stages, in durations of the episode.
_STAGES: Final = {
    "reach": (150, 140, 255),
    "grasp": BEFORE,
    "open": HAND,
    "hold": (84, 190, 255),
    "stuck": (222, 120, 60),
    "success": TRUTH,
    "failure": FORCE,
}


def lane(
    entity: str,
    looks: Mapping[str, Colour],
    states: Sequence[tuple[float, str]],
    failure: str = "",
) -> list[Chunk]:
    """Return a lane of states that begin at times [s], in their colours.

    The label of the state ``failure`` contains the failure.
    """
    labels = [f"failure: {failure}" if name == "failure" else name for name in looks]
    tints = np.array([*looks.values()], dtype=np.uint8)
    style = rr.StateConfiguration(values=[*looks], labels=labels, colors=tints)
    times, names = zip(*states, strict=True)
    changes = rr.StateChange.columns(state=names)
    return [static(entity, style), moving(entity, np.array(times), changes)]


def stage_lane(log: EpisodeLog) -> list[Chunk]:
    """Return the stages of an episode; the last one gets a visible width."""
    began = [(float(log.times[row]), name) for row, name in stages(log)]
    began.append((_ROOM * float(log.times[-1]), began[-1][1]))
    return lane(ROOT, _STAGES, began, log.failure)


def stages(log: EpisodeLog) -> list[tuple[int, str]]:
    """Return row and name of each stage that began, in order.

    ``reach`` if the hand did not hold the handle at the start, ``grasp`` when it does,
    then ``open``, ``hold`` after the door has reached the task's angle, ``stuck`` after
    the last progress of a stalled door, ``success`` from the first solved step or
    ``failure`` in the last.
    """
    angle, taken = log.opening.door_angle, log.opening.capability > 0
    stalled = log.failure in ("stalled", "latched") and angle.max() < SUCCESS_ANGLE
    conditions = {
        "reach": ~taken & ~taken[0],
        "grasp": taken,
        "open": angle >= math.radians(1.0),
        "stuck": stalled & (angle >= angle.max() - STALL_ANGLE),
        "hold": angle >= SUCCESS_ANGLE,
        "success": log.opening.solved.astype(bool),
    }
    began = [(int(np.argmax(at)), name) for name, at in conditions.items() if at.any()]
    if not log.opening.solved.any() and not log.success:
        began.append((log.times.size - 1, "failure"))
    # A stage that did not begin before its successor did not happen.
    followed = zip(began, [*began[1:], (log.times.size, "")], strict=True)
    return [stage for stage, following in followed if stage[0] < following[0]]


def stiffness_lane(log: EpisodeLog) -> list[Chunk]:
    """Return when the hand became soft or stiff; empty for policies without σ."""
    stiffness = mean_stiffness(log)
    finite = np.isfinite(stiffness)
    if not finite.any():
        return []
    level = np.where(finite, np.digitize(stiffness, _EDGES), -1)
    changes = np.flatnonzero((np.diff(level, prepend=-1) != 0) & finite)
    states = [(float(log.times[row]), [*LEVELS][level[row]]) for row in changes]
    return lane(f"{ROOT}/stiffness", LEVELS, states)


def recent_mean(values: FloatArray, dt: float) -> FloatArray:
    """Mean over the last 0.25 s up to every row of (T, ...).

    Rows that are not finite are ignored, and have no mean.
    """
    window = max(1, round(_AVERAGED / dt))
    finite = np.isfinite(values)
    start = np.zeros((window, *values.shape[1:]))
    sums = np.cumsum(np.concatenate([start, np.where(finite, values, 0.0)]), axis=0)
    counts = np.cumsum(np.concatenate([start, finite]), axis=0)
    total, count = sums[window:] - sums[:-window], counts[window:] - counts[:-window]
    mean: FloatArray = np.where(finite, total / np.maximum(count, 1.0), np.nan)
    return mean


def mean_stiffness(log: EpisodeLog) -> FloatArray:
    """Return the mean stiffness along and across, averaged over time, (T,) [N/m]."""
    return recent_mean(log.decisions.stiffness[:, [0, 2]].mean(axis=1), log.dt)


def colour_of(stiffness: FloatArray, unknown: Colour) -> NDArray[np.uint8]:
    """Colours of stiffnesses (N,) [N/m], ``unknown`` where NaN, (N, 3) in 0 to 255."""
    finite = np.isfinite(stiffness)
    scale, colours = np.array([*SCALE]), np.array([*SCALE.values()], float)
    shades = interpolated(np.where(finite, stiffness, 0.0), scale, colours)
    tints = np.where(finite[:, None], shades, unknown)
    return tints.round().astype(np.uint8)
