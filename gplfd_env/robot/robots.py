"""The robots of this project by name, and what names a robot."""

import os
from collections.abc import Mapping
from functools import lru_cache
from typing import Any, Final

from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.robot.urdf import robot_of_urdf
from gplfd_env.validation.named import nearest_name

RobotSpec = str | os.PathLike[str] | RobotConfig
"""Name of a robot, path of the URDF of an arm, or a `RobotConfig`."""

_ARMS: Final[Mapping[str, Mapping[str, Any]]] = {
    "panda-like": {
        "path": "panda_like.urdf",
        "tool": "panda_hand",
        "grasp_point": (0.0, 0.0, 0.1034),
        "fingers": ("panda_finger_joint1", "panda_finger_joint2"),
    },
    "ur5e-like": {"path": "ur5e_like.urdf", "tool": "tool0"},
}
"""Arguments of `robot_of_urdf`."""

ROBOTS: Final = ("tiago-like", *_ARMS)
"""Names of the robots of this project."""


@lru_cache(maxsize=16)
def robot_named(spec: RobotSpec) -> RobotConfig:
    """Return a robot; raise a ValueError or an OSError that says what is allowed."""
    if isinstance(spec, RobotConfig):
        return spec
    text = os.fspath(spec)
    if text == TIAGO_LIKE.name:
        return TIAGO_LIKE
    if text in _ARMS:
        return robot_of_urdf(name=text, **_ARMS[text])
    if text.endswith(".urdf"):
        return robot_of_urdf(text)
    raise ValueError(
        f"unknown robot {text!r}{nearest_name(text, ROBOTS)}; give one of "
        f"{', '.join(ROBOTS)}, the path of a .urdf, or a RobotConfig"
    )
