"""The journal of a served agent as a recording: curves over time, and messages."""

from collections import defaultdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gplfd_experiments.console.progress import LOG
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.layout import Plot, series_view
from gplfd_experiments.recording.panels import Line, series
from gplfd_experiments.recording.stream import moving, write_recording
from gplfd_policies.serving.journal import BEGINNING, read_journal

_LINES: Final = (
    Line("x", colours.AXIS_X),
    Line("y", colours.TRUTH),
    Line("z", colours.AXIS_Z),
)
_PANELS: Final = {
    "pose": "Commanded position [m]: x orange, y green, z blue",
    "ee_pose": "Measured position [m]",
    "wrench": "Measured force [N]",
    "stiffness": "Stiffness [N/m]",
}
_CURVES: Final = {
    "reset": ("ee_pose", "wrench"),
    "observe": ("ee_pose", "wrench"),
    "command": ("pose", "stiffness"),
}
"""Curves by type of message; other fields and messages may contain anything."""
_LOG: Final = "/events"


def recording_of(file: Path) -> Path:
    """Return a recording; a journal is first converted to a recording in its folder.

    Raises ValueError for a journal that is damaged or holds no message.
    """
    if not file.is_file():
        return file
    with file.open("rb") as stream:
        if stream.read(len(BEGINNING)) != BEGINNING:
            return file
    curves: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    events: list[tuple[float, str]] = []
    for line in read_journal(file):
        out = line.get("out", [])
        refused = any(message["type"] == "error" for message in out)
        for message in (line.get("in"), *out):
            fields = message if isinstance(message, dict) else {"type": message}
            for name in () if refused else _CURVES.get(fields["type"], ()):
                curves[name].append((line["at"], fields[name][:3]))
            words = map(fields.get, ("type", "state", "reason", "limited", "message"))
            text = " ".join(str(word) for word in words if word)
            if text not in ("", "observe", *(last for _, last in events[-1:])):
                events.append((line["at"], text))
    if not events:
        raise ValueError(f"{file} holds no message yet")
    panels = [series_view(Plot(*p)) for p in _PANELS.items() if p[0] in curves]
    log = rrb.TextLogView(origin=_LOG, name="States, reasons and errors")
    views = rrb.Horizontal(rrb.Vertical(*panels), log, column_shares=[3, 2])
    at, texts = map(list, zip(*events, strict=True))
    start = at[0]
    columns = rr.TextLog.columns(text=texts)
    chunks = [moving(_LOG, np.array(at) - start, columns)]
    for name, samples in curves.items():
        times, values = map(np.array, zip(*samples, strict=True))
        lines = dict(zip(_LINES, values.astype(np.float64).T, strict=True))
        chunks += series(f"/{name}", times - start, lines)
    recording = file.with_name(f"{file.name}.rrd")
    LOG.info("writing %s", recording)
    write_recording(recording, recording.stem, views, chunks)
    return recording
