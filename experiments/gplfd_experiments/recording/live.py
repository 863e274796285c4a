"""Send a running episode to a viewer.

At the end, the viewer has the same data as a recording of the episode.
"""

import contextlib
from collections.abc import Iterator, Sequence
from typing import Final

import mujoco
import rerun as rr
import rerun.blueprint as rrb

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording.episode import (
    mean_radius,
    page,
    part_chunks,
    recording_name,
    static_chunks,
)
from gplfd_experiments.recording.lanes import stage_lane, stages
from gplfd_experiments.recording.stream import EpisodePart, open_stream
from gplfd_policies.demonstrations.demonstration import Demonstration

_FLUSH_TIMEOUT: Final = 10.0


class LiveRecording:
    """Sends an episode part by part to a connected stream."""

    def __init__(
        self,
        stream: rr.RecordingStream,
        model: mujoco.MjModel,
        demonstrations: Sequence[Demonstration],
    ) -> None:
        self._stream, self._model = stream, model
        self._demonstrations = demonstrations
        self._radius = mean_radius(demonstrations)
        self._rows = self._forecasts = 0
        self._stages: set[str] = set()

    def show(self, log: EpisodeLog, *, ended: bool = False) -> None:
        """Send the new part of the episode so far, which has two rows or more."""
        stream = self._stream
        if self._rows == 0:
            stream.send_recording_name(recording_name(log))
            stream.send_chunks(static_chunks(log, self._model, self._demonstrations))
        if log.times.size > self._rows:
            part = EpisodePart(
                log=log,
                first_row=self._rows,
                first_forecast=self._forecasts,
                demonstrated_radius=self._radius,
            )
            stream.send_chunks(part_chunks(part, self._model))
        stream.send_chunks(stage_lane(log, self._stages, ended=ended))
        if ended or self._rows == 0:
            stream.send_chunks(page(log, len(self._demonstrations), ended=ended))
        self._rows, self._forecasts = log.times.size, log.forecast_times.size
        self._stages |= {name for _, name in stages(log)}


@contextlib.contextmanager
def stream_to(url: str, arrangement: rrb.Blueprint) -> Iterator[rr.RecordingStream]:
    """Connect a stream to a viewer; all data has arrived when the block ends."""
    stream = open_stream()
    try:
        stream.connect_grpc(url, default_blueprint=arrangement)
        yield stream
        stream.flush(timeout_sec=_FLUSH_TIMEOUT)
    finally:
        stream.disconnect()
