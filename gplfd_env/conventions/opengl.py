"""How MuJoCo draws on this machine, decided before MuJoCo is imported.

MuJoCo reads ``MUJOCO_GL`` when it is imported, and its own choice needs a display.
"""

import ctypes.util
import os
import sys
from collections.abc import Mapping
from typing import Final

_LIBRARIES: Final = {"egl": "EGL", "osmesa": "OSMesa"}
_OTHERS: Final = ("glfw", "glx", "enable", "enabled", "on", "true", "1")
_NONE: Final = ("disable", "disabled", "off", "false", "0")


def has_display(platform: str, environment: Mapping[str, str]) -> bool:
    """Whether there is a screen; on Linux, whether X or Wayland has a display."""
    displays = ("DISPLAY", "WAYLAND_DISPLAY")
    return not platform.startswith("linux") or any(map(environment.get, displays))


def choose_opengl() -> None:
    """Let MuJoCo draw by EGL without a display; refuse a setting that cannot work."""
    way = os.environ.get("MUJOCO_GL", "").strip().lower()
    if not sys.platform.startswith("linux") or "mujoco" in sys.modules:
        return
    library = _LIBRARIES.get(way)
    if not way:
        library = ctypes.util.find_library("EGL")
        if library and not has_display(sys.platform, os.environ):
            os.environ["MUJOCO_GL"] = "egl"
    elif library is None and way not in (*_OTHERS, *_NONE):
        raise OSError(f"MUJOCO_GL={way} must be egl, osmesa or glfw, or be unset")
    elif library is not None and not ctypes.util.find_library(library):
        raise OSError(f"MUJOCO_GL={way} needs the library {library}; see gplfd doctor")
