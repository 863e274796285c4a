"""The Rerun stream that one recording is written to, and its timeline."""

from __future__ import annotations

import contextlib
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
from numpy.typing import NDArray

from experiments.atomic_write import complete_or_absent

APPLICATION: Final = "gplfd"
"""Application id: the viewer groups recordings and keeps layouts by it."""

TIMELINE: Final = "sim_time"
"""The only timeline: simulated time since reset."""


@contextlib.contextmanager
def recording_file(path: str | Path, blueprint: Any) -> Iterator[rr.RecordingStream]:
    """Open a recording that appears at ``path`` complete or not at all."""
    with complete_or_absent(path) as temporary:
        stream = rr.RecordingStream(APPLICATION)
        # Wall-clock times of logging say nothing about the episode.
        stream.set_log_time_enabled(False)
        try:
            stream.save(temporary, default_blueprint=blueprint)
            yield stream
            stream.flush()
        finally:
            stream.disconnect()


def seconds(times: NDArray[np.float64]) -> list[rr.TimeColumn]:
    """Index columns for values at simulated ``times`` (N,) [s]."""
    return [rr.TimeColumn(TIMELINE, duration=times)]
