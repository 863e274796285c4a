"""``gplfd view``: open a recording in the Rerun viewer."""

from __future__ import annotations

import importlib.util
import os
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import tyro

from experiments.commands.complaint import complain


@dataclass(frozen=True, kw_only=True, slots=True)
class View:
    """Open a recording (.rrd) in the Rerun viewer."""

    file: tyro.conf.Positional[Path]
    """Recording to open, for example results/gp-seed0/medium.rrd."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        try:
            check_recording(self.file)
            check_display(sys.platform, os.environ, self.file)
            command = [viewer(), str(self.file)]
        except (ValueError, OSError) as error:
            return complain(error)
        return subprocess.call(command)


def viewer() -> str:
    """Path of the viewer's own executable.

    The ``rerun`` script is a Python program that waits for the viewer; ending it would
    leave the viewer running.

    Raises:
        FileNotFoundError: The viewer is not installed.
    """
    package = importlib.util.find_spec("rerun_cli")
    if package is None or package.origin is None:
        raise FileNotFoundError(
            "the Rerun viewer is not installed; pip install rerun-sdk brings it"
        )
    name = "rerun.exe" if sys.platform == "win32" else "rerun"
    return str(Path(package.origin).with_name(name))


def check_recording(file: Path) -> None:
    """Raise unless ``file`` is a recording.

    Raises:
        FileNotFoundError: There is no such file.
        ValueError: It is a folder or another kind of file.
    """
    if file.is_dir():
        inside = ", ".join(sorted(path.name for path in file.glob("*.rrd")))
        raise ValueError(f"{file} is a folder; recordings in it: {inside or 'none'}")
    if not file.exists():
        raise FileNotFoundError(
            f"there is no file {file}; `gplfd run` writes recordings"
        )
    with file.open("rb") as stream:
        magic = stream.read(4)
    if magic[:2] != b"RR":
        raise ValueError(f"{file} is not a Rerun recording (.rrd)")


def check_display(platform: str, environment: Mapping[str, str], file: Path) -> None:
    """Raise when there is no screen to open a window on.

    Raises:
        ValueError: On Linux without an X or Wayland display.
    """
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    if platform.startswith("linux") and not any(map(environment.get, displays)):
        raise ValueError(
            "there is no display to open the viewer on. Copy the recording to a "
            "machine with a screen and run `gplfd view` or `rerun` there, or serve "
            f"it to a browser on this machine with `rerun --serve-web --bind "
            f"127.0.0.1 {file}` (over ssh, forward the two ports that it prints)."
        )
