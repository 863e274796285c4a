"""What is installed on this machine, and what is missing for optional parts.

MuJoCo is imported in a child process only: the import fails with a ``MUJOCO_GL`` that
this machine does not support, and a rendering that fails may end its process.
"""

import dataclasses
import importlib.metadata
import os
import platform
import re
import subprocess
import sys
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any, Final

import loky

from gplfd_experiments.files.provenance import versions
from gplfd_experiments.recording.viewer import has_display, viewer
from gplfd_experiments.speed.machine import processor

EXTRAS: Final[Mapping[str, str]] = MappingProxyType(
    {
        "dask": "studies on a cluster",
        "ros": "bags of ROS",
        "lerobot": "data sets of LeRobot",
        "robomimic": "files of robomimic",
        "minari": "data sets of episodes",
        "sb3": "learners of Stable-Baselines3",
        "warp": "doors on a GPU, an experiment",
        "video": "videos of `gplfd run --video`",
        "tiago": "the manufacturer's meshes in recordings",
        "bench": "the libraries that are compared with",
    }
)
"""Extras of this package, and what they are for; those of developers left out."""

_DRAW: Final = (
    "import mujoco\n"
    "model = mujoco.MjModel.from_xml_string('<mujoco/>')\n"
    "renderer = mujoco.Renderer(model, 8, 8)\n"
    "renderer.render()\n"
    "from OpenGL import GL\n"
    "print(GL.glGetString(GL.GL_RENDERER).decode())\n"
)
_PATIENCE: Final = 120.0
"""Longest time for a drawing [s]."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Part:
    """Something optional.

    Attributes:
        purpose: What it is for.
        present: Whether it is here.
        remark: What was found, or how to get what is missing.
    """

    purpose: str
    present: bool
    remark: str


@dataclass(frozen=True, kw_only=True, slots=True)
class Examination:
    """What was found.

    Attributes:
        machine: Names and values, of Python and of the computer.
        packages: Versions of those that decide results.
        parts: What is optional, by name.
    """

    machine: Mapping[str, Any]
    packages: Mapping[str, str]
    parts: Mapping[str, Part]

    def as_json(self) -> dict[str, Any]:
        """Return plain data."""
        return {
            "machine": dict(self.machine),
            "packages": dict(self.packages),
            "parts": {k: dataclasses.asdict(part) for k, part in self.parts.items()},
        }


def examined() -> Examination:
    """Look at this machine; takes as long as a rendering or two."""
    # Try the ways in which MuJoCo may render here.
    given = os.environ.get("MUJOCO_GL")
    hint = f"MUJOCO_GL={given} does not work here; unset it, or " if given else ""
    pictures = Part(
        purpose='render_mode="rgb_array"',
        present=False,
        remark=f"{hint}install EGL (Debian, Ubuntu: apt-get install libegl1 "
        "libegl-mesa0 libgl1-mesa-dri) or OSMesa, see docs/environment.md",
    )
    for way in ways(sys.platform, os.environ):
        if renderer := drawn_by(way):
            set_as = f"with MUJOCO_GL={way}, " if way else ""
            remark = f"{set_as}drawn by {renderer}"
            pictures = dataclasses.replace(pictures, present=True, remark=remark)
            break

    display = has_display(sys.platform, os.environ)
    windows = Part(
        purpose='render_mode="human", gplfd view',
        present=display,
        remark="there is a display"
        if display
        else "neither DISPLAY nor WAYLAND_DISPLAY names a display; copy recordings to "
        "a machine with a screen, or `gplfd view --live --serve`",
    )
    try:
        rerun, present = viewer(), True
    except FileNotFoundError as error:
        rerun, present = str(error), False

    # Every distribution that an extra asks for.
    extras = {}
    for name, purpose in EXTRAS.items():
        found, missing = [], []
        for requirement in importlib.metadata.requires("gplfd") or ():
            if re.search(rf"""extra == ['"]{name}['"]""", requirement):
                one = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
                try:
                    found.append(f"{one} {importlib.metadata.version(one)}")
                except importlib.metadata.PackageNotFoundError:
                    missing.append(one)
        remark = ", ".join(found)
        if missing:
            remark = f"{', '.join(missing)} missing; pip install 'gplfd[{name}]'"
        extras[name] = Part(purpose=purpose, present=not missing, remark=remark)

    return Examination(
        machine={
            "python": platform.python_version(),
            "system": platform.platform(),
            "processor": processor(),
            "cores": os.cpu_count(),
            # Less in a container, or with an affinity.
            "default_workers": loky.cpu_count(),
            "installed_in": str(Path(__file__).parents[1]),
        },
        packages=versions(),
        parts={
            "pictures": pictures,
            "windows": windows,
            "viewer": Part(purpose="gplfd view", present=present, remark=rerun),
            **extras,
        },
    )


def text(found: Examination) -> str:
    """Return what was found, for people."""
    parts = {
        name: f"{'yes' if part.present else 'NO '}  {part.purpose}: {part.remark}"
        for name, part in found.parts.items()
    }
    sections = {"machine": found.machine, "packages": found.packages, "parts": parts}
    width = max(len(name) for lines in sections.values() for name in lines)
    return "\n\n".join(
        "\n".join([title, *(f"  {k:<{width}}  {v}" for k, v in lines.items())])
        for title, lines in sections.items()
    )


def ways(system: str, environment: Mapping[str, str]) -> tuple[str, ...]:
    """Return values of MUJOCO_GL that may work, "" for none; first what is set."""
    if environment.get("MUJOCO_GL"):
        return (environment["MUJOCO_GL"],)
    if not system.startswith("linux"):
        return ("",)
    return (*([""] if has_display(system, environment) else []), "egl", "osmesa")


def drawn_by(way: str) -> str:
    """Draw in a child process and return what OpenGL calls itself; "" if it fails."""
    try:
        drawn = subprocess.run(
            [sys.executable, "-c", _DRAW],
            env=os.environ | ({"MUJOCO_GL": way} if way else {}),
            capture_output=True,
            text=True,
            check=False,
            timeout=_PATIENCE,
        )
    except (OSError, subprocess.TimeoutExpired):
        return ""
    lines = drawn.stdout.splitlines()
    return lines[-1] if drawn.returncode == 0 and lines else ""
