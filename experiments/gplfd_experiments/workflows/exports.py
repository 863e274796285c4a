"""What a learned skill commands, for robots: computed, checked and written."""

import dataclasses
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.writers.commands import COMMAND_WRITERS, Commands
from gplfd_experiments.files.folders import check_replaceable
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_experiments.workflows.skills import method_and_skill
from gplfd_policies.agents.commanded_path import commanded_path
from gplfd_policies.registry.open_loop import open_loop

RATES: Final = (20.0, 1000.0)
"""Least and greatest number of samples per second [Hz]."""

_TASK_AXES: Final = (
    "task: origin at the closed handle, x pulls, y up, z = x cross y; orientations are "
    "relative to that of the hand at the closed door"
)
_BASE_AXES: Final = (
    "base of the robot; orientations are those of its tool frame; stiffness, damping "
    "and std are along the axes of the base"
)


def export_skill(
    skill: Path,
    files: Sequence[Path],
    *,
    policy: str = "gp",
    rate: float = 100.0,
    frame: Sequence[float] | None = None,
    tool: Sequence[float] | None = None,
) -> Commands:
    """Write what a skill commands, in the forms that the suffixes of files name.

    Args:
        skill: file of `gplfd learn`.
        files: to write; what is there already is replaced.
        policy: by whose stiffness law the skill is followed.
        rate: samples per second [Hz].
        frame: pose of the task frame in the frame of the robot's base, x, y, z [m], qw,
            qx, qy, qz; None for the task frame itself.
        tool: orientation qw, qx, qy, qz of the robot's tool frame at the closed door in
            the task frame; None for parallel axes.

    Raises:
        ValueError: A suffix, the rate or a quaternion is wrong, the skill is not of the
            policy, or what is commanded is not stable.
        ModuleNotFoundError: rosbags is needed and not installed.
        OSError: A file cannot be read or written.
    """
    for file in files:
        if file.suffix[1:] not in COMMAND_WRITERS:
            raise ValueError(
                f"--out {file} must end in one of .{', .'.join(COMMAND_WRITERS)}, or "
                "give --form"
            )
        if file.suffix == ".bag":
            check_replaceable(file, "metadata.yaml", "bag", overwrite=True)
    if not RATES[0] <= rate <= RATES[1]:
        raise ValueError(f"--rate {rate:g} must be from {RATES[0]:g} to {RATES[1]:g}")
    if tool is not None and frame is None:
        raise ValueError("--tool goes with --frame, the pose of the task frame")
    if frame is not None and tool is None:
        LOG.warning(
            "warning: the axes of the tool are taken to be those of the task frame at "
            "the closed door; give --tool qw,qx,qy,qz if they are not"
        )
    turn = np.zeros(3) if tool is None else _rotvec("--tool", tool)
    if frame is not None:
        pose = np.concatenate([frame[:3], _rotvec("--frame", frame[3:])])
    method, learned = method_and_skill(policy, skill)
    path = commanded_path(open_loop(method, 1.0 / rate).follow(learned))
    law = path.profile
    if frame is not None:
        path = path.seen_from(pose, turn)
    aligned = learned.aligned
    about = {
        "rate_hz": rate,
        "demonstrated_until_s": aligned.end * aligned.duration,
        "task_frame_in_base": None if frame is None else list(frame),
        "tool_in_task_frame": None if tool is None else list(tool),
        "stiffness_law_along_task_axes": _plain(law),
        "stability_bound_for": _plain(path.dynamics),
        "gripper": {
            "command": "closed",
            "why": "the handle is grasped before the start",
        },
        "provenance": provenance(
            {"skill": skill.name, "skill_sha256": content_hash(skill), "policy": policy}
        ),
    }
    commands = Commands(
        path=path,
        frame="task" if frame is None else "base",
        axes=_TASK_AXES if frame is None else _BASE_AXES,
        about=about,
    )
    for file in files:
        COMMAND_WRITERS[file.suffix[1:]](file, commands)
    return commands


def _rotvec(option: str, quaternion: Sequence[float]) -> np.ndarray:
    try:
        return np.asarray(rotvecs_from_quaternions([quaternion])[0])
    except ValueError as error:
        raise ValueError(f"{option}: {error}") from error


def _plain(record: Any) -> dict[str, Any]:
    """Return the public numbers of a record, as JSON has them."""
    return {
        one.name: np.asarray(getattr(record, one.name)).tolist()
        for one in dataclasses.fields(record)
        if one.init
    }
