"""The Rerun stream that one recording is written to, and the chunks it is made of."""

import contextlib
import errno
import functools
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun_bindings as bindings
from numpy.typing import NDArray
from rerun.chunk import Chunk

from gplfd_policies.arrays.storage import complete_or_absent

APPLICATION: Final = "gplfd"
"""Application id: the viewer groups recordings and keeps layouts by it."""

TIMELINE: Final = "sim_time"
"""The only timeline: simulated time since reset."""


_END: Final = b"RRF2FOOT"
"""What stands before the last four bytes of a recording, its version."""


@contextlib.contextmanager
def recording_file(
    path: str | Path, layout: Iterable[Chunk]
) -> Iterator[rr.RecordingStream]:
    """Open a recording that appears at ``path`` complete or not at all.

    Args:
        path: File to write.
        layout: Chunks of the blueprint that it opens with.

    Raises:
        OSError: The file cannot be written.
    """
    # Rerun keeps two threads for every recording that it no longer writes to, until
    # the process ends or this is called.
    bindings.flush_and_cleanup_orphaned_recordings()
    with complete_or_absent(path) as temporary:
        stream = open_stream()
        try:
            source = _blueprint_source(os.getpid())
            blueprint = source.memory_recording().storage
            source.send_chunks(layout)
            # As `stream.save`, which makes a blueprint from scratch every time, and
            # with it two threads that stay.
            bindings.save(
                str(temporary),
                default_blueprint=blueprint,
                recording=stream.to_native(),
            )
            yield stream
            stream.flush()
        finally:
            stream.disconnect()
        _check_complete(temporary)


def _check_complete(file: Path) -> None:
    """Look for the end of a recording; Rerun only logs that it could not write.

    Raises:
        OSError: The file is cut off.
    """
    with file.open("rb") as stream:
        stream.seek(-min(len(_END) + 4, file.stat().st_size), os.SEEK_END)
        if not stream.read().startswith(_END):
            raise OSError(errno.EIO, "cannot be written to its end; is the disk full?")


@functools.cache
def _blueprint_source(process: int) -> rr.RecordingStream:
    """Stream of blueprints; that of another process, before a fork, is of no use."""
    native = bindings.new_blueprint(
        application_id=APPLICATION, make_default=False, make_thread_default=False
    )
    return rr.RecordingStream._from_native(native)


def open_stream() -> rr.RecordingStream:
    """Open a stream that leads nowhere yet."""
    # What is sent is sent in whole chunks: there is nothing to gather into larger ones.
    gathering = rr.ChunkBatcherConfig.NEVER()
    stream = rr.RecordingStream(APPLICATION, batcher_config=gathering)
    # Wall-clock times of logging say nothing about the episode.
    stream.set_log_time_enabled(False)
    return stream


def static(entity: str, *archetypes: Any) -> Chunk:
    """Return what is true of an entity at all times, as one chunk."""
    batches = [batch for one in archetypes for batch in one.as_component_batches()]
    columns = [batch.partition([len(batch.as_arrow_array())]) for batch in batches]
    return Chunk.from_columns(entity, [], columns)


def moving(entity: str, times: list[rr.TimeColumn], columns: Iterable[Any]) -> Chunk:
    """Return what changes in an entity, a row per time, as one chunk."""
    return Chunk.from_columns(entity, times, columns)


def stretch(columns: Iterable[Any], first: int, size: int) -> list[Any]:
    """Return ``size`` rows of columns from ``first`` on, without copying them."""
    return [_Stretch(column, first, size) for column in columns]


class _Stretch:
    """A stretch of a column of Rerun's."""

    def __init__(self, column: Any, first: int, size: int) -> None:
        self._column, self._first, self._size = column, first, size

    def component_descriptor(self) -> Any:
        return self._column.component_descriptor()

    def as_arrow_array(self) -> Any:
        return self._column.as_arrow_array().slice(self._first, self._size)


def seconds(times: NDArray[np.float64]) -> list[rr.TimeColumn]:
    """Index columns for values at simulated ``times`` (N,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=times)]
