"""Robots from the URDF of an arm, with a stand and, if needed, a gripper added.

yourdfpy reads the description and computes its kinematics.
"""

import itertools
import math
import os
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np

from gplfd_env.conventions.constants import Array, Base
from gplfd_env.robot.config import (
    BASE_RADIUS,
    EVERY_GROUP,
    Capsule,
    RobotConfig,
    Stance,
    StanceGroup,
    Vector,
    grasp_axes,
)
from gplfd_env.robot.description import described_robot, read_urdf, urdf_path
from gplfd_env.robot.placement import arm_addresses
from gplfd_env.robot.search import searched_stance

_GRIPPER_REACH: Final = 0.16
"""Distance of the grasped point from the flange of the generic gripper [m]."""

_LINK_RADIUS: Final = 0.055

_ARMATURE: Final = 0.1
"""Rotor inertia of every joint, reflected to the joint [kg m²]."""

_TILT: Final = math.radians(30.0)
"""How far the approach at the home posture may be from level [rad]."""


def robot_of_urdf(
    path: str | os.PathLike[str],
    home: Sequence[float] | None = None,
    **description: Any,
) -> RobotConfig:
    """Make a robot from the URDF of an arm.

    Args:
        path: The URDF of an arm.
        home: Joint positions of the arm that hold an upright bar with a level approach
            [rad]: the robot is placed so that they hold the closed handle. A lever is
            held with the last joint turned by 90°, away from its limits. By default
            place and posture are searched for each group of doors
            (`gplfd_env.robot.search`).
        description: Further arguments of `arm_of_urdf`.

    Raises:
        ValueError: The file is not a URDF, or names or numbers do not fit it.
    """
    robot = arm_of_urdf(path, **description)
    try:
        model = described_robot(robot).compile()
    except ValueError as error:
        raise ValueError(
            f"{robot.urdf}: MuJoCo cannot simulate it: {error}; every link that moves "
            "needs a mass and an inertia, and a name that neither the stand nor the "
            "generic gripper has"
        ) from error
    if home is None:
        return replace(robot, search=searched_stance)
    data, arm, tool = mujoco.MjData(model), arm_addresses(model, robot), robot.tool
    low, high = np.array([model.joint(name).range for name in robot.arm]).T
    posture = np.array(home, dtype=np.float64)
    if posture.shape != low.shape or not np.all((low <= posture) & (posture <= high)):
        raise ValueError(
            f"home must be {len(low)} joint positions [rad] within the limits of "
            f"{', '.join(robot.arm)}; got {home!r}"
        )
    turned = posture.copy()
    turned[-1] += math.copysign(math.pi / 2, (low[-1] + high[-1]) / 2 - turned[-1])
    stances: dict[StanceGroup, Stance] = {}
    for bar, closed in ((True, posture), (False, turned)):
        data.qpos[arm] = closed
        mujoco.mj_kinematics(model, data)
        axes = data.body(tool).xmat.reshape(3, 3)
        place = data.body(tool).xpos + axes @ robot.grasp_point
        frame = axes @ robot.grasp_axes
        ahead, up = -frame[:, 2], np.array([0.0, 0.0, 1.0])
        if bar and abs(ahead[2]) > math.sin(_TILT):
            raise ValueError(
                "home must hold a bar with the approach level; it points "
                f"{math.degrees(math.asin(ahead[2])):.0f}° upwards"
            )
        if bar:
            approach = ahead
        elif ahead @ approach < math.cos(_TILT):
            continue  # The last joint does not roll the hand: only bars.
        # Quarters by which the fingers are rolled from closing across an upright bar.
        roll = math.atan2(-frame[:, 0] @ up, frame[:, 0] @ np.cross(ahead, up))
        stance = Stance(
            handle_xy_w=(float(place[0]), float(place[1])),
            door_yaw=math.atan2(ahead[1], ahead[0]),
            below_handle=float(place[2]),
            closed_posture=tuple(closed.tolist()),
            roll=round(roll / (math.pi / 2)) * (math.pi / 2),
            radius=1.05,
            height=1.22,
        )
        stances |= {
            group: stance for group in EVERY_GROUP if (group.held == "bar") == bar
        }
    return replace(robot, stances=tuple(stances.items()))


