"""The robots of this project by name, and other ways to specify a robot."""

import contextlib
import json
import os
from collections.abc import Mapping
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

from gplfd_env.robot.config import RobotConfig, tabulated_stances
from gplfd_env.robot.description import content_of
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_env.robot.urdf import robot_of_urdf
from gplfd_env.validation.named import nearest_name

RobotSpec = str | os.PathLike[str] | RobotConfig
"""Name of a robot, path of the URDF of an arm, path of a .json with the arguments of
`gplfd_env.robot.urdf.robot_of_urdf`, or a `RobotConfig`."""

# Arguments of `robot_of_urdf`.
_ARMS: Final[Mapping[str, Mapping[str, Any]]] = {
    "panda-like": {
        "path": "panda_like.urdf",
        "tool": "panda_hand",
        "grasp_point": (0.0, 0.0, 0.1034),
        "fingers": ("panda_finger_joint1", "panda_finger_joint2"),
    },
    "ur5e-like": {"path": "ur5e_like.urdf", "tool": "tool0"},
}

ROBOTS: Final = ("tiago-like", *_ARMS)
"""Names of the robots of this project."""


def robot_named(spec: RobotSpec) -> RobotConfig:
    """Return a robot; raise a ValueError or an OSError for a wrong name or file."""
    if isinstance(spec, RobotConfig):
        return spec
    if not isinstance(spec, str | os.PathLike):
        raise TypeError(f"robot must be a name, a path or a RobotConfig, got {spec!r}")
    name = os.fspath(spec)
    if not name.endswith((".json", ".urdf")):
        return _named(name)
    if name.endswith(".urdf"):
        return _of_file(name, (content_of(Path(name)),))
    content = [Path(name).read_bytes()]
    if name.endswith(".json"):
        with contextlib.suppress(ValueError, TypeError, KeyError, OSError):
            path = Path(name).parent / json.loads(content[0])["path"]
            content.append(content_of(path))
    return _of_file(name, tuple(content))


@lru_cache(maxsize=16)
def _named(name: str) -> RobotConfig:
    if name == TIAGO_LIKE.name:
        return TIAGO_LIKE
    if name in _ARMS:
        arm = robot_of_urdf(name=name, **_ARMS[name])
        return replace(arm, stances=tabulated_stances(name), search=None)
    raise ValueError(
        f"unknown robot {name!r}{nearest_name(name, ROBOTS)}; give one of "
        f"{', '.join(ROBOTS)}, a .urdf, a .json with path (of a URDF), or a RobotConfig"
    )


def _once(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    names = [name for name, _ in pairs]
    if twice := [name for name in names if names.count(name) > 1]:
        raise ValueError(f"it gives {twice[0]} twice")
    return dict(pairs)


@lru_cache(maxsize=16)
def _of_file(name: str, content: tuple[bytes, ...]) -> RobotConfig:
    if name.endswith(".urdf"):
        return robot_of_urdf(name)
    file = Path(name)
    try:
        arguments = json.loads(content[0], object_pairs_hook=_once)
        path = file.parent / arguments.pop("path")
        lists = {key: tuple(v) for key, v in arguments.items() if isinstance(v, list)}
        return robot_of_urdf(path, **arguments | lists)
    except (ValueError, TypeError, KeyError, AttributeError) as error:
        raise ValueError(
            f"{name} does not describe a robot: {error}; it must be an object with the "
            "arguments of gplfd_env.robot.urdf.robot_of_urdf, such as path and tool"
        ) from error
