"""Computes, checks and writes the commanded path of a skill for robots."""

import dataclasses
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.robot.search import UPRIGHT, tilt_of
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.console.arguments import check_folder
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.writers.commands import COMMAND_WRITERS, bag_library
from gplfd_experiments.files.folders import check_replaceable
from gplfd_experiments.files.provenance import content_hash, provenance
from gplfd_policies.agents.commanded_path import CommandedPath, commanded_path
from gplfd_policies.registry.catalogue import method_and_skill
from gplfd_policies.serving.settings import OperatorLimits

_AXES: Final = {
    "task": "origin at the closed handle, x pulls, y up, z = x cross y; orientations "
    "are relative to that of the hand at the closed door",
    "base": "of the robot; orientations are those of its tool frame",
}


class LimitsExceededError(Exception):
    """A motion exceeds limits; the arguments are sentences with times and values."""


def exceeded_limits(
    times: np.ndarray,
    quantities: Iterable[tuple[str, Sequence[str], np.ndarray, Any, Any, str]],
) -> list[str]:
    """Return a sentence for each quantity beyond its limits, where it is worst.

    A quantity has a name, the names of n parts, their values at T times (T, n) or (T,),
    the least and the greatest allowed value, one or n, and a unit.
    """
    sentences = []
    for name, parts, values, low, high, unit in quantities:
        table = np.reshape(values, (-1, len(parts)))
        excess = np.maximum(low - table, table - high)
        ranges = np.broadcast_arrays(table, low, high)
        for part, worst in enumerate(excess.argmax(axis=0).tolist()):
            value, least, most = (numbers[worst, part] for numbers in ranges)
            if not excess[worst, part] <= 1e-9:
                sentences.append(
                    f"at {times[worst]:.2f} s the {name}{parts[part]} is {value:.5g} "
                    f"{unit}; {least:.5g} to {most:.5g} {unit} is allowed"
                )
    return sentences


def export_skill(
    skill: Path,
    files: Sequence[Path],
    policy: str = "gp",
    rate: float = 100.0,
    frame: Sequence[float] | None = None,
    tool: Sequence[float] | None = None,
    *,
    limits: OperatorLimits | None = None,
    exceeded: Sequence[str] = (),
    allow: bool = False,
) -> tuple[CommandedPath, dict[str, Any]]:
    """Write the commanded path of a skill in the formats of the files' suffixes.

    ``frame`` is the pose of the task frame in the robot's base, x, y, z [m] and a
    quaternion, scalar first; ``tool`` the quaternion of the tool in the task frame.
    ``exceeded`` are sentences of a dry run. If there are any, or the path exceeds the
    limits, nothing is written, unless ``allow``. Returns the path and the metadata of
    JSON. Raises LimitsExceededError, ValueError for options, OSError for files,
    ModuleNotFoundError for rosbags.
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
    name, aligned, limits = "task", learned.aligned, limits or OperatorLimits()
    low, high = np.reshape(limits.workspace, (2, 3))
    axes, tilt, places = ("x", "y", "z"), np.zeros(1), path.poses[:, :3]
    if frame is not None:
        try:
            turns = rotvecs_from_quaternions((frame[3:], tool or (1, 0, 0, 0)))
        except ValueError as error:
            raise ValueError(f"--frame and --tool: {error}") from error
        path = path.seen_from(np.array([*frame[:3], *turns[0]]), turns[1])
        name, tilt = "base", np.array([tilt_of(turns[0])])
    moved = np.linalg.norm(np.diff(path.poses[:, :3], axis=0), axis=1)
    turned = rotation_distance(path.poses[1:, 3:], path.poses[:-1, 3:])
    soft, stiff = limits.least_stiffness, limits.greatest_stiffness
    k, k_r = np.split(path.stiffness, 2, axis=1)
    quantities = (
        ("angle between y of --frame and up", ("",), tilt, 0.0, UPRIGHT, "deg"),
        ("set-point's ", axes, places, low, high, "m in the task frame"),
        ("set-point's speed", ("",), moved * rate, 0.0, limits.linear_speed, "m/s"),
        ("set-point's speed", ("",), turned * rate, 0.0, limits.angular_speed, "rad/s"),
        ("stiffness along ", axes, k, soft[0], stiff[0], "N/m"),
        ("stiffness about ", axes, k_r, soft[1], stiff[1], "N m/rad"),
    )
    exceeded = [*exceeded_limits(path.times, quantities), *exceeded]
    if exceeded and not allow:
        raise LimitsExceededError(*exceeded)
    for sentence in exceeded:
        LOG.warning("warning: %s", sentence)
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
