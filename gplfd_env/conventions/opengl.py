"""How MuJoCo draws on this machine, decided before MuJoCo is imported.

MuJoCo reads ``MUJOCO_GL`` when it is imported, and its own choice needs a display.
"""

import ctypes.util
import os
import sys
from collections.abc import Mapping
from typing import Final

_LIBRARIES: Final = {"egl": (("EGL",), ("OpenGL", "GL")), "osmesa": (("OSMesa",),)}
"""Libraries that PyOpenGL loads, any of each group; importing MuJoCo loads them."""
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
    groups = _LIBRARIES.get(way or "egl", ())
    lacking = [of[0] for of in groups if not any(map(ctypes.util.find_library, of))]
    if not way:
        if not lacking and not has_display(sys.platform, os.environ):
            os.environ["MUJOCO_GL"] = "egl"
    elif not groups and way not in (*_OTHERS, *_NONE):
        raise OSError(f"MUJOCO_GL={way} must be egl, osmesa or glfw, or be unset")
    elif lacking:
        raise OSError(f"MUJOCO_GL={way} needs lib{lacking[0]}; see gplfd doctor")
