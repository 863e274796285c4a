"""The Rerun viewer on this machine, and whether there is a screen for it."""

import contextlib
import importlib.util
import os
import socket
import subprocess
import sys
import time
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Final
from urllib.parse import quote

from gplfd_experiments.console.progress import LOG
from gplfd_policies.arrays.storage import regular_file

LOOPBACK: Final = "127.0.0.1"
"""Address of the viewer, which other machines cannot reach."""

_START_TIMEOUT: Final = 30.0


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


def has_display(platform: str, environment: Mapping[str, str]) -> bool:
    """Whether there is a screen; on Linux, whether X or Wayland has a display."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    return not platform.startswith("linux") or any(map(environment.get, displays))


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
    return subprocess.call([viewer(), str(file.absolute())])


@contextlib.contextmanager
def viewer_process(*, serve: bool) -> Iterator[tuple[subprocess.Popen[bytes], str]]:
    """Start a viewer on loopback; yield its process and its data address."""
    with socket.socket() as first, socket.socket() as second:
        # Two free ports.
        for each in (first, second):
            each.bind((LOOPBACK, 0))
        port, web_port = first.getsockname()[1], second.getsockname()[1]
    url = f"rerun+http://{LOOPBACK}:{port}/proxy"
    command = [viewer(), "--bind", LOOPBACK, "--port", str(port)]
    if serve:
        command += ["--serve-web", "--web-viewer-port", str(web_port)]
    # Only errors, unless the user sets another level.
    process = subprocess.Popen(command, env={"RUST_LOG": "warn", **os.environ})
    try:
        # Until the viewer listens at the port.
        deadline, listening = time.monotonic() + _START_TIMEOUT, False
        while not listening:
            if process.poll() is not None:
                raise OSError(
                    f"the viewer ended with status {process.returncode}; without a "
                    "screen or graphics driver, `gplfd view --live --serve` serves a "
                    "browser"
                )
            if time.monotonic() >= deadline:
                raise OSError(f"the viewer did not answer within {_START_TIMEOUT:g} s")
            with contextlib.suppress(OSError):
                socket.create_connection((LOOPBACK, port), timeout=1.0).close()
                listening = True
            time.sleep(0.05)
        if serve:
            address = f"http://{LOOPBACK}:{web_port}/?url={quote(url, safe='')}"
            LOG.info("watch it at  %s", address)
            if sys.stdin.isatty():
                input("press Enter to start the episode ")
        yield process, url
    finally:
        process.terminate()
        process.wait()
