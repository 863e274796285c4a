"""Writes the commanded path of a skill for robots, and simulates it with a robot."""

import contextlib
import dataclasses
from collections.abc import Iterable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
from jaxtyping import Float

from gplfd_env import IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.robot import description, placement, robots, search
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.console.arguments import check_folder, check_least
from gplfd_experiments.console.progress import LOG
from gplfd_experiments.data.writers import COMMAND_WRITERS, bag_library
from gplfd_experiments.episodes.task import named_doors
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
    quaternion, scalar first; ``tool`` the quaternion of the tool in the task frame. If
    the path exceeds limits, or a dry run has ``exceeded`` some, LimitsExceededError is
    raised instead, unless ``allow``. Returns the path and the metadata of JSON.
    """
    for file in files:
        if file.suffix[1:] not in COMMAND_WRITERS:
            ends = ", .".join(COMMAND_WRITERS)
            raise ValueError(f"{file} must end in .{ends}; or give --form")
        check_folder(file.parent)
        if file.suffix == ".bag":
            bag_library()
            check_replaceable(file, "metadata.yaml", "bag", overwrite=True)
    check_least("--rate", rate, 20.0, 1000.0)
    if frame is None and tool is not None:
        raise ValueError("--tool goes with --frame, the pose of the task frame")
    if frame is not None and tool is None:
        LOG.warning("warning: without --tool its axes are those of the task frame")
    method, learned = method_and_skill(policy, skill)
    if frame is not None and learned.frame != "door":
        LOG.warning(
            f"warning: the axes of {skill} are not a door's ({learned.frame} frame): "
            "--frame must be their pose in the base"
        )
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
        name, tilt = "base", np.array([search.tilt_of(turns[0])])
    moved = np.linalg.norm(np.diff(path.poses[:, :3], axis=0), axis=1)
    turned = rotation_distance(path.poses[1:, 3:], path.poses[:-1, 3:])
    soft, stiff = limits.least_stiffness, limits.greatest_stiffness
    k, k_r = np.split(path.stiffness, 2, axis=1)
    quantities = (
        ("angle between y of --frame and up", ("",), tilt, 0.0, search.UPRIGHT, "deg"),
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


_APART: Final = 10  # Number of samples between two poses that are checked for reach.


class DryRun(NamedTuple):
    """What a simulated execution takes of a robot."""

    summary: dict[str, str]  # Largest values with units, by name.
    hand: Float[np.ndarray, "T 3"]
    """Path of the hand in the frame of the base at the start [m]."""
    exceeded: list[str]  # Sentences of `exceeded_limits`.


def _played(
    env: Any, arm: Sequence[str], commands: np.ndarray
) -> tuple[np.ndarray, np.ndarray, dict[str, Any], np.ndarray]:
    """Return measured rows, path of the hand, last info, and limits of the joints."""
    _, info = env.reset(seed=0)
    model, data = env.unwrapped.model, env.unwrapped.data
    joints = [model.joint(joint) for joint in arm]
    moving = [int(joint.dofadr[0]) for joint in joints]
    efforts = model.jnt_actfrcrange[[joint.id for joint in joints], 1]
    efforts = np.where(efforts > 0.0, efforts, np.inf)  # A URDF may lack limits.
    moments = np.zeros((model.nu, model.nv))
    rows, hand = [], []
    for command in commands:
        seen, _, over, _, info = env.step(command)
        hand.append(data.site("hand").xpos.copy())
        # The torques that the controller wants, before they are limited.
        mujoco.mju_sparse2dense(
            *(moments, data.actuator_moment, data.moment_rownnz),
            *(data.moment_rowadr, data.moment_colind),
        )
        torques = (data.actuator_force @ moments + data.qfrc_gravcomp)[moving]
        forces = [info[f"force_{of}"] for of in ("tangential", "radial", "vertical")]
        vectors = forces, seen["wrench"][3:], *np.split(seen["ee_twist"], 2)
        numbers = [*map(np.linalg.norm, vectors), info["door_angle"]]
        motion = [*seen["joint_pos"], *np.abs(data.qvel[moving]), *np.abs(torques)]
        rows.append([*numbers, *seen["ee_pose"][:3], *motion])
        if over:
            break
    ranges = np.array([joint.range for joint in joints]).T
    return np.array(rows).T, np.array(hand), info, np.array([*ranges, efforts])


def dry_run(
    skill: Path,
    policy: str,
    robot: robots.RobotSpec,
    door: str,
    frame: Sequence[float] | None = None,
    limits: OperatorLimits | None = None,
) -> DryRun:
    """Play the commanded path of a skill with a robot at a door, without adaptation.

    The arguments are those of `gplfd export`. The base stands where ``frame`` says;
    None for the robot's own stance. ValueError: the arm does not reach the path.
    """
    limits = limits or OperatorLimits()
    if frame is not None:
        task = np.array([*frame[:3], *rotvecs_from_quaternions((frame[3:],))[0]])
        if search.tilt_of(task[3:]) > search.UPRIGHT:
            # No arm stands at such a frame; `export_skill` says so.
            return DryRun({}, np.empty((0, 3)), [])
    [(name, config)] = named_doors([door], robot=robot).items()
    body = robots.robot_named(robot)
    method, learned = method_and_skill(policy, skill)
    path = commanded_path(method.open_loop(CONTROL_PERIOD).follow(learned))
    if frame is None:
        body = body.on(placement.base_for(config, body))
    else:
        if not body.stand:
            config = replace(config, handle_height=float(frame[2]))
        until = learned.aligned.end * learned.aligned.duration
        some = np.flatnonzero(path.times <= until)[::_APART]
        body = search.at_frame(body, config, task, path.path[some], path.times[some])
    fields: Any = {"robot": body, "door": config, "max_episode_steps": -1}
    with contextlib.closing(gym.make(IMPEDANCE_ENVIRONMENT_ID, **fields)) as env:
        commands = np.hstack([path.poses, path.stiffness])
        rows, hand, info, (low, high, efforts) = _played(env, body.arm, commands)
    force, torque, speed, turning, angle, *places = rows
    positions, speeds, efforts_used = np.split(np.array(places[3:]), 3)
    margins = np.minimum(positions.T - low, high - positions.T).min(axis=0)
    shares = efforts_used.max(axis=1) / efforts
    near, strong = int(margins.argmin()), int(shares.argmax())
    urdf = description.read_urdf(str(description.urdf_path(body.urdf)))
    stated = {n: getattr(urdf.joint_map[n].limit, "velocity", None) for n in body.arm}
    velocities = [(stated | dict(body.velocity))[name] or np.inf for name in body.arm]
    lowest, highest = np.reshape(limits.workspace, (2, 3))
    quantities = (
        ("force on the handle", ("",), force, 0.0, limits.force, "N"),
        ("torque at the hand", ("",), torque, 0.0, limits.moment, "N m"),
        ("speed of the hand", ("",), speed, 0.0, limits.linear_speed, "m/s"),
        ("speed of the hand", ("",), turning, 0.0, limits.angular_speed, "rad/s"),
        ("hand's ", "xyz", np.transpose(places[:3]), lowest, highest, "m"),
        ("position of ", body.arm, positions.T, low, high, "rad"),
        ("speed of ", body.arm, speeds.T, 0.0, velocities, "rad/s"),
        ("torque of ", body.arm, efforts_used.T, 0.0, efforts, "N m"),
    )
    ended = "opened" if info["success"] else info["failure"] or "time"
    summary = {
        "robot": f"{body.name}, {body.base} base",
        "door": f"{name}: {ended}, {np.degrees(angle.max()):.1f} deg",
        "greatest force on the handle": f"{force.max():.1f} N",
        "greatest torque at the hand": f"{torque.max():.2f} N m",
        "greatest speed": f"{speed.max():.2f} m/s, {turning.max():.2f} rad/s",
        "greatest stiffness": f"{path.stiffness[:, :3].max():.0f} N/m",
        "least joint-limit margin": f"{margins[near]:.3f} rad, {body.arm[near]}",
        "greatest effort": f"{100 * shares[strong]:.0f} % of the limit of "
        f"{body.arm[strong]}",
    }
    return DryRun(summary, hand, exceeded_limits(path.times, quantities))
