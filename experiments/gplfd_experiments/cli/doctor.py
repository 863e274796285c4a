"""Checks what is installed on this machine, and what is missing for optional parts.

MuJoCo is imported in a child process only: the import fails with a ``MUJOCO_GL`` that
this machine does not support, and a failed rendering may end the process.
"""

import importlib.metadata
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import joblib

from gplfd_env.conventions.opengl import has_display
from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording.viewer import viewer

EXTRAS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "dask": "studies on a cluster",
        "ros": "ROS bags",
        "lerobot": "LeRobot data sets",
        "c3d": "C3D files",
        "robomimic": "robomimic files",
        "minari": "episode data sets",
        "sb3": "Stable-Baselines3 learners",
        "learners": "the diffusion policy of the examples",
        "warp": "doors on a GPU (experimental)",
        "video": "videos of `gplfd run --video`",
    }
)
"""Extras of this package and their purpose, without those for developers."""

_DRAW: Final = (
    "import mujoco\n"
    "model = mujoco.MjModel.from_xml_string('<mujoco/>')\n"
    "renderer = mujoco.Renderer(model, 8, 8)\n"
    "renderer.render()\n"
    "from OpenGL import GL\n"
    "print(GL.glGetString(GL.GL_RENDERER).decode())\n"
)
_PATIENCE: Final = 120.0  # Longest time for a rendering [s].


def examined() -> dict[str, Any]:
    """Check this machine, its packages, and optional parts.

    Takes as long as one or two renderings. Returns for each part its purpose, whether
    it is present, and what was found or how to install it.
    """
    # Try the backends with which MuJoCo may render here.
    chosen = os.environ.get("MUJOCO_GL")
    remark = f"MUJOCO_GL={chosen} does not work here; unset it, or " if chosen else ""
    remark += (
        "install EGL (Debian, Ubuntu: apt-get install libegl1 libegl-mesa0 "
        "libgl1-mesa-dri) or OSMesa, see docs/environment.md"
    )
    possible = ways(sys.platform, os.environ)
    drawn = next(((way, by) for way in possible if (by := drawn_by(way))), None)
    if drawn is not None:
        way, renderer = drawn
        remark = f"with MUJOCO_GL={way}, " * bool(way) + f"drawn by {renderer}"
    rows = [("pictures", 'render_mode="rgb_array"', drawn is not None, remark)]
    display = has_display(sys.platform, os.environ)
    remark = "there is a display"
    if not display:
        remark = (
            "neither DISPLAY nor WAYLAND_DISPLAY names a display; copy recordings to a "
            "machine with a screen"
        )
    rows.append(("windows", 'render_mode="human", gplfd view', display, remark))
    try:
        rows.append(("viewer", "gplfd view", True, viewer()))
    except FileNotFoundError as error:
        rows.append(("viewer", "gplfd view", False, str(error)))
    # Every distribution that an extra requires.
    for name, purpose in EXTRAS.items():
        installed, missing = [], []
        for requirement in importlib.metadata.requires("gplfd") or ():
            if re.search(rf"""extra == ['"]{name}['"]""", requirement):
                package = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
                try:
                    version = importlib.metadata.version(package)
                    installed.append(f"{package} {version}")
                except importlib.metadata.PackageNotFoundError:
                    missing.append(package)
        remark = ", ".join(installed)
        if missing:
            remark = f"{', '.join(missing)} missing; pip install 'gplfd[{name}]'"
        rows.append((name, purpose, not missing, remark))

    machine = {
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": processor(),
        "cores": os.cpu_count(),
        # Fewer in a container, or with a CPU affinity.
        "default_workers": joblib.cpu_count(),
        "installed_in": str(Path(__file__).parents[1]),
    }
    parts = {
        name: {"purpose": purpose, "present": present, "remark": remark}
        for name, purpose, present, remark in rows
    }
    return {"machine": machine, "packages": dict(versions()), "parts": parts}


def sections(results: Mapping[str, Mapping[str, Any]]) -> dict[str, Mapping[str, Any]]:
    """Return the results of `examined` with one line for each part."""
    parts = {
        name: ("yes  " if part["present"] else "NO   ")
        + f"{part['purpose']}: {part['remark']}"
        for name, part in results["parts"].items()
    }
    return {**results, "parts": parts}


def processor() -> str:
    """Return the name of the processor, which `platform` lacks on Linux."""
    try:
        text = Path("/proc/cpuinfo").read_text(encoding="utf-8")
    except OSError:
        text = ""
    names = re.findall(r"model name\s*:\s*(.*)", text)
    return names[0] if names else platform.processor()


def ways(system: str, environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return values of MUJOCO_GL to try, "" for unset; a present value alone."""
    if environment.get("MUJOCO_GL"):
        return (environment["MUJOCO_GL"],)
    if not system.startswith("linux"):
        return ("",)
    return (*([""] if has_display(system, environment) else []), "egl", "osmesa")


def drawn_by(way: str) -> str:
    """Render in a child process and return the name of the renderer; "" if it fails."""
    try:
        drawn = subprocess.run(
            [sys.executable, "-c", _DRAW],
            env=os.environ | ({"MUJOCO_GL": way} if way else {}),
            capture_output=True,
            text=True,
            check=True,
            timeout=_PATIENCE,
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return drawn.stdout.strip().rpartition("\n")[2]
