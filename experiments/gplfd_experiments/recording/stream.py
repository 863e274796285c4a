"""The Rerun stream that a recording is written to, and the chunks it is made of."""

import contextlib
import errno
import functools
import math
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
import rerun_bindings as bindings
from numpy.typing import NDArray
from rerun.chunk import Chunk, RrdReader

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_policies.arrays.storage import complete_or_absent

APPLICATION: Final = "gplfd"
"""Application id: the viewer groups recordings and keeps layouts by it."""

TIMELINE: Final = "sim_time"
"""The only timeline: simulated time since reset."""

FRAMES_PER_SECOND: Final = 30.0
"""Frame rate of moving things in the scene, that of a video."""

_END: Final = b"RRF2FOOT"
"""Bytes before the last four bytes of a recording, which are its version."""


@dataclass(frozen=True, kw_only=True, slots=True)
class EpisodePart:
    """Rows and forecasts of an episode so far that are not shown yet.

    A recording shows an episode at once, a live view part by part, with the same
    functions. A later part never changes an earlier one.
    """

    log: EpisodeLog
    first_row: int = 0
    first_forecast: int = 0
    demonstrated_radius: float = math.nan
    """Geometric mean of the radii of the demonstrated paths [m]; NaN if they are not
    circles."""

    @property
    def times(self) -> FloatArray:
        """Times of its rows [s]."""
        return self.log.times[self.first_row :]

    def frames(self) -> NDArray[np.intp]:
        """Rows of frames, evenly spaced, and the last row."""
        every = max(1, round(1.0 / (FRAMES_PER_SECOND * self.log.dt)))
        last = self.log.times.size - 1
        start = -(-self.first_row // every) * every
        return np.unique(np.append(np.arange(start, last, every), last))

    def shows(self, values: FloatArray) -> bool:
        """Whether any of a series' values (T, ...) in this part is finite."""
        return bool(np.isfinite(values[self.first_row :]).any())

    def begins(self, values: FloatArray) -> bool:
        """Whether none of a series' values (T, ...) before this part was finite."""
        return not np.isfinite(values[: self.first_row]).any()


def static(entity: str, *archetypes: Any) -> Chunk:
    """Return the static data of an entity as one chunk."""
    batches = [batch for one in archetypes for batch in one.as_component_batches()]
    columns = [batch.partition([len(batch.as_arrow_array())]) for batch in batches]
    return Chunk.from_columns(entity, [], columns)


def moving(entity: str, times: FloatArray, columns: Iterable[Any]) -> Chunk:
    """Return the data of an entity at simulated times (N,) [s] as one chunk."""
    index = [rr.TimeColumn(TIMELINE, duration=times)]
    return Chunk.from_columns(entity, index, columns)


@contextlib.contextmanager
def recording_file(
    path: str | Path, layout: rrb.Blueprint
) -> Iterator[rr.RecordingStream]:
    """Open a recording that appears at ``path`` complete or not at all (`OSError`).

    It opens with the given layout.
    """
    # Rerun keeps two threads for every finished recording until the process ends or
    # this function is called.
    bindings.flush_and_cleanup_orphaned_recordings()
    with complete_or_absent(path) as temporary:
        stream = open_stream()
        try:
            source = _blueprint_source(os.getpid())
            blueprint = source.memory_recording().storage
            source.send_chunks(_as_chunks(layout))
            # `stream.save` would make a new blueprint each time, with two threads that
            # are not ended.
            bindings.save(
                str(temporary),
                default_blueprint=blueprint,
                recording=stream.to_native(),
            )
            yield stream
            stream.flush()
        finally:
            stream.disconnect()
        # Rerun only logs write errors, so check the end of the file.
        with temporary.open("rb") as written:
            written.seek(-min(len(_END) + 4, temporary.stat().st_size), os.SEEK_END)
            if not written.read().startswith(_END):
                message = "cannot be written to its end; is the disk full?"
                raise OSError(errno.EIO, message)


# The recordings of a study have few different ones.
@functools.lru_cache(maxsize=16)
def _as_chunks(layout: rrb.Blueprint) -> tuple[Chunk, ...]:
    """Return a layout as Rerun writes it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "layout.rbl"
        layout.save(APPLICATION, file)
        with warnings.catch_warnings():
            # On a busy machine, it has no table of contents yet and is read completely.
            warnings.filterwarnings("ignore", "RRD file has no footer")
            reader = RrdReader(file)
            return tuple(reader.stream(store=reader.blueprints()[0]))


@functools.cache
def _blueprint_source(process: int) -> rr.RecordingStream:
    """Stream of blueprints of this process; one from before a fork is unusable."""
    native = bindings.new_blueprint(
        application_id=APPLICATION, make_default=False, make_thread_default=False
    )
    return rr.RecordingStream._from_native(native)


def open_stream() -> rr.RecordingStream:
    """Open a stream without a destination."""
    # Data is sent in whole chunks, so batching is not needed.
    gathering = rr.ChunkBatcherConfig.NEVER()
    stream = rr.RecordingStream(APPLICATION, batcher_config=gathering)
    # Wall-clock times of logging are irrelevant.
    stream.set_log_time_enabled(False)
    return stream
