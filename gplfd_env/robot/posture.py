"""Stances of a robot: from a home posture, or from a given pose of the door."""

import math
from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import Final, get_args

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.constants import Array, Base
from gplfd_env.doors.config import DoorConfig, Swing
from gplfd_env.robot.config import HELD, RobotConfig, Stance, StanceGroup
from gplfd_env.robot.description import described_robot
from gplfd_env.robot.placement import (
    arm_addresses,
    gripper_rotation_w,
    task_rotation_w,
)

_NEAR: Final = 0.45
"""Least distance of the grasped point from the arm's root, seen from above [m]."""

_LEVEL: Final = 0.45
"""Greatest height of the grasped point above or below the arm's root [m]."""

_TILT: Final = math.radians(30.0)
"""How far the approach at the home posture may be from level [rad]."""

_UPRIGHT: Final = math.radians(2.0)
"""How far the task frame's y may be from upright in the base frame [rad]."""

Grasp = Callable[[Array], tuple[Array, Array]]
"""Position (3,) [m] and axes (3, 3) of the grasp frame from joint positions [rad], in
the base frame with the lift at zero."""


def at_home(robot: RobotConfig, home: Sequence[float] | None) -> RobotConfig:
    """Return a robot that holds every closed door at its home posture [rad].

    The posture must hold a bar with a level approach; None for the best of seeded
    random postures. Raises a ValueError if it does not, or if MuJoCo cannot simulate
    the robot.
    """
    spec = described_robot(robot)
    try:
        model = spec.compile()
    except ValueError as error:
        raise ValueError(
            f"{robot.urdf}: MuJoCo cannot simulate it: {error}; every link that moves "
            "needs a mass and an inertia"
        ) from error
    data, arm = mujoco.MjData(model), arm_addresses(model, robot)
    limits = np.array([model.joint(name).range for name in robot.arm])

    def grasp(posture: Array) -> tuple[Array, Array]:
        data.qpos[arm] = posture
        return _grasp_frame(data, robot)

    posture = np.array(_found_home(grasp, limits) if home is None else home)
    if posture.shape != (len(robot.arm),) or not np.isfinite(posture).all():
        raise ValueError(
            f"home must be {len(robot.arm)} joint positions [rad], of "
            f"{', '.join(robot.arm)}; got {home!r}"
        )
    outside = (posture < limits[:, 0]) | (posture > limits[:, 1])
    if outside.any():
        name = robot.arm[int(np.argmax(outside))]
        raise ValueError(f"home is beyond the limits of {name}; got {home!r}")
    place, frame = grasp(posture)
    if abs(frame[2, 2]) > math.sin(_TILT):
        raise ValueError(
            "home must hold a bar with the approach level; it points "
            f"{math.degrees(math.asin(-frame[2, 2])):.0f}° upwards"
        )
    turned = posture.copy()
    # A lever is held with the last joint turned by 90°, in the direction that is
    # farther from its limits.
    middle = limits[-1].mean()
    turned[-1] += math.copysign(math.pi / 2, middle - turned[-1])
    stances, approach = [], frame[:, 2]
    for held in HELD:
        closed = posture if held == "bar" else turned
        place, frame = grasp(closed)
        if frame[:, 2] @ approach < math.cos(_TILT):
            continue  # The last joint does not roll the hand: only bars.
        stance = Stance(
            handle_xy_w=(float(place[0]), float(place[1])),
            door_yaw=math.atan2(-frame[1, 2], -frame[0, 2]),
            below_handle=float(place[2]),
            closed_posture=tuple(closed.tolist()),
            roll=_roll(frame),
            radius=1.05,
            height=1.22,
        )
        stances += [
            (StanceGroup(base, swing, held, side), stance)
            for base in get_args(Base)
            for swing in get_args(Swing)
            for side in ("right", "left")
        ]
    return replace(robot, stances=tuple(stances))


