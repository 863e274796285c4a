"""The Rerun stream that a recording is written to, and the chunks it is made of."""

import contextlib
import errno
import functools
import os
import tempfile
import warnings
from collections.abc import Iterable, Iterator
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


def frames(log: EpisodeLog) -> NDArray[np.intp]:
    """Return the rows of frames, evenly spaced, and the last row."""
    every = max(1, round(1.0 / (FRAMES_PER_SECOND * log.dt)))
    last = log.times.size - 1
    return np.unique(np.append(np.arange(0, last, every), last))


def static(entity: str, *archetypes: Any) -> Chunk:
    """Return the static data of an entity as one chunk."""
    batches = [
        batch for archetype in archetypes for batch in archetype.as_component_batches()
    ]
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
    # Rerun keeps threads of finished recordings until this function is called.
    bindings.flush_and_cleanup_orphaned_recordings()
    with complete_or_absent(path) as temporary:
        # Data is sent in whole chunks, so batching is not needed.
        gathering = rr.ChunkBatcherConfig.NEVER()
        stream = rr.RecordingStream(APPLICATION, batcher_config=gathering)
        # Wall-clock times of logging are irrelevant.
        stream.set_log_time_enabled(False)
        try:
            # `stream.save` makes a blueprint with two threads that are never ended.
            source = _blueprint_source(os.getpid())
            blueprint = source.memory_recording().storage
            source.send_chunks(_as_chunks(layout))
            recording = stream.to_native()
            bindings.save(str(temporary), blueprint, recording=recording)
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


def _as_chunks(layout: rrb.Blueprint) -> tuple[Chunk, ...]:
    """Return a layout as Rerun writes it."""
    with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
        # On a busy machine, the file has no table of contents yet.
        warnings.filterwarnings("ignore", "RRD file has no footer")
        file = Path(folder) / "layout.rbl"
        layout.save(APPLICATION, file)
        reader = RrdReader(file)
        return tuple(reader.stream(store=reader.blueprints()[0]))


@functools.cache
def _blueprint_source(process: int) -> rr.RecordingStream:
    """Stream of blueprints of this process; one from before a fork is unusable."""
    native = bindings.new_blueprint(
        APPLICATION, make_default=False, make_thread_default=False
    )
    return rr.RecordingStream._from_native(native)
