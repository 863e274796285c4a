"""Placement of the robot in front of the door, and the posture that holds the handle.

Frames: *world* = the robot's ``base_footprint`` at the reset (x forward, y left, z up);
*task* = origin at the closed handle, x = pulling direction, y = up, z = x × y (to the
left of someone facing the door). A hinge on the robot's right is at z = -radius, one on
its left at z = radius, where an arm on a fixed base reaches less.
"""

import math

import mujoco
import numpy as np
from mujoco import MjData, MjModel

from gplfd_env.conventions.constants import Array, Base, Start
from gplfd_env.doors.config import MOTIONS, DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.variation import Placement, Standoff, Variation
from gplfd_env.robot.config import RobotConfig
from gplfd_env.spatial.se3 import into_axes


def hand_position_w(
    door: DoorConfig, placement: Placement, robot: RobotConfig
) -> Array:
    """Return the grasped point in the world frame, (3,) [m]."""
    position, _ = task_in_door_frame(door, placement, robot)
    middle = handle_position_w(door, placement, robot)
    axes = task_rotation_w(door, robot, placement.base_yaw)
    return np.asarray(middle + axes @ position)


def handle_position_w(
    door: DoorConfig, placement: Placement, robot: RobotConfig
) -> Array:
    """Return the closed handle in the frame of the base at the reset, (3,) [m]."""
    handle = robot.stance(door).handle_xy_w
    x, y = handle[0] - placement.base_x, handle[1] - placement.base_y
    cosine, sine = math.cos(placement.base_yaw), math.sin(placement.base_yaw)
    return np.array([cosine * x + sine * y, cosine * y - sine * x, door.handle_height])


def task_rotation_w(door: DoorConfig, robot: RobotConfig, yaw: float = 0.0) -> Array:
    """Return the task frame's axes in the world, (3, 3); with a yaw, the door's."""
    heading = robot.stance(door).door_yaw - yaw
    into_door = np.array([math.cos(heading), math.sin(heading), 0.0])
    up = np.array([0.0, 0.0, 1.0])
    pull = -into_door
    return np.column_stack([pull, up, np.cross(pull, up)])


def gripper_rotation_w(door: DoorConfig, robot: RobotConfig) -> Array:
    """Return the grasp frame's axes at the closed grasp in the world frame, (3, 3)."""
    stance = robot.stance(door)
    yaw = stance.door_yaw + stance.grasp_yaw
    approach = np.array([math.cos(yaw), math.sin(yaw), 0.0])
    arm_7_x = np.array([0.0, 0.0, -1.0])
    arm_7_y = np.cross(approach, arm_7_x)
    for _ in range(round(abs(stance.roll) / (math.pi / 2))):
        quarter = math.copysign(1.0, stance.roll)
        arm_7_x, arm_7_y = quarter * arm_7_y, -quarter * arm_7_x
    return np.column_stack([-arm_7_y, -arm_7_x, -approach])


def quaternion(rotation: Array) -> Array:
    """Return the quaternion (w, x, y, z) of a rotation matrix (3, 3)."""
    result = np.zeros(4)
    mujoco.mju_mat2Quat(result, rotation.reshape(9))
    return result


def door_geometry(variation: Variation, robot: RobotConfig) -> DoorGeometry:
    """Return the hinge and the handle's axis in an episode's task frame."""
    door, placement = variation.door, variation.placement
    return DoorGeometry.of(door, *task_in_door_frame(door, placement, robot))


def standoff_pose(door: DoorConfig, standoff: Standoff, robot: RobotConfig) -> Array:
    """Return the initial pose in front of the handle, task frame, (6,) [m, rad]."""
    back = task_rotation_w(door, robot).T @ gripper_rotation_w(door, robot)[:, 2]
    up = np.array([0.0, 1.0, 0.0])
    level = math.cos(standoff.aside) * back
    level += math.sin(standoff.aside) * np.cross(back, up)
    direction = math.cos(standoff.above) * level + math.sin(standoff.above) * up
    return np.concatenate([standoff.distance * direction, np.zeros(3)])


def grasp_height(door: DoorConfig, placement: Placement) -> float:
    """Return how far above the middle of a bar the hand holds it [m]."""
    upright = door.handle == "bar" and not door.level
    return placement.grasp_height if upright else 0.0


def task_in_door_frame(
    door: DoorConfig, placement: Placement, robot: RobotConfig
) -> tuple[Array, Array]:
    """Return the task frame in the door frame: the believed grasp (3,) [m], axes."""
    depth = np.array([0.0, 0.0, placement.grasp_depth])
    back = gripper_rotation_w(door, robot) @ depth
    axes = task_rotation_w(door, robot, placement.base_yaw)
    height = np.array([0.0, grasp_height(door, placement), 0.0])
    position, rotation = axes.T @ back + height, axes.T @ task_rotation_w(door, robot)
    if any(placement.belief):
        shift, turn = np.split(np.array(placement.belief), 2)
        position = position + rotation @ shift
        rotation = rotation @ into_axes(-turn, np.eye(3)).T
    return position, rotation


