"""The stages of the task as a coloured lane over time."""

import functools
import math
from collections.abc import Collection
from typing import Final

import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from gplfd_env.task.opening import STALL_ANGLE, SUCCESS_ANGLE
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording.colours import BEFORE, FORCE, HAND, TRUTH
from gplfd_experiments.recording.stream import moving, seconds, static

ENTITY: Final = "/stage"
_MOVED: Final = math.radians(1.0)
_ROOM: Final = 1.02
"""Where the lane ends, in durations of the episode."""
_STAGES: Final = {
    "reach": (150, 140, 255),
    "grasp": BEFORE,
    "open": HAND,
    "hold": (84, 190, 255),
    "stuck": (222, 120, 60),
    "success": TRUTH,
    "failure": FORCE,
}


def stage_lane(
    log: EpisodeLog, shown: Collection[str] = (), *, ended: bool = True
) -> list[Chunk]:
    """When each stage of `stages` began.

    Args:
        log: The episode, or so much of it as there is.
        shown: Names of the stages that are shown already.
        ended: Whether nothing more will happen.
    """
    began = [(log.times[row], name) for row, name in stages(log)]
    new = [stage for stage in began if stage[1] not in shown]
    if ended:
        # The last stage is given some width.
        new.append((_ROOM * log.times[-1], began[-1][1]))
    if not new:
        return []
    times, names = zip(*new, strict=True)
    columns = rr.StateChange.columns(state=names)
    lane = moving(ENTITY, seconds(np.array(times)), columns)
    return [lane] if shown and not log.failure else [_style(log.failure), lane]


@functools.lru_cache(maxsize=8)
def _style(failure: str) -> Chunk:
    names = list(_STAGES)
    labels = [f"failure: {failure}" if n == "failure" else n for n in names]
    tints = np.array([_STAGES[name] for name in names])
    style = rr.StateConfiguration(values=names, labels=labels, colors=tints)
    return static(ENTITY, style)


def stages(log: EpisodeLog) -> list[tuple[int, str]]:
    """Row in which each stage began, in order, with its name.

    ``reach`` until the hand has taken hold, ``grasp`` until the door has moved by a
    degree, then ``open``, ``hold`` once the door is open by the task's angle, ``stuck``
    from where a stalled door gained no more, ``success`` from the first solved step or
    ``failure`` in the last.
    """
    angle, last = log.door_angle, log.times.size - 1
    taken = log.capability > 0
    began = [(int(np.argmax(taken)), "grasp")] if taken.any() else []
    if not taken[0]:
        began.insert(0, (0, "reach"))
    if angle.max() >= _MOVED:
        began.append((int(np.argmax(angle >= _MOVED)), "open"))
    if log.failure in ("stalled", "latched") and angle.max() < SUCCESS_ANGLE:
        began.append((int(np.argmax(angle >= angle.max() - STALL_ANGLE)), "stuck"))
    if angle.max() >= SUCCESS_ANGLE:
        began.append((int(np.argmax(angle >= SUCCESS_ANGLE)), "hold"))
    if log.solved.any():
        began.append((int(np.argmax(log.solved)), "success"))
    elif not log.success:
        began.append((last, "failure"))
    # A stage that began no earlier than its successor did not happen.
    return [
        stage
        for stage, following in zip(began, [*began[1:], (last + 1, "")], strict=True)
        if stage[0] < following[0]
    ]