def arm_of_urdf(
    path: str | os.PathLike[str],
    *,
    name: str = "",
    base: Base = "fixed",
    tool: str = "",
    grasp_point: Vector | None = None,
    approach: Vector = (0.0, 0.0, 1.0),
    closing: Vector | None = None,
    fingers: tuple[str, str] | None = None,
) -> RobotConfig:
    """Read the URDF of an arm for a stand or a mobile base; it has no stances yet.

    Args:
        path: The URDF. Its joints between root and tool are the arm's, its other
            joints but the fingers' are locked.
        name: Name in messages; by default the name in the URDF.
        base: Whether the stand is fixed or mobile.
        tool: Link of the hand; by default the link of the fingers, or the last link of
            the longest chain.
        grasp_point: Between the finger tips, frame of the tool [m]; needed with
            fingers. For the generic gripper it is 0.16 m beyond the tool.
        approach: Direction in which the hand approaches, frame of the tool.
        closing: Direction in which the first finger opens, frame of the tool; by
            default the direction of its joint, or the tool's x axis for the generic
            gripper.
        fingers: Two prismatic joints, zero when closed; None for an arm without a
            gripper, which gets the generic one.
    """
    path = urdf_path(os.fspath(path))
    urdf = read_urdf(str(path))
    if fingers is not None:
        joints = [urdf.joint_map.get(finger) for finger in fingers]
        for finger, joint in zip(fingers, joints, strict=True):
            limit = joint and joint.type == "prismatic" and joint.limit
            if not limit or not (limit.upper or 0.0) > 0.0:
                raise ValueError(
                    f"{path.name}: fingers are two prismatic joints that open from "
                    f"zero to a positive upper limit [m], got {finger!r}"
                )
        tool = tool or joints[0].parent
        axes = urdf.get_transform(joints[0].child, tool)[:3, :3]
        closing = axes @ joints[0].axis if closing is None else closing
        if grasp_point is None:
            raise ValueError(
                f"{path.name}: give grasp_point, where the finger tips meet in the "
                f"frame of {tool} [m]"
            )
    arm = _arm_of(urdf, path, tool)
    tool = tool or arm[-1][1]
    approach = _unit("approach", approach)
    closing = _unit("closing", (1.0, 0.0, 0.0) if closing is None else closing)
    if abs(np.dot(approach, closing)) > 1e-6:
        raise ValueError(
            f"approach {approach} and closing {closing} must be perpendicular"
        )
    parts: dict[str, Any] = {
        "tool": "gripper_link",
        "sensor": "gripper_link",
        "flange": tool,
        "flange_axes": (approach, closing),
        "grasp_point": (0.0, 0.0, -_GRIPPER_REACH),
        "approach": (0.0, 0.0, -1.0),
        "hand_camera": _camera(np.eye(3), np.array([0.0, 0.0, -_GRIPPER_REACH])),
    }
    if fingers is not None:
        point = np.array(grasp_point)
        parts = {
            "tool": tool,
            "sensor": tool,
            "fingers": fingers,
            "finger_stroke": min(0.045, *(float(j.limit.upper) for j in joints)),
            "grasp_point": tuple(point.tolist()),
            "approach": approach,
            "closing": closing,
            "hand_camera": _camera(grasp_axes(approach, closing), point),
        }
    capsules = [
        Capsule("base_body", "stand_base", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule("column_body", "stand_lift_link", (0, 0, -0.1, 0, 0, -0.4), 0.08),
    ]
    for (_, link), (_, following) in itertools.pairwise(arm):
        x, y, z = urdf.get_transform(following, link)[:3, 3].tolist()
        if math.hypot(x, y, z) > _LINK_RADIUS:
            ends = (0.0, 0.0, 0.0, x, y, z)
            capsules.append(Capsule(f"{link}_body", link, ends, _LINK_RADIUS))
    return RobotConfig(
        name=name or urdf.robot.name,
        urdf=str(path),
        base=base,
        arm=tuple(joint for joint, _ in arm),
        armature=(_ARMATURE,) * len(arm),
        forearm=arm[len(arm) // 2][1],
        capsules=tuple(capsules),
        stances=(),
        **parts,
    )


def _unit(what: str, vector: Any) -> Vector:
    numbers = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(numbers)) if numbers.shape == (3,) else 0.0
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"{what} must be a direction (x, y, z), got {vector!r}")
    x, y, z = (numbers / length).tolist()
    return x, y, z


def _arm_of(urdf: Any, path: Path, tool: str) -> list[tuple[str, str]]:
    """Return the revolute joints from the root to a tool, each with the link it moves.

    If no tool is given, the last link of the chain with most revolute joints is the
    tool; it is the link of the last pair.
    """
    above = {joint.child: joint for joint in urdf.joint_map.values()}
    if tool and tool not in urdf.link_map:
        raise ValueError(
            f"{path.name} has no link {tool!r}; it has {', '.join(urdf.link_map)}; "
            "give one of them as tool"
        )

    def chain(link: str) -> list[tuple[str, str]]:
        joints = []
        while link in above:
            joint = above[link]
            if joint.type in ("revolute", "continuous") and joint.mimic is None:
                joints.append((joint.name, joint.child))
            link = joint.parent
        return joints[::-1]

    parents = {joint.parent for joint in urdf.joint_map.values()}
    ends = [tool] if tool else [link for link in urdf.link_map if link not in parents]
    # Of equally long chains the last link in the file: a frame at the flange.
    last = max(reversed(ends), key=lambda link: len(chain(link)))
    arm = chain(last)
    if len(arm) < 6:
        raise ValueError(
            f"{path.name}: {len(arm)} turning joints lead to {last!r}; a hand at a "
            "door needs six or more: give tool, the link of the hand"
        )
    return arm if tool else [*arm[:-1], (arm[-1][0], last)]


def _camera(axes: Array, point: Array) -> tuple[Vector, Vector, Vector]:
    """Return a camera beside the palm that looks at the finger tips."""
    place = point + axes @ [0.0, -0.12, 0.175]
    vectors = (place, -axes[:, 0], axes @ [0.0, -0.83, -0.56])
    position, right, up = (tuple(vector.tolist()) for vector in vectors)
    return position, right, up
