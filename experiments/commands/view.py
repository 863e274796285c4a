"""``gplfd view``: open a recording in the Rerun viewer, or watch an episode live."""

from __future__ import annotations

import dataclasses
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
    """Open a recording (.rrd) in the Rerun viewer, or watch an episode live."""

    file: tyro.conf.Positional[Path | None] = None
    """Recording to open, for example results/gp-seed0/medium.rrd."""

    live: bool = False
    """Instead of opening a recording, run an episode and watch it."""

    door: str = "medium"
    """With --live: the door to open, a name (see `gplfd list`) or a radius [m]."""

    policy: str = "gp"
    """With --live: the policy to use; see `gplfd list`."""

    seed: int = 0
    """With --live: seed of teacher, policy and environment, 0 or more."""

    speed: float = 1.0
    """With --live: simulated seconds per second."""

    serve: bool = False
    """With --live: serve a browser on this machine instead of opening a window."""

    def execute(self) -> int:
        """Run the command and return the exit status."""
        try:
            if self.live:
                from experiments.commands.live import watch

                return watch(self)
            command = [viewer(), str(self._recording())]
        except (ValueError, OSError) as error:
            return complain(error)
        return subprocess.call(command)

    def _recording(self) -> Path:
        """Return the recording to open.

        Raises:
            ValueError: There is none or no screen, or options are for --live.
            FileNotFoundError: There is no such file.
        """
        if self.file is None:
            raise ValueError(
                "give a recording to open, for example results/gp-seed0/medium.rrd, or "
                "--live to run an episode and watch it"
            )
        for option in dataclasses.fields(self):
            given = getattr(self, option.name)
            if option.name != "file" and given != option.default:
                raise ValueError(f"--{option.name} goes with --live, not with a file")
        check_recording(self.file)
        check_display(sys.platform, os.environ, self.file)
        return self.file


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
    if not has_display(platform, environment):
        raise ValueError(
            "there is no display to open the viewer on. Copy the recording to a "
            "machine with a screen and run `gplfd view` or `rerun` there, or serve "
            f"it to a browser on this machine with `rerun --serve-web --bind "
            f"127.0.0.1 {file}` (over ssh, forward the two ports that it prints)."
        )


def has_display(platform: str, environment: Mapping[str, str]) -> bool:
    """Whether there is a screen: on Linux, whether X or Wayland names one."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    return not platform.startswith("linux") or any(map(environment.get, displays))
