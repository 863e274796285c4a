"""Simulates an exported path with a robot at a door: expected forces and margins."""

import contextlib
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final, NamedTuple

import gymnasium as gym
import mujoco
import numpy as np
from jaxtyping import Float

from gplfd_env import IMPEDANCE_ENVIRONMENT_ID
from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.robot.description import read_urdf, urdf_path
from gplfd_env.robot.placement import base_for
from gplfd_env.robot.robots import RobotSpec, robot_named
from gplfd_env.robot.search import at_frame
from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.workflows.exports import exceeded_limits
from gplfd_policies.agents.commanded_path import commanded_path
from gplfd_policies.registry.catalogue import method_and_skill
from gplfd_policies.serving.settings import OperatorLimits

_APART: Final = 10  # Number of samples between two poses that are checked for reach.


class DryRun(NamedTuple):
    """What a simulated execution takes of a robot."""

    summary: dict[str, str]
    """Largest values with units, by name."""
    hand: Float[np.ndarray, "T 3"]
    """Path of the hand in the frame of the base at the start [m]."""
    exceeded: list[str]
    """Sentences of `exceeded_limits`."""


def dry_run(
    skill: Path,
    policy: str,
    robot: RobotSpec,
    door: str,
    frame: Sequence[float] | None = None,
    limits: OperatorLimits | None = None,
) -> DryRun:
    """Play the commanded path of a skill with a robot at a door, without adaptation.

    The arguments are those of `gplfd export`. The base stands where ``frame`` says;
    None for the robot's own stance. Raises a ValueError if the arm does not reach the
    path from there, or a name is unknown.
    """
    limits = limits or OperatorLimits()
    [(name, config)] = named_doors([door], robot=robot).items()
    body = robot_named(robot)
    method, learned = method_and_skill(policy, skill)
    path = commanded_path(method.open_loop(CONTROL_PERIOD).follow(learned))
    if frame is None:
        body = body.on(base_for(config, body))
    else:
        if not body.stand:
            config = replace(config, handle_height=float(frame[2]))
        task = np.array([*frame[:3], *rotvecs_from_quaternions((frame[3:],))[0]])
        until = learned.aligned.end * learned.aligned.duration
        some = np.flatnonzero(path.times <= until)[::_APART]
        body = at_frame(body, config, task, path.path[some], path.times[some])
    made: Any = gym.make(
        IMPEDANCE_ENVIRONMENT_ID, robot=body, door=config, max_episode_steps=-1
    )
    rows, hand = [], []
    with contextlib.closing(made) as env:
        _, info = env.reset(seed=0)
        model, data = env.unwrapped.model, env.unwrapped.data
        joints = [model.joint(joint) for joint in body.arm]
        low, high = np.array([joint.range for joint in joints]).T
        moving = [int(joint.dofadr[0]) for joint in joints]
        efforts = model.jnt_actfrcrange[[joint.id for joint in joints], 1]
        efforts = np.where(efforts > 0.0, efforts, np.inf)  # A URDF may lack limits.
        moments = np.zeros((model.nu, model.nv))
        for command in np.hstack([path.poses, path.stiffness]):
            observation, _, over, _, info = env.step(command)
            hand.append(data.site("hand").xpos.copy())
            # The torques that the controller wants, before they are limited.
            mujoco.mju_sparse2dense(
                *(moments, data.actuator_moment, data.moment_rownnz),
                *(data.moment_rowadr, data.moment_colind),
            )
            torques = (data.actuator_force @ moments + data.qfrc_gravcomp)[moving]
            forces = [
                info[f"force_{of}"] for of in ("tangential", "radial", "vertical")
            ]
            vectors = (forces, observation["wrench"][3:])
            vectors += tuple(np.split(observation["ee_twist"], 2))
            rows.append(
                [
                    *map(np.linalg.norm, vectors),
                    info["door_angle"],
                    *observation["ee_pose"][:3],
                    *observation["joint_pos"],
                    *np.abs(data.qvel[moving]),
                    *np.abs(torques),
                ]
            )
            if over:
                break
    force, torque, speed, turning, angle, *places = np.array(rows).T
    positions, speeds, efforts_used = np.split(np.array(places[3:]), 3)
    margins = np.minimum(positions.T - low, high - positions.T).min(axis=0)
    shares = efforts_used.max(axis=1) / efforts
    near, strong = int(margins.argmin()), int(shares.argmax())
    urdf = read_urdf(str(urdf_path(body.urdf)))
    bounds = [urdf.joint_map[joint].limit for joint in body.arm]
    velocities = [getattr(bound, "velocity", None) or np.inf for bound in bounds]
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
    return DryRun(summary, np.array(hand), exceeded_limits(path.times, quantities))
