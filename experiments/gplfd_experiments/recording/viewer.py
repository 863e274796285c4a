"""The Rerun viewer on this machine: recordings, and journals of served agents."""

import importlib.util
import os
import subprocess
import sys
from collections import defaultdict
from pathlib import Path
from typing import Any, Final

import numpy as np
import rerun as rr
import rerun.blueprint as rrb

from gplfd_env.conventions.opengl import has_display
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.panels import Line, Panel, series
from gplfd_experiments.recording.stream import moving, write_recording
from gplfd_policies.arrays.storage import regular_file
from gplfd_policies.serving.protocol import BEGINNING, read_journal

_AXES: Final = (colours.AXIS_X, colours.TRUTH, colours.AXIS_Z)
_LINES: Final = tuple(map(Line, "xyz", _AXES))
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
_EVENTS: Final = "/events"


def viewer() -> str:
    """Path of the viewer's own executable, or FileNotFoundError."""
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise FileNotFoundError(
            "the Rerun viewer is not installed; pip install rerun-sdk brings it"
        )
    # Not the script ``rerun``: if that is terminated, the viewer keeps running.
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return str(Path(package.origin).with_name(name))


def open_recording(file: Path) -> int:
    """Open a recording in the viewer; return its exit status once it is closed.

    A journal is first converted to a recording; ValueError for a damaged one.
    """
    if file.is_dir():
        inside = ", ".join(sorted(path.name for path in file.glob("*.rrd")))
        raise ValueError(f"{file} is a folder; recordings in it: {inside or 'none'}")
    if not file.exists():
        raise FileNotFoundError(f"there is no file {file}; `gplfd run` writes one")
    with regular_file(file, "a Rerun recording (.rrd)").open("rb") as stream:
        beginning = stream.read(len(BEGINNING))
    if beginning == BEGINNING:
        file = _recorded(file)
    elif beginning[:2] != b"RR":
        raise ValueError(
            f"{file} is neither a Rerun recording (.rrd) nor a journal of gplfd serve"
        )
    if not has_display(sys.platform, os.environ):
        raise ValueError(
            "there is no display to open the viewer on. Copy the recording to a "
            "machine with a screen and run `gplfd view` or `rerun` there, or serve "
            f"it to a browser on this machine with `rerun --serve-web --bind "
            f"127.0.0.1 {file}` (over ssh, forward the two ports that it prints)."
        )
    # An absolute path, because the viewer would parse `--version.rrd` as an option.
    # Otherwise, the viewer listens on every address of this machine.
    return subprocess.call([viewer(), "--bind", "127.0.0.1", str(file.absolute())])


def _recorded(journal: Path) -> Path:
    """Write a journal as a recording: curves over time, and messages."""
    curves: dict[str, list[tuple[float, Any]]] = defaultdict(list)
    events: list[tuple[float, str]] = []
    for line in read_journal(journal):
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
        raise ValueError(f"{journal} holds no message yet")
    at, texts = zip(*events, strict=True)
    chunks = [moving(_EVENTS, np.array(at) - at[0], rr.TextLog.columns(text=texts))]
    for name, samples in curves.items():
        times, values = map(np.array, zip(*samples, strict=True))
        lines = dict(zip(_LINES, values.astype(np.float64).T, strict=True))
        chunks += series(f"/{name}", times - at[0], lines)
    plots = [Panel(*panel).view("") for panel in _PANELS.items() if panel[0] in curves]
    log = rrb.TextLogView(origin=_EVENTS, name="States, reasons and errors")
    views = rrb.Horizontal(rrb.Vertical(*plots), log, column_shares=[3, 2])
    recording = journal.with_name(f"{journal.name}.rrd")
    LOG.info("writing %s", recording)
    write_recording(recording, recording.stem, views, chunks)
    return recording