def at_task_frame(
    robot: RobotConfig, door: DoorConfig, task: Array, poses: Array, times: Array
) -> RobotConfig:
    """Return a robot with a fixed base at a given pose relative to the task frame.

    On a stand the base frame is that of the arm's root link, and the lift is computed;
    otherwise it is the frame of the robot's root. The hand holds the handle as in the
    robot's stance for the door. Several postures are computed from seeded starts; the
    one that stays farthest from joint limits is used.

    Args:
        robot: the robot, on a fixed base.
        door: the closed door; for a robot without a stand, its handle is as high as the
            task frame.
        task: pose of the task frame in the base frame, (6,) [m, rad].
        poses: path of the hand in the task frame, (T, 6) [m, rad].
        times: times of the poses, (T,) [s], for error messages.

    Raises:
        ValueError: y of the task frame is not upright, or the lift or the arm does not
            reach.
    """
    position, axes = task[:3], Rotation.from_rotvec(task[3:]).as_matrix()
    if not (np.isfinite(position).all() and axes[2, 1] > math.cos(_UPRIGHT)):
        raise ValueError(
            "the task frame must be finite, and its y upright in the base frame to "
            f"{math.degrees(_UPRIGHT):.0f} deg; it points to {axes[:, 1].tolist()}"
        )
    robot = robot.on("fixed")
    usual = robot.stance(door)
    model = described_robot(robot).compile()
    lowest, highest = model.joint(robot.lift).range
    lift = door.handle_height - (position[2] if robot.stand else usual.below_handle)
    if robot.stand and not lowest <= lift <= highest:
        raise ValueError(
            f"the task frame is {position[2]:.2f} m above the base and the handle "
            f"{door.handle_height:g} m above the floor, but the stand lifts the base "
            f"from {lowest:g} to {highest:g} m; give a door with another handle_height"
        )
    lift = min(max(lift, lowest), highest)
    stance = replace(
        usual,
        handle_xy_w=(float(position[0]), float(position[1])),
        door_yaw=math.atan2(-axes[1, 0], -axes[0, 0]),
        below_handle=float(door.handle_height - lift),
        radius=math.inf,  # The reach of the arm is tested below.
        height=math.inf,
    )
    robot = replace(robot, stances=tuple((group, stance) for group, _ in robot.stances))
    upright = task_rotation_w(door, robot)
    turns = Rotation.from_matrix(upright) * Rotation.from_rotvec(poses[:, 3:])
    frames = turns.as_matrix() @ upright.T @ gripper_rotation_w(door, robot)
    places = [*position[:2], door.handle_height] + poses[:, :3] @ upright.T
    low, high = np.array([model.joint(name).range for name in robot.arm]).T
    rng = np.random.default_rng(0)
    starts = np.vstack([usual.closed_posture, rng.uniform(low, high, (40, len(low)))])
    tries = [_followed(model, robot, lift, start, places, frames) for start in starts]
    reached = [way for way, _ in tries if len(way) == len(poses)]
    if not reached:
        way, error = max(
            tries,
            key=lambda attempt: (len(attempt[0]), -np.linalg.norm(attempt[1][:3])),
        )
        raise ValueError(
            f"the arm of {robot.name} does not reach the path with the handle at "
            f"{position.round(3).tolist()} m in the base frame: at "
            f"{times[len(way)]:.2f} s the hand stays {np.linalg.norm(error[:3]):.2f} m "
            f"and {math.degrees(np.linalg.norm(error[3:])):.0f} deg away; move the "
            f"base by about {error[:3].round(2).tolist()} m along its own axes, and "
            "give the pose of the task frame from there"
        )
    best = max(reached, key=lambda way: np.minimum(way - low, high - way).min())
    stance = replace(stance, closed_posture=tuple(best[0].tolist()))
    return replace(robot, stances=tuple((group, stance) for group, _ in robot.stances))