def solve_closed_posture(
    model: MjModel,
    data: MjData,
    door: DoorConfig,
    placement: Placement,
    robot: RobotConfig,
) -> Array:
    """Return all joint positions, (nq,) [m, rad], that hold the closed handle.

    Newton's method from the stance's posture, with the torso lifted as far as needed or
    possible. Raises a ValueError if the pose is out of reach.
    """
    mujoco.mj_resetData(model, data)
    stance = robot.stance(door)
    height = door.handle_height + grasp_height(door, placement)
    lift = height - stance.below_handle
    lowest, highest = model.joint(robot.lift).range
    data.joint(robot.lift).qpos = min(max(lift, lowest), highest)
    data.qpos[arm_addresses(model, robot)] = stance.closed_posture
    error, reached = _bring_hand(model, data, robot)
    if not reached:
        raise ValueError(
            f"the arm cannot hold the closed handle (pose error {error:.2g}); move the "
            "base towards its nominal placement or choose another handle height"
        )
    return np.array(data.qpos)


def solve_standoff_posture(
    model: MjModel, data: MjData, robot: RobotConfig, pose: Array
) -> None:
    """Move the hand back to a pose (6,), in small steps; ValueError out of reach."""
    axes = data.site_xmat[model.site("task_frame").id].reshape(3, 3)
    away = axes @ pose[:3]
    for share in np.linspace(0.0, 1.0, 11)[1:]:
        _, reached = _bring_hand(model, data, robot, share * away)
    if not reached:
        raise ValueError(
            f"the arm cannot draw the hand back by {np.linalg.norm(away):.2f} m; "
            'choose another handle height, or start="grasped"'
        )


def arm_addresses(model: MjModel, robot: RobotConfig) -> list[int]:
    """Return the addresses of the arm's joints, the same in qpos and qvel."""
    return [int(model.joint(name).qposadr[0]) for name in robot.arm]


def _bring_hand(
    model: MjModel, data: MjData, robot: RobotConfig, away: Array | None = None
) -> tuple[float, bool]:
    """Move the hand to the task frame, or `away` from it; return error and success."""
    arm = arm_addresses(model, robot)
    hand, target = model.site("hand").id, model.site("task_frame").id
    jacobian, rotation = np.zeros((6, model.nv)), np.zeros(3)
    inverse, relative = np.zeros(4), np.zeros(4)
    for _ in range(20):
        mujoco.mj_kinematics(model, data)
        mujoco.mj_comPos(model, data)
        mujoco.mju_negQuat(inverse, quaternion(data.site_xmat[hand]))
        mujoco.mju_mulQuat(relative, quaternion(data.site_xmat[target]), inverse)
        mujoco.mju_quat2Vel(rotation, relative, 1.0)
        shift = data.site_xpos[target] - data.site_xpos[hand]
        error = np.concatenate([shift if away is None else shift + away, rotation])
        if np.abs(error).max() < 1e-12:
            break
        mujoco.mj_jacSite(model, data, jacobian[:3], jacobian[3:], hand)
        step, *_ = np.linalg.lstsq(jacobian[:, arm], error, rcond=None)
        data.qpos[arm] += step
    most = float(np.abs(error).max())
    low, high = model.jnt_range[arm].T
    within = np.all((low <= data.qpos[arm]) & (data.qpos[arm] <= high))
    return most, bool(most <= 1e-9 and within)


def base_for(door: DoorConfig, robot: RobotConfig) -> Base:
    """Return the base that a door needs.

    A fixed base is enough for furniture within reach of the arm: bars that are pulled,
    with the hinge on the right.
    """
    furniture = DoorConfig().kind
    kind = {name: value for name, value in door.kind.items() if name != "motion"}
    if kind != furniture or not MOTIONS[door.motion].upright_hinge:
        return "mobile"
    try:
        stance = robot.on("fixed").stance(door)
    except ValueError:  # of an arm too small to follow the opening
        return "mobile"
    within = door.radius <= stance.radius and door.handle_height <= stance.height
    return "fixed" if within else "mobile"


def check_reach(door: DoorConfig, robot: RobotConfig, start: Start = "grasped") -> None:
    """Raise a ValueError if a door is beyond the reach of the robot.

    Either the handle is too far from the hinge or too high, or the episode starts in
    front of the handle and the robot stands too near to draw back its arm.
    """
    if (start, robot.base, door.swing) == ("approach", "fixed", "push"):
        raise ValueError(
            'start="approach" is out of reach before a door that is pushed with '
            'base="fixed"; give base="mobile"'
        )
    if robot.base == "fixed" and not MOTIONS[door.motion].upright_hinge:
        raise ValueError(
            f"DoorConfig.motion = {door.motion!r} is out of reach with base='fixed': "
            'the arm alone cannot follow the handle; give base="mobile"'
        )
    stance = robot.stance(door)
    for name, limit in (("radius", stance.radius), ("handle_height", stance.height)):
        if getattr(door, name) > limit:
            advice = '; give base="mobile"' if robot.base == "fixed" else ""
            raise ValueError(
                f"DoorConfig.{name} = {getattr(door, name)!r} is out of reach with "
                f"base={robot.base!r}, at most {limit:g} m{advice}"
            )
