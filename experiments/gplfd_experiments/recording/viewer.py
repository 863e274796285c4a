"""The Rerun viewer on this machine, and whether there is a screen for it."""

import importlib.util
import os
import subprocess
import sys
from pathlib import Path

from gplfd_env.conventions.opengl import has_display
from gplfd_policies.arrays.storage import regular_file


def viewer() -> str:
    """Path of the viewer's own executable, or FileNotFoundError.

    The ``rerun`` script is a Python program that waits for the viewer; if it is
    terminated, the viewer keeps running.
    """
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise FileNotFoundError(
            "the Rerun viewer is not installed; pip install rerun-sdk brings it"
        )
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return str(Path(package.origin).with_name(name))


def open_recording(file: Path) -> int:
    """Open a recording in the viewer; return its exit status once it is closed."""
    if file.is_dir():
        inside = ", ".join(sorted(path.name for path in file.glob("*.rrd")))
        raise ValueError(f"{file} is a folder; recordings in it: {inside or 'none'}")
    if not file.exists():
        raise FileNotFoundError(
            f"there is no file {file}; `gplfd run` writes recordings"
        )
    with regular_file(file, "a Rerun recording (.rrd)").open("rb") as stream:
        magic = stream.read(4)
    if magic[:2] != b"RR":
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
