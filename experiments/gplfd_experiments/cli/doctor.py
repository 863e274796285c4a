"""What this machine has, and what it lacks for optional parts; looks, changes nothing.

MuJoCo is not imported here: with a ``MUJOCO_GL`` that this machine cannot serve, that
alone fails, and a drawing that fails may end its process. Both happen in a child.
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
    """Look at this machine; takes as long as a drawing or two."""
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
            "pictures": _pictures(),
            "windows": _windows(),
            "viewer": _viewer(),
            **{name: _extra(name, purpose) for name, purpose in EXTRAS.items()},
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


def _pictures() -> Part:
    """Find the way, if any, by which MuJoCo draws here, and what draws."""
    for way in ways(sys.platform, os.environ):
        artist = drawn_by(way)
        if artist:
            set_as = f"with MUJOCO_GL={way}, " if way else ""
            return Part(
                purpose='render_mode="rgb_array"',
                present=True,
                remark=f"{set_as}drawn by {artist}",
            )
    given = os.environ.get("MUJOCO_GL")
    return Part(
        purpose='render_mode="rgb_array"',
        present=False,
        remark=(f"MUJOCO_GL={given} does not work here; unset it, or " if given else "")
        + "install EGL (Debian, Ubuntu: apt-get install libegl1 libegl-mesa0 "
        "libgl1-mesa-dri) or OSMesa, see docs/environment.md",
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


def _windows() -> Part:
    present = has_display(sys.platform, os.environ)
    return Part(
        purpose='render_mode="human", gplfd view',
        present=present,
        remark="there is a display"
        if present
        else "neither DISPLAY nor WAYLAND_DISPLAY names a display; copy recordings to "
        "a machine with a screen, or `gplfd view --live --serve`",
    )


def _viewer() -> Part:
    try:
        found, present = viewer(), True
    except FileNotFoundError as error:
        found, present = str(error), False
    return Part(purpose="gplfd view", present=present, remark=found)


def _extra(name: str, purpose: str) -> Part:
    """Look for every distribution that an extra asks for."""
    asked = [
        re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
        for requirement in importlib.metadata.requires("gplfd") or ()
        if re.search(rf"""extra == ['"]{name}['"]""", requirement)
    ]
    found = {one: _version(one) for one in asked}
    missing = [one for one, version in found.items() if not version]
    if missing:
        remark = f"{', '.join(missing)} missing; pip install 'gplfd[{name}]'"
    else:
        remark = ", ".join(f"{one} {version}" for one, version in found.items())
    return Part(purpose=purpose, present=not missing, remark=remark)


def _version(distribution: str) -> str:
    try:
        return importlib.metadata.version(distribution)
    except importlib.metadata.PackageNotFoundError:
        return ""
