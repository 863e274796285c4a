"""Robots from the URDF of an arm, with a stand and, if needed, a gripper added.

yourdfpy reads the description and computes its kinematics.
"""

import itertools
import math
import os
from collections.abc import Sequence
from pathlib import Path
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import Array, Base
from gplfd_env.robot.config import (
    BASE_RADIUS,
    Capsule,
    RobotConfig,
    Stance,
    StanceGroup,
    Vector,
    grasp_axes,
)
from gplfd_env.robot.description import read_urdf, urdf_path
from gplfd_env.robot.posture import at_home

_GRIPPER_REACH: Final = 0.16
"""Distance of the grasped point from the flange of the generic gripper [m]."""

_LINK_RADIUS: Final = 0.055
_ARMATURE: Final = 0.1


def robot_of_urdf(
    path: str | os.PathLike[str],
    *,
    name: str = "",
    base: Base = "fixed",
    tool: str = "",
    grasp_point: Vector | None = None,
    approach: Vector = (0.0, 0.0, 1.0),
    closing: Vector | None = None,
    fingers: tuple[str, str] | None = None,
    home: Sequence[float] | None = None,
    armature: float | Sequence[float] = _ARMATURE,
    stances: Sequence[tuple[StanceGroup, Stance]] = (),
) -> RobotConfig:
    """Make a robot from the URDF of an arm, on a stand or a mobile base.

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
        home: Arm joint positions that hold a bar with a level approach [rad]: the robot
            is placed so that they hold the closed handle. By default the best of seeded
            random postures.
        armature: Rotor inertia of the joints, one for all or one for each [kg m²].
        stances: Stances for groups of doors; by default computed from `home`.

    Raises:
        ValueError: The file is not a URDF, or names or numbers do not fit it.
    """
    path = urdf_path(os.fspath(path))
    urdf = read_urdf(str(path))
    if fingers is not None:
        prismatic = {
            name: joint
            for name, joint in urdf.joint_map.items()
            if joint.type == "prismatic"
        }
        for finger in fingers:
            if finger not in prismatic:
                raise ValueError(
                    f"{path.name}: fingers are two prismatic joints, got {finger!r}; "
                    f"there are {', '.join(prismatic) or 'none'}"
                )
            limit = prismatic[finger].limit
            if limit is None or not (limit.upper or 0.0) > 0.0:
                raise ValueError(
                    f"{path.name}: the finger {finger} must open from zero to a "
                    "positive upper limit [m]"
                )
        joint = prismatic[fingers[0]]
        tool = tool or joint.parent
        axes = urdf.get_transform(joint.child, tool)[:3, :3]
        closing = _unit("closing", axes @ joint.axis if closing is None else closing)
        if grasp_point is None:
            raise ValueError(
                f"{path.name}: give grasp_point, where the finger tips meet in the "
                f"frame of {tool} [m]"
            )
    arm = _arm_of(urdf, path, tool)
    tool = tool or arm[-1][1]
    joints = tuple(joint for joint, _ in arm)
    approach = _unit("approach", approach)
    closing = _unit("closing", (1.0, 0.0, 0.0) if closing is None else closing)
    if abs(np.dot(approach, closing)) > 1e-6:
        raise ValueError(
            f"approach {approach} and closing {closing} must be perpendicular"
        )
    values = np.array(armature, dtype=np.float64)
    if values.shape not in ((), (len(joints),)) or not (values >= 0.0).all():
        raise ValueError(
            f"armature must be one inertia or {len(joints)}, at least 0 [kg m²]; got "
            f"{armature!r}"
        )
    parts: dict[str, Any] = {
        "name": name or urdf.robot.name,
        "urdf": str(path),
        "base": base,
        "arm": joints,
        "armature": tuple(np.broadcast_to(values, len(joints)).tolist()),
        "forearm": arm[len(arm) // 2][1],
        "capsules": _capsules(urdf, [link for _, link in arm]),
        "stances": tuple(stances),
    }
    if fingers is None:
        parts |= {
            "tool": "gripper_link",
            "sensor": "gripper_link",
            "flange": tool,
            "flange_axes": (approach, closing),
            "grasp_point": (0.0, 0.0, -_GRIPPER_REACH),
            "approach": (0.0, 0.0, -1.0),
            "hand_camera": _camera(np.eye(3), np.array([0.0, 0.0, -_GRIPPER_REACH])),
        }
    else:
        point = np.array(grasp_point)
        parts |= {
            "tool": tool,
            "sensor": tool,
            "fingers": fingers,
            "finger_stroke": min(
                0.045, *(float(prismatic[finger].limit.upper) for finger in fingers)
            ),
            "grasp_point": tuple(point.tolist()),
            "approach": approach,
            "closing": closing,
            "hand_camera": _camera(grasp_axes(approach, closing), point),
        }
    robot = RobotConfig(**parts)
    return robot if stances else at_home(robot, home)


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
    best = max(reversed(ends), key=lambda link: len(chain(link)))
    arm = chain(best)
    if len(arm) < 6:
        raise ValueError(
            f"{path.name}: {len(arm)} turning joints lead to {best!r}; a hand at a "
            "door needs six or more: give tool, the link of the hand"
        )
    if not tool:
        arm[-1] = (arm[-1][0], best)
    return arm


def _camera(axes: Array, point: Array) -> tuple[Vector, Vector, Vector]:
    """Return a camera beside the palm that looks at the finger tips."""
    place = point + axes @ [0.0, -0.12, 0.175]
    vectors = (place, -axes[:, 0], axes @ [0.0, -0.83, -0.56])
    position, right, up = (tuple(vector.tolist()) for vector in vectors)
    return position, right, up


def _capsules(urdf: Any, links: Sequence[str]) -> tuple[Capsule, ...]:
    """Return capsules along the links of an arm, and the capsules of the stand."""
    capsules = [
        Capsule("base_body", "stand_base", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule("column_body", "stand_lift_link", (0, 0, -0.1, 0, 0, -0.4), 0.08),
    ]
    for link, following in itertools.pairwise(links):
        x, y, z = urdf.get_transform(following, link)[:3, 3].tolist()
        if math.hypot(x, y, z) > _LINK_RADIUS:
            ends = (0.0, 0.0, 0.0, x, y, z)
            capsules.append(Capsule(f"{link}_body", link, ends, _LINK_RADIUS))
    return tuple(capsules)
