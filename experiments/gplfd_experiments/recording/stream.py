"""Writes a recording: the chunks that it is made of, its layout and its file."""

import functools
import os
import tempfile
import warnings
from collections.abc import Iterable
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

TEXT: Final = "/about"  # Entity of the page that explains a recording.

_APPLICATION: Final = "gplfd"  # The viewer groups recordings and keeps layouts by it.
_TIMELINE: Final = "sim_time"  # Simulated time since reset.
_FRAMES_PER_SECOND: Final = 30.0


def frames(log: EpisodeLog) -> NDArray[np.intp]:
    """Return the rows of frames of the scene, evenly spaced, and the last row."""
    every = max(1, round(1.0 / (_FRAMES_PER_SECOND * log.dt)))
    last = log.times.size - 1
    return np.unique(np.append(np.arange(0, last, every), last))


def static(entity: str, *archetypes: Any) -> Chunk:
    """Return the static data of an entity as one chunk."""
    columns = [
        batch.partition([len(batch.as_arrow_array())])
        for archetype in archetypes
        for batch in archetype.as_component_batches()
    ]
    return Chunk.from_columns(entity, [], columns)


def moving(entity: str, times: FloatArray, columns: Iterable[Any]) -> Chunk:
    """Return the data of an entity at simulated times (N,) [s] as one chunk."""
    index = [rr.TimeColumn(_TIMELINE, duration=times)]
    return Chunk.from_columns(entity, index, columns)


def page(text: str) -> Chunk:
    """Return the page that explains a recording, in Markdown."""
    return static(TEXT, rr.TextDocument(text, media_type=rr.MediaType.MARKDOWN))


def write_recording(
    path: str | Path, name: str, views: rrb.Container, chunks: Iterable[Chunk]
) -> None:
    """Write an .rrd that opens with views, complete or not at all (`OSError`)."""
    # Rerun keeps threads of finished recordings until this function is called.
    bindings.flush_and_cleanup_orphaned_recordings()
    # Data is sent in whole chunks, so batching is not needed.
    batcher = rr.ChunkBatcherConfig.NEVER()
    stream = rr.RecordingStream(_APPLICATION, batcher_config=batcher)
    stream.set_log_time_enabled(False)  # Wall-clock times are irrelevant.
    hidden = (rrb.BlueprintPanel, rrb.SelectionPanel, rrb.TopPanel)
    layout = rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=_TIMELINE, state="collapsed", play_state="playing"),
        *(panel(state="hidden") for panel in hidden),
        auto_views=False,
        auto_layout=False,
    )
    try:
        # In memory, because Rerun's thread for a file hangs or ends on a full disk.
        recording = stream.memory_recording().storage
        source = _blueprint_source(os.getpid())
        blueprint = source.memory_recording().storage
        with tempfile.TemporaryDirectory() as folder, warnings.catch_warnings():
            # On a busy machine, the file has no table of contents yet.
            warnings.filterwarnings("ignore", "RRD file has no footer")
            file = Path(folder) / "layout.rbl"
            layout.save(_APPLICATION, file)
            reader = RrdReader(file)
            source.send_chunks(reader.stream(store=reader.blueprints()[0]))
        bindings.send_blueprint(blueprint, False, True, recording=stream.to_native())
        stream.send_recording_name(name)
        stream.send_chunks(chunks)
        content = recording.drain_as_bytes()
    finally:
        stream.disconnect()
    with complete_or_absent(path) as temporary:
        temporary.write_bytes(content)


@functools.cache
def _blueprint_source(process: int) -> rr.RecordingStream:
    """Stream of blueprints of this process; one from before a fork is unusable."""
    native = bindings.new_blueprint(
        _APPLICATION, make_default=False, make_thread_default=False
    )
    return rr.RecordingStream._from_native(native)
