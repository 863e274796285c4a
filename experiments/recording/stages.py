"""The stages of the task as a coloured lane over time."""

from __future__ import annotations

import math
from typing import Final

import numpy as np
import rerun as rr

from experiments.episode_log import EpisodeLog
from experiments.recording.colours import BEFORE, FORCE, HAND, TRUTH
from experiments.recording.stream import seconds
from gplfd_env.task import STALL_ANGLE, SUCCESS_ANGLE

ENTITY: Final = "/stage"
_MOVED: Final = math.radians(1.0)
_STAGES: Final = {
    "grasp": BEFORE,
    "open": HAND,
    "hold": (84, 190, 255),
    "stuck": (222, 120, 60),
    "success": TRUTH,
    "failure": FORCE,
}


def log_stages(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log when each stage of `stages` began."""
    began = stages(log)
    names = list(_STAGES)
    labels = [f"failure: {log.failure}" if n == "failure" else n for n in names]
    style = rr.StateConfiguration(
        values=names, labels=labels, colors=np.array([_STAGES[n] for n in names])
    )
    stream.log(ENTITY, style, static=True)
    times = np.array([log.times[row] for row, _ in began])
    columns = rr.StateChange.columns(state=[name for _, name in began])
    stream.send_columns(ENTITY, seconds(times), columns)


def stages(log: EpisodeLog) -> list[tuple[int, str]]:
    """Row in which each stage began, in order, with its name.

    ``grasp`` until the door has moved by a degree, then ``open``, ``hold`` once the
    door is open by the task's angle, ``stuck`` from where a stalled door gained no
    more, ``success`` from the first solved step or ``failure`` in the last.
    """
    angle, last = log.door_angle, log.times.size - 1
    began = [(0, "grasp")]
    if angle.max() >= _MOVED:
        began.append((int(np.argmax(angle >= _MOVED)), "open"))
    if log.failure == "stalled" and angle.max() < SUCCESS_ANGLE:
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
