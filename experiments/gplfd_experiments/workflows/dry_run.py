"""Simulates an exported path with a robot at a door: expected forces and margins."""

import contextlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
from jaxtyping import Float
from matplotlib.figure import Figure

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
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.registry.catalogue import method_and_skill
from gplfd_policies.serving.settings import OperatorLimits

_APART: Final = 10  # Number of samples between two poses that are checked for reach.
_POSTURES: Final = 6  # Of the arm in the picture.
_WORKSPACE: Final = 4000  # Random postures that show the workspace in the picture.


@dataclass(frozen=True, kw_only=True)
class DryRun:
    """Largest values in a simulated execution, and poses of the arm."""

    robot: str
    base: str
    door: str
    opened_deg: float  # Greatest opening angle [°].
    ended: str  # "opened", a reason, or "time" where the path ended.
    force: float  # Of the hand on the handle [N].
    torque: float  # On the wrist, about the hand [N m].
    speed: float  # Of the hand [m/s].
    turning: float  # Of the hand [rad/s].
    stiffness: float  # Commanded, of translation [N/m].
    joint_margin: tuple[str, float]  # Joint closest to a limit, and its distance [rad].
    effort_share: tuple[str, float]  # Joint with the greatest share of its limit.
    # In the frame of the base at the start [m]: path of the hand, joints and hand at
    # some moments, and the hand at random postures within the joint limits.
    hand: Float[np.ndarray, "T 3"]
    arms: Float[np.ndarray, "P L 3"]
    workspace: Float[np.ndarray, "W 3"]
    exceeded: list[str]  # Sentences of `exceeded_limits`.

    def rows(self) -> list[tuple[str, str]]:
        """Return the printed names and values with units."""
        near, margin = self.joint_margin
        strong, share = self.effort_share
        return [
            ("robot", f"{self.robot}, {self.base} base"),
            ("door", f"{self.door}: {self.ended}, {self.opened_deg:.1f} deg"),
            ("greatest force on the handle", f"{self.force:.1f} N"),
            ("greatest torque at the hand", f"{self.torque:.2f} N m"),
            ("greatest speed", f"{self.speed:.2f} m/s, {self.turning:.2f} rad/s"),
            ("greatest stiffness", f"{self.stiffness:.0f} N/m"),
            ("least joint-limit margin", f"{margin:.3f} rad, {near}"),
            ("greatest effort", f"{100 * share:.0f} % of the limit of {strong}"),
        ]


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
    values, arms = [], []
    with contextlib.closing(made) as env:
        observation, info = env.reset(seed=0)
        model, data = env.unwrapped.model, env.unwrapped.data
        joints = [model.joint(joint) for joint in body.arm]
        low, high = np.array([joint.range for joint in joints]).T
        moving = [int(joint.dofadr[0]) for joint in joints]
        efforts = model.jnt_actfrcrange[[joint.id for joint in joints], 1]
        efforts = np.where(efforts > 0.0, efforts, np.inf)  # A URDF may lack limits.
        moments = np.zeros((model.nu, model.nv))
        links = [int(joint.bodyid[0]) for joint in joints]
        workspace = _workspace(model, data.qpos, body.arm)
        for command in np.hstack([path.poses, path.stiffness]):
            observation, _, over, _, info = env.step(command)
            forces = [
                info[f"force_{of}"] for of in ("tangential", "radial", "vertical")
            ]
            position, twist = observation["joint_pos"], observation["ee_twist"]
            hand = data.site("hand").xpos
            arms.append(np.vstack([data.xpos[links], hand]))
            # The torques that the controller wants, before they are limited.
            mujoco.mju_sparse2dense(
                *(moments, data.actuator_moment, data.moment_rownnz),
                *(data.moment_rowadr, data.moment_colind),
            )
            torques = (data.actuator_force @ moments + data.qfrc_gravcomp)[moving]
            row = (
                np.linalg.norm(forces),
                np.linalg.norm(observation["wrench"][3:]),
                np.linalg.norm(twist[:3]),
                np.linalg.norm(twist[3:]),
                info["door_angle"],
                *observation["ee_pose"][:3],
                *np.concatenate([position, np.abs(data.qvel[moving]), np.abs(torques)]),
            )
            values.append(row)
            if over:
                break
    table = np.array(values).T
    force, torque, speed, turning, angle = table[:5].max(axis=1).tolist()
    positions, speeds, torques = np.split(table[8:], 3)
    margins = np.minimum(positions.T - low, high - positions.T).min(axis=0)
    shares = torques.max(axis=1) / efforts
    near, strong = int(margins.argmin()), int(shares.argmax())
    urdf = read_urdf(str(urdf_path(body.urdf)))
    bounds = [urdf.joint_map[joint].limit for joint in body.arm]
    velocities = [getattr(bound, "velocity", None) or np.inf for bound in bounds]
    lowest, highest = np.reshape(limits.workspace, (2, 3))
    quantities = (
        ("force on the handle", ("",), table[0], 0.0, limits.force, "N"),
        ("torque at the hand", ("",), table[1], 0.0, limits.moment, "N m"),
        ("speed of the hand", ("",), table[2], 0.0, limits.linear_speed, "m/s"),
        ("speed of the hand", ("",), table[3], 0.0, limits.angular_speed, "rad/s"),
        ("hand's ", ("x", "y", "z"), table[5:8].T, lowest, highest, "m"),
        ("position of ", body.arm, positions.T, low, high, "rad"),
        ("speed of ", body.arm, speeds.T, 0.0, velocities, "rad/s"),
        ("torque of ", body.arm, torques.T, 0.0, efforts, "N m"),
    )
    shown = np.linspace(0, len(arms) - 1, _POSTURES).astype(int)
    return DryRun(
        robot=body.name,
        base=body.base,
        door=name,
        opened_deg=float(np.degrees(angle)),
        ended="opened" if info["success"] else info["failure"] or "time",
        force=force,
        torque=torque,
        speed=speed,
        turning=turning,
        stiffness=float(path.stiffness[:, :3].max()),
        joint_margin=(body.arm[near], float(margins[near])),
        effort_share=(body.arm[strong], float(shares[strong])),
        hand=np.array(arms)[:, -1],
        arms=np.array(arms)[shown],
        workspace=workspace,
        exceeded=exceeded_limits(path.times, quantities),
    )


