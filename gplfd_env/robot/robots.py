"""The robots of this project by name, and other ways to specify a robot."""

import json
import os
from collections.abc import Mapping
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.tiago import TIAGO_LIKE, stance_of, stances_of
from gplfd_env.robot.urdf import robot_of_urdf
from gplfd_env.validation.named import nearest_name

RobotSpec = str | os.PathLike[str] | RobotConfig
"""Name of a robot, path of the URDF of an arm, path of a .json with the arguments of
`gplfd_env.robot.urdf.robot_of_urdf`, or a `RobotConfig`."""


_PANDA: Final = stances_of(
    {
        ("pull", True): stance_of(
            (0.775, 0.170), 0.170, 0.356, 0, 0.346, 0.65,
            -0.599, 0.744, 0.969, -1.613, 2.495, 2.714, -2.369,
        ),
        ("push", True): stance_of(
            (0.278, 0.231), -0.391, -0.491, 0, 0.446, 0.65,
            -0.274, -1.370, 1.268, -2.561, -0.364, 1.983, 2.364,
        ),
        ("pull", False): stance_of(
            (0.867, 0.038), 0.060, 0.0, 1, 0.133, 0.60,
            -0.557, 1.360, 0.928, -1.193, 2.766, 2.531, -1.401,
        ),
        ("push", False): stance_of(
            (0.308, 0.134), -0.695, 0.0, 1, 0.030, 0.65,
            0.476, 0.859, 0.484, -2.496, -1.587, 1.205, -0.649,
        ),
    },
    (
        stance_of(
            (0.534, 0.195), 0.350, 0.500, 0, 0.550, 1.05,
            -0.883, -0.689, 0.878, -2.368, 2.226, 1.983, -1.083,
        ),
        stance_of(
            (0.534, -0.195), -0.350, -0.500, 0, 0.550, 1.05,
            0.883, -0.689, -0.878, -2.368, -2.226, 1.983, 2.654,
        ),
        stance_of(
            (0.536, 0.196), 0.350, 0.0, 1, 0.620, 1.05,
            2.043, 1.174, -2.131, -2.241, 2.316, 2.416, 1.004,
        ),
    ),
)  # fmt: skip
"""assets/README.md explains how these and the following were found."""

_UR5E: Final = stances_of(
    {
        ("pull", True): stance_of(
            (0.943, -0.216), -1.032, 0.744, 0, 0.431, 0.65,
            3.129, -2.422, -1.007, 0.287, 1.296, 0.000,
        ),
        ("push", True): stance_of(
            (0.304, 0.187), -0.229, 0.047, 0, 0.395, 0.65,
            0.774, -2.037, 2.158, -0.121, 2.527, -3.142,
        ),
        ("pull", False): stance_of(
            (0.920, -0.032), -0.326, 0.0, -1, 0.253, 0.65,
            -0.123, 0.262, -1.134, 0.872, 1.774, 1.571,
        ),
        ("push", False): stance_of(
            (0.210, 0.088), -0.307, 0.0, 1, 0.400, 0.65,
            0.895, -2.306, 2.250, 0.056, 2.773, -1.571,
        ),
    },
    (
        stance_of(
            (0.705, 0.257), 0.350, 0.298, 0, 0.030, 1.05,
            -2.677, -2.783, -1.692, 1.333, 1.755, 0.000,
        ),
        stance_of(
            (0.705, 0.257), 0.350, -0.298, 0, 0.030, 1.05,
            0.234, -0.358, 1.692, 1.808, -1.753, 0.000,
        ),
        stance_of(
            (0.705, 0.257), 0.350, 0.0, 1, 0.030, 1.05,
            -2.517, -2.774, -1.744, 1.377, 1.296, 1.571,
        ),
    ),
)  # fmt: skip

_ARMS: Final[Mapping[str, Mapping[str, Any]]] = {
    "panda-like": {
        "path": "panda_like.urdf",
        "tool": "panda_hand",
        "grasp_point": (0.0, 0.0, 0.1034),
        "fingers": ("panda_finger_joint1", "panda_finger_joint2"),
        "stances": _PANDA,
    },
    "ur5e-like": {"path": "ur5e_like.urdf", "tool": "tool0", "stances": _UR5E},
}
"""Arguments of `robot_of_urdf`."""

ROBOTS: Final = ("tiago-like", *_ARMS)
"""Names of the robots of this project."""


def robot_named(spec: RobotSpec) -> RobotConfig:
    """Return a robot.

    Raises:
        ValueError: An unknown name, or a file that does not describe a robot.
        OSError: There is no such file.
    """
    if isinstance(spec, RobotConfig):
        return spec
    if not isinstance(spec, str | os.PathLike):
        raise TypeError(
            f"robot must be a name, a path or a RobotConfig, got {type(spec).__name__}"
        )
    return _named(os.fspath(spec))


@lru_cache(maxsize=16)
def _named(name: str) -> RobotConfig:
    if name == TIAGO_LIKE.name:
        return TIAGO_LIKE
    if name in _ARMS:
        return robot_of_urdf(name=name, **_ARMS[name])
    if name.endswith(".urdf"):
        return robot_of_urdf(name)
    if name.endswith(".json"):
        file = Path(name)
        try:
            arguments = json.loads(file.read_text(encoding="utf-8"))
            path = file.parent / arguments.pop("path")
            lists = {
                key: tuple(v) for key, v in arguments.items() if isinstance(v, list)
            }
            return robot_of_urdf(path, **arguments | lists)
        except (ValueError, TypeError, KeyError, AttributeError) as error:
            raise ValueError(
                f"{name} does not describe a robot: {error}; it must be an object with "
                "the arguments of gplfd_env.robot.urdf.robot_of_urdf, such as path, "
                "tool, fingers, grasp_point and home"
            ) from error
    raise ValueError(
        f"unknown robot {name!r}{nearest_name(name, ROBOTS)}; give one of "
        f"{', '.join(ROBOTS)}, a .urdf, a .json, or a RobotConfig"
    )