def _followed(
    model: mujoco.MjModel,
    robot: RobotConfig,
    lift: float,
    start: Array,
    places: Array,
    frames: Array,
) -> tuple[Array, Array]:
    """Follow a path of the grasp frame by damped least squares within joint limits.

    Returns:
        Postures (M, joints) until one is not reached, and the error (6,) [m, rad] of
        the last one tried.
    """
    data, tool = mujoco.MjData(model), model.body(robot.tool).id
    data.joint(robot.lift).qpos = lift
    arm, jacobian, way = arm_addresses(model, robot), np.zeros((6, model.nv)), []
    low, high = np.array([model.joint(name).range for name in robot.arm]).T
    data.qpos[arm] = start
    for place, frame in zip(places, frames, strict=True):
        for _ in range(60):
            point, axes = _grasp_frame(data, robot)
            mujoco.mj_comPos(model, data)
            turn = Rotation.from_matrix(frame @ axes.T)
            error = np.concatenate([place - point, turn.as_rotvec()])
            if np.abs(error).max() < 1e-3:
                way.append(data.qpos[arm].copy())
                break
            mujoco.mj_jac(model, data, jacobian[:3], jacobian[3:], point, tool)
            of_arm = jacobian[:, arm]
            damped = of_arm @ of_arm.T + 1e-4 * np.eye(6)
            step = of_arm.T @ np.linalg.solve(damped, error)
            data.qpos[arm] = np.clip(data.qpos[arm] + step, low, high)
        else:
            break
    return np.array(way), error


def _grasp_frame(data: mujoco.MjData, robot: RobotConfig) -> tuple[Array, Array]:
    """Return position (3,) [m] and axes (3, 3) of the grasp frame in a posture."""
    mujoco.mj_kinematics(data.model, data)
    axes = data.body(robot.tool).xmat.reshape(3, 3)
    place = data.body(robot.tool).xpos + axes @ robot.grasp_point
    return place, axes @ robot.grasp_axes


def _roll(frame: Array) -> float:
    """Return the roll of a grasp frame in quarter turns, axes as columns [rad].

    Zero if the fingers close across an upright bar, the first to the right.
    """
    approach, up = -frame[:, 2], np.array([0.0, 0.0, 1.0])
    right = np.cross(approach, up)
    turn = math.atan2(-frame[:, 0] @ up, frame[:, 0] @ right)
    return round(turn / (math.pi / 2)) * (math.pi / 2)


def _found_home(grasp: Grasp, limits: Array) -> Array:
    """Return the best of random postures with a level approach away from the base.

    The best has the largest product of its distance to joint limits and of the least
    singular value of the hand's Jacobian. Raises a ValueError if none is level.
    """
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits.T[0], -math.pi), np.minimum(limits.T[1], math.pi)
    best, posture = 0.0, None
    for share in rng.uniform(0.1, 0.9, size=(2000, len(limits))):
        tried = low + share * (high - low)
        place, frame = grasp(tried)
        out = np.hypot(*place[:2])
        ahead = -frame[:2, 2] @ place[:2] > 0.8 * out
        level = abs(frame[2, 2]) < 0.15 and abs(place[2]) < _LEVEL
        # The fingers close across an upright bar.
        if not (level and ahead and out > _NEAR and abs(frame[2, 0]) < math.sqrt(0.5)):
            continue
        columns = []
        for joint in range(len(limits)):
            moved, turned = grasp(tried + 1e-4 * (np.arange(len(limits)) == joint))
            turn = Rotation.from_matrix(turned @ frame.T).as_rotvec()
            columns.append(np.concatenate([moved - place, 0.3 * turn]) / 1e-4)
        strength = np.linalg.svd(np.array(columns), compute_uv=False)[5]
        score = float(strength * np.minimum(share, 1.0 - share).min())
        if score > best:
            best, posture = score, tried
    if posture is None:
        raise ValueError(
            "no posture was found that holds a bar before the robot; give home, the "
            "positions of the arm's joints [rad]"
        )
    return np.asarray(posture)