def _workspace(
    model: mujoco.MjModel, qpos: np.ndarray, arm: Sequence[str]
) -> Float[np.ndarray, "W 3"]:
    """Return positions of the hand at seeded random postures, with a constant lift."""
    data, places = mujoco.MjData(model), []
    data.qpos[:] = qpos
    joints = [model.joint(name) for name in arm]
    low, high = np.array([joint.range for joint in joints]).T
    shares = np.random.default_rng(0).random((_WORKSPACE, len(joints)))
    for posture in low + shares * (high - low):
        data.qpos[[int(joint.qposadr[0]) for joint in joints]] = posture
        mujoco.mj_kinematics(model, data)
        places.append(data.site("hand").xpos.copy())
    return np.array(places)


def draw_dry_run(run: DryRun, file: Path) -> None:
    """Draw path and postures in the workspace, from above and from the side, as PNG."""
    figure = Figure(figsize=(9.0, 4.6), layout="constrained")
    panels = figure.subplots(1, 2)
    for panel, (across, up), title in zip(
        panels, ((0, 1), (0, 2)), ("from above", "from the side"), strict=True
    ):
        panel.plot(
            *run.workspace[:, [across, up]].T, ".", color="0.85", markersize=2, zorder=0
        )
        for number, arm in enumerate(run.arms):
            shade = str(0.75 - 0.5 * number / (len(run.arms) - 1))
            panel.plot(*arm[:, [across, up]].T, "o-", color=shade, markersize=3, lw=1.5)
        panel.plot(*run.hand[:, [across, up]].T, color="tab:red", lw=2)
        panel.set_aspect("equal")
        panel.set_title(title)
        panel.set_xlabel("x of the base at the start [m]")
        panel.set_ylabel(("x", "y [m]", "up [m]")[up])
    figure.suptitle(
        f"{run.robot}, {run.base} base, door {run.door}: hand (red), arm at "
        f"{len(run.arms)} moments (later is darker), reachable points (grey)",
        fontsize=9,
    )
    with complete_or_absent(file) as temporary, temporary.open("wb") as stream:
        figure.savefig(stream, format="png", dpi=120)
