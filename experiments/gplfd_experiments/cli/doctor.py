"""What is here by name, and what is installed on this machine or missing.

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
from typing import Any, Final

from gplfd_env import (
    ENVIRONMENT_ID,
    GRIPPER_ENVIRONMENT_ID,
    IMPEDANCE_ENVIRONMENT_ID,
    MOBILE_ENVIRONMENT_ID,
    RL_ENVIRONMENT_ID,
)
from gplfd_env.conventions.opengl import choose_opengl, has_display
from gplfd_env.doors.config import DOORS, DoorConfig
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.validation.fields import allowed_range
from gplfd_experiments.files.provenance import versions
from gplfd_policies.registry.summaries import SUMMARIES

EXTRAS: Final[Mapping[str, str]] = {
    "dask": "studies on a cluster",
    "ros": "ROS bags",
    "lerobot": "LeRobot data sets",
    "c3d": "C3D files",
    "robomimic": "robomimic files",
    "minari": "episode data sets",
    "sb3": "Stable-Baselines3 learners",
    "warp": "doors on a GPU (experimental)",
    "video": "videos of `gplfd run --video`",
    "remote": "policies behind a WebSocket",
}
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
    """Check this machine, its packages, and optional parts with purpose and remark."""
    import joblib

    from gplfd_experiments.recording.viewer import viewer

    try:
        choose_opengl()
        renderer, remark = drawn_by(), ""
    except OSError as error:
        renderer, remark = "", f"{error}; or "
    way = os.environ.get("MUJOCO_GL", "")
    if renderer:
        remark = f"with MUJOCO_GL={way}, " * bool(way) + f"drawn by {renderer}"
    else:
        remark += f"MUJOCO_GL={way} does not work here; unset it, or " * bool(way)
        remark += (
            "install EGL (Debian, Ubuntu: apt-get install libegl1 libegl-mesa0 "
            "libgl1-mesa-dri libopengl0) or OSMesa, see docs/environment.md"
        )
    rows = [("pictures", 'render_mode="rgb_array"', bool(renderer), remark)]
    display = has_display(sys.platform, os.environ)
    absent = "neither DISPLAY nor WAYLAND_DISPLAY names a display; copy recordings to a"
    remark = "there is a display" if display else f"{absent} machine with a screen"
    rows.append(("windows", 'render_mode="human", gplfd view', display, remark))
    try:
        rows.append(("viewer", "gplfd view", True, viewer()))
    except FileNotFoundError as error:
        rows.append(("viewer", "gplfd view", False, str(error)))
    for name, purpose in EXTRAS.items():
        installed, missing = [], []
        for requirement in importlib.metadata.requires("gplfd") or ():
            if re.search(rf"""extra == ['"]{name}['"]""", requirement):
                package = re.split(r"[^\w.-]", requirement, maxsplit=1)[0]
                try:
                    installed.append(f"{package} {importlib.metadata.version(package)}")
                except importlib.metadata.PackageNotFoundError:
                    missing.append(package)
        remark = ", ".join(installed)
        if missing:
            remark = f"{', '.join(missing)} missing; pip install 'gplfd[{name}]'"
        rows.append((name, purpose, not missing, remark))

    machine = {
        "python": platform.python_version(),
        "system": platform.platform(),
        "processor": platform.processor() or platform.machine(),
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


def drawn_by() -> str:
    """Render in a child process and return the name of the renderer; "" if it fails."""
    command = [sys.executable, "-c", _DRAW]
    try:
        drawn = subprocess.run(
            command, capture_output=True, text=True, check=True, timeout=_PATIENCE
        )
    except (OSError, subprocess.SubprocessError):
        return ""
    return drawn.stdout.strip().rpartition("\n")[2]


def catalogue() -> dict[str, Mapping[str, str]]:
    """Return a description of each name, by the titles of the sections."""
    radius = allowed_range(DoorConfig, "radius")
    standing = TIAGO_LIKE.stance(DoorConfig()).radius
    learners, references = SUMMARIES["learners"], SUMMARIES["references"]
    packaged: Mapping[str, str] = {}
    if importlib.metadata.entry_points(group="gplfd_policies"):
        from gplfd_policies.registry.catalogue import packaged_summaries  # slow

        packaged = packaged_summaries([*learners, *references])
    return {
        f"doors (or any radius from {radius.low:g} to {radius.high:g} m, beyond "
        f"{standing:g} m with a mobile base; or a .json file)": {
            name: ("" if door.motion == "hinged" else f"{door.motion}, ")
            + f"radius {door.radius:.2f} m, "
            + f"hinge friction {door.hinge_friction:.2g} N m"
            + (f", closer {door.closer.preload:.3g} N m" if door.closer.preload else "")
            + (f", {door.handle}" if door.handle != "bar" else "")
            + (" with latch" if door.latch != "none" else "")
            for name, door in DOORS.items()
        },
        "learners, in one pipeline (or your own: module:attribute)": learners,
        "pipelines (of a learner, after an @: gmr@published, gp@no-size+no-modes)": {
            "published": "as the authors published the method, without shared parts",
            "tuned": "learner and pipeline with the settings that tuning found",
            **SUMMARIES["parts"],
        },
        "references (policies that do not learn)": references,
        "policies of installed packages": packaged,
        "environments": {
            ENVIRONMENT_ID: "action: pose of the hand in the task frame",
            IMPEDANCE_ENVIRONMENT_ID: "action: pose and stiffness of the hand",
            MOBILE_ENVIRONMENT_ID: "action: pose of the hand and velocity of the base",
            GRIPPER_ENVIRONMENT_ID: "action: pose of the hand and width of the gripper",
            RL_ENVIRONMENT_ID: "for reinforcement learning: flat observations, actions "
            "within ±1, reward for low forces",
        },
        "randomizations (drawn at every reset)": {
            "none": "nothing: every episode has the given door",
            "mild": "small errors of placement, grasp, sensors; delay, friction, mass",
            "hard": "larger errors and delays; radius, friction, closer, mass, height",
            "standard": "a door of a building: handle, swing, hinge side, closer",
            "detector": "error of the detected handle pose; with --start approach",
        },
        "disturbances (during the opening)": {
            "none": "no disturbance",
            "push": "a force of up to 15 N pushes the hand for 0.3 s",
            "person": "a person holds the hand for 2.5 s",
            "person-behind": "a person's hand blocks the door for 2.5 s",
            "stop": "a fixed stop blocks the door for 2.5 s",
            "locked": "the door is locked for the whole episode",
            "bump": "the robot's base is displaced by up to 10 mm",
            "breakaway": "stiction and a seal hold the closed door",
        },
    }
