"""Computes, checks and writes the commanded path of a skill for robots."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.writers.commands import COMMAND_WRITERS, bag_library
from gplfd_experiments.files.folders import check_replaceable
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_policies.agents.commanded_path import CommandedPath, commanded_path
from gplfd_policies.registry.catalogue import method_and_skill

_AXES: Final = {
    "task": "origin at the closed handle, x pulls, y up, z = x cross y; orientations "
    "are relative to that of the hand at the closed door",
    "base": "of the robot; orientations are those of its tool frame",
}


def export_skill(
    skill: Path,
    files: Sequence[Path],
    policy: str = "gp",
    rate: float = 100.0,
    frame: Sequence[float] | None = None,
    tool: Sequence[float] | None = None,
) -> tuple[CommandedPath, dict[str, Any]]:
    """Write the commanded path of a skill in the formats of the files' suffixes.

    ``frame`` is the pose of the task frame in the robot's base, x, y, z [m] and a
    quaternion, scalar first; ``tool`` the quaternion of the tool in the task frame.
    Returns the path and the metadata of JSON. Raises ValueError for options, OSError
    for files, ModuleNotFoundError for rosbags.
    """
    for file in files:
        if file.suffix[1:] not in COMMAND_WRITERS:
            ends = ", .".join(COMMAND_WRITERS)
            raise ValueError(f"{file} must end in .{ends}; or give --form")
        check_folder(file.parent)
        if file.suffix == ".bag":
            bag_library()
            check_replaceable(file, "metadata.yaml", "bag", overwrite=True)
        elif file.is_dir():
            raise ValueError(f"{file} is a folder; give another file")
    if not 20.0 <= rate <= 1000.0:
        raise ValueError(f"--rate {rate:g} must be from 20 to 1000")
    if frame is None and tool is not None:
        raise ValueError("--tool goes with --frame, the pose of the task frame")
    if frame is not None and tool is None:
        LOG.warning("warning: without --tool its axes are those of the task frame")
    method, learned = method_and_skill(policy, skill)
    path = commanded_path(method.open_loop(1.0 / rate).follow(learned))
    name, aligned = "task", learned.aligned
    if frame is not None:
        try:
            turns = rotvecs_from_quaternions((frame[3:], tool or (1, 0, 0, 0)))
        except ValueError as error:
            raise ValueError(f"--frame and --tool: {error}") from error
        path = path.seen_from(np.array([*frame[:3], *turns[0]]), turns[1])
        name = "base"
    origin = {"policy": policy, "skill_sha256": content_hash(skill)}
    about = {
        "frame": {"name": name, "axes": _AXES[name]},
        "task_frame_in_base": frame,
        "tool_in_task_frame": tool,
        "rate_hz": rate,
        "demonstrated_until_s": aligned.end * aligned.duration,
        "gripper": "closed; the handle is grasped before the first sample",
        "stiffness_law_and_dynamics": {
            field.name: np.asarray(getattr(record, field.name)).tolist()
            for record in (path.profile, path.dynamics)
            for field in dataclasses.fields(record)
            if field.init
        },
        "provenance": provenance(origin),
    }
    for file in files:
        COMMAND_WRITERS[file.suffix[1:]](file, path, about)
    return path, about
