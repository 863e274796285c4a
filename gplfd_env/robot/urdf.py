"""Robots from the URDF of an arm, with a stand and, if needed, a gripper added.

yourdfpy reads the description and computes its kinematics.
"""

import itertools
import math
import os
import re
import warnings
from collections.abc import Mapping
from typing import Any, Final

import numpy as np

from gplfd_env.conventions.constants import Base, Vector
from gplfd_env.robot.config import BASE_RADIUS, Capsule, RobotConfig, grasp_axes
from gplfd_env.robot.description import (
    content_of,
    described_robot,
    lineage,
    prefixed,
    read_urdf,
    urdf_path,
)
from gplfd_env.robot.search import searched_stance

Arm = tuple[tuple[str, str], ...]  # Turning joints, each with the link that it moves.

# Distance of the grasped point from the flange of the generic gripper [m].
_GRIPPER_REACH: Final = 0.16
_LINK_RADIUS: Final = 0.055
_ARMATURE: Final = 0.1  # Rotor inertia of every joint, reflected to the joint [kg m²].


def robot_of_urdf(
    path: str | os.PathLike[str],
    *,
    name: str = "",
    base: Base = "fixed",
    tool: str = "",
    grasp_point: Vector | None = None,
    approach: Vector | None = None,
    closing: Vector | None = None,
    fingers: tuple[str, str] | None = None,
    effort: float | Mapping[str, float] | None = None,
    velocity: float | Mapping[str, float] | None = None,
) -> RobotConfig:
    """Make a robot from the URDF of an arm, on a stand and with a gripper if needed.

    Place and posture are searched for each group of doors (`gplfd_env.robot.search`).

    Args:
        path: The URDF. Joints other than those from its root to the tool and the
            fingers' are locked.
        name: Name in messages; by default the name in the URDF.
        base: Whether the stand is fixed or mobile.
        tool: Link of the hand; by default that of the fingers, or of the longest chain
            the link before its gripper or its end.
        grasp_point: Between the finger tips, frame of the tool [m], with fingers.
        approach: Direction in which the hand approaches, frame of the tool; by default
            z with fingers, else its axis that leads away from the last joint.
        closing: Direction in which the first finger opens, frame of the tool; by
            default the direction of its joint, else x.
        fingers: Two prismatic joints, zero when closed; else the arm gets a gripper.
        effort: Limit of every joint, or of some by name, for a URDF without [N m].
        velocity: The same of the speed [rad/s].

    Raises a ValueError if the file is not a URDF, or an argument does not fit it.
    """
    path = urdf_path(os.fspath(path))
    urdf = read_urdf(str(path))
    held = fingers, grasp_point, approach, closing
    arm, hand = _hand_of(urdf, path.name, prefixed(tool), *held)
    capsules = [
        Capsule("base_body", "stand_base", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule("column_body", "stand_lift_link", (0, 0, -0.1, 0, 0, -0.4), 0.08),
    ]
    for (_, link), (_, following) in itertools.pairwise(arm):
        x, y, z = urdf.get_transform(following, link)[:3, 3].tolist()
        if math.hypot(x, y, z) > _LINK_RADIUS:
            ends = (0.0, 0.0, 0.0, x, y, z)
            capsules.append(Capsule(f"{link}_body", link, ends, _LINK_RADIUS))
    # On the stand is the root, unless the arm's base is far from it or moves.
    bases, joints = lineage(urdf, urdf.joint_map[arm[0][0]].parent), urdf.joint_map
    moves = any(x.type != "fixed" for x in joints.values() if x.child in bases)
    far = urdf.get_transform(bases[0], urdf.base_link)[2, 3] > 0.5
    robot = RobotConfig(
        name=name or urdf.robot.name,
        urdf=str(path),
        content=content_of(path),
        base_link=bases[0] if moves or far else "",
        base=base,
        arm=tuple(joint for joint, _ in arm),
        armature=(_ARMATURE,) * len(arm),
        forearm=arm[len(arm) // 2][1],
        capsules=tuple(capsules),
        effort=_limits(urdf, path.name, arm, "effort", "N m", effort),
        velocity=_limits(urdf, path.name, arm, "velocity", "rad/s", velocity),
        search=searched_stance,
        **hand,
    )
    try:
        described_robot(robot).compile()
    except ValueError as error:
        raise ValueError(f"{path}: MuJoCo cannot simulate it: {error}") from error
    return robot


def _hand_of(
    urdf: Any,
    file: str,
    tool: str,
    fingers: tuple[str, str] | None,
    grasp_point: Vector | None,
    approach: Vector | None,
    closing: Vector | None,
) -> tuple[Arm, dict[str, Any]]:
    """Return the arm up to the hand, and the fields of a `RobotConfig` for the hand."""
    if grasp_point is not None and not fingers:
        raise ValueError(f"{file}: grasp_point is between fingers; give them, too")
    strokes = []
    for finger in map(prefixed, fingers or ()):
        joint = urdf.joint_map.get(finger)
        slides = joint and joint.type == "prismatic" and joint.limit
        strokes.append(float(joint.limit.upper or 0.0) if slides else 0.0)
        if not strokes[-1] > 0.0 or grasp_point is None:
            raise ValueError(
                f"{file}: fingers are two prismatic joints that open from zero, got "
                f"{finger!r}; give grasp_point, where they meet in the tool's frame"
            )
    if fingers:
        joint = urdf.joint_map[prefixed(fingers[0])]
        tool, approach = tool or joint.parent, approach or (0.0, 0.0, 1.0)
        axes = urdf.get_transform(joint.child, tool)[:3, :3]
        closing = axes @ joint.axis if closing is None else closing
    arm, tool = _arm_of(urdf, file, tool)
    if not approach:
        # The axis of the tool that leads away from the last joint.
        (_, before), (last, link) = arm[-2:]
        pose, axis = urdf.get_transform(tool, link), np.array(urdf.joint_map[last].axis)
        away = pose[:3, 3]
        if np.linalg.norm(away) < 0.02:
            along = axis @ urdf.get_transform(before, link)[:3, 3]
            away = axis * -np.sign(along) if abs(along) > 1e-3 else pose[:3, 2]
        away = pose[:3, :3].T @ away
        direction, most = np.zeros(3), int(np.abs(away).argmax())
        direction[most] = math.copysign(1.0, away[most])
        approach = _unit("approach", direction)
    approach = _unit("approach", approach)
    across = (0.0, 1.0, 0.0) if abs(approach[0]) > 0.9 else (1.0, 0.0, 0.0)
    closing = _unit("closing", across if closing is None else closing)
    if abs(np.dot(approach, closing)) > 1e-6:
        raise ValueError(f"approach {approach}, closing {closing}: not perpendicular")
    axes, point = np.eye(3), np.array([0.0, 0.0, -_GRIPPER_REACH])
    hand: dict[str, Any] = {
        "tool": "gripper_link",
        "flange": tool,
        "flange_axes": (approach, closing),
        "approach": (0.0, 0.0, -1.0),
    }
    if fingers:
        axes, point = grasp_axes(approach, closing), np.array(grasp_point, dtype=float)
        hand = {
            "tool": tool,
            "fingers": tuple(map(prefixed, fingers)),
            "finger_stroke": min(0.045, *strokes),
            "approach": approach,
            "closing": closing,
        }
    # The camera is beside the palm and looks at the finger tips.
    place = point + axes @ [0.0, -0.12, 0.175]
    camera = place, -axes[:, 0], axes @ [0.0, -0.83, -0.56]
    hand["grasp_point"], hand["sensor"] = tuple(point.tolist()), hand["tool"]
    hand["hand_camera"] = tuple(tuple(vector.tolist()) for vector in camera)
    return arm, hand


def _unit(what: str, vector: Any) -> Vector:
    numbers = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(numbers)) if numbers.shape == (3,) else 0.0
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"{what} must be a direction (x, y, z), got {vector!r}")
    x, y, z = (numbers / length).tolist()
    return x, y, z


def chosen(robot: RobotConfig) -> str:
    """Return what was chosen in a URDF, in words."""
    hand = f"the generic gripper on {robot.flange}" if robot.flange else robot.tool
    stand = robot.base_link or "the root link"
    joints = ", ".join(robot.arm)
    return f"{robot.name}: joints {joints}; hand: {hand}; on the stand: {stand}"


_JAW: Final = 2.1  # A joint that turns less may open a gripper [rad].
_HAND: Final = re.compile("gripper|finger|jaw|thumb|knuckle|claw", re.IGNORECASE)
_RIGHT: Final = re.compile("(?i:right)|(?<![A-Za-z])[rR](?![a-z])")
_SIDE: Final = re.compile("(?i:left|right)|(?<![A-Za-z])[lrLR](?![a-z])")


def _arm_of(urdf: Any, file: str, tool: str) -> tuple[Arm, str]:
    """Return the turning joints up to a tool, with their links, and the tool.

    If no tool is given, it is the link before the gripper of the chain with most
    turning joints, or the last link of that chain. Behind five turning joints a gripper
    begins where the chain branches into parts that move, or at a joint that slides, is
    mimicked or mimics, or is named like one; behind six also at the last one if it
    opens as a jaw.
    """
    joints = list(urdf.joint_map.values())
    above = {joint.child: joint for joint in joints}
    parents = {joint.parent for joint in joints}
    mimicked = {joint.mimic.joint for joint in joints if joint.mimic is not None}
    moved = [joint.child for joint in joints if joint.type != "fixed"]
    moving = {link for child in moved for link in lineage(urdf, child)}
    branching = [joint.parent for joint in joints if joint.child in moving]
    if tool and tool not in urdf.link_map:
        links = ", ".join(urdf.link_map)
        raise ValueError(f"{file} has no link {tool!r}; it has {links}; give a tool")

    def arm_to(end: str) -> tuple[Arm, str]:
        arm: Arm = ()
        for link in reversed(lineage(urdf, end)[:-1]):
            joint = above[link]
            turns = joint.type in ("revolute", "continuous")
            low, high = _range(joint)
            opens = high - low < _JAW and min(-low, high) < 0.1 and link not in parents
            ends = (
                not (turns or joint.type == "fixed")
                or branching.count(joint.parent) > 1
                or joint.mimic is not None
                or joint.name in mimicked
                or (joint.type != "fixed" and _HAND.search(joint.name))
                or (len(arm) >= 6 and (_HAND.search(link) or (turns and opens)))
            )
            if not tool and len(arm) >= 5 and ends:
                return arm, joint.parent
            if turns:
                arm += ((joint.name, link),)
        return arm, end

    arms: dict[Arm, str] = {}
    for link in [tool] if tool else [n for n in urdf.link_map if n not in parents]:
        arm, end = arm_to(link)
        # The link before a gripper, else the last link in the file: often the flange.
        if arms.get(arm) is None or arms[arm] not in parents or end in parents:
            arms[arm] = end
    most = max(map(len, arms))
    longest = {arm: end for arm, end in arms.items() if len(arm) == most}
    ends = list(longest.values())
    if most < 6:
        raise ValueError(
            f"{file}: {most} turning joints lead to {ends[-1]!r}, fewer than six: give "
            "tool, the link of the hand"
        )
    if len({_SIDE.sub("*", arm[-1][0]) for arm in longest}) > 1 or len(ends) > 2:
        raise ValueError(
            f"{file}: {', '.join(ends)} are ends of equally long chains; give one "
            f'as tool, in a .json: {{"path": "{file}", "tool": "{ends[-1]}"}}'
        )
    # Of two arms the right one.
    right = max(longest, key=lambda arm: bool(_RIGHT.search(arm[-1][0])))
    for joint in (above[link] for _, link in right):
        if joint.mimic:
            raise ValueError(
                f"{file}: joint {joint.name} of the arm mimics {joint.mimic.joint}, but"
                " each is driven by itself: leave out <mimic>, or give a tool before it"
            )
    low, high = _range(joint)
    if not tool and len(right) > 6 and high - low < _JAW:
        last = f"the last joint, {joint.name}, turns by {math.degrees(high - low):.0f}°"
        hint = f"if it opens a gripper, give as tool the link before, {joint.parent!r}"
        warnings.warn(f"{file}: {last}: {hint}", stacklevel=2)
    return right, longest[right]


def _range(joint: Any) -> tuple[float, float]:
    """Return the limits of a revolute joint [rad], unlimited for another."""
    limited = joint.type == "revolute" and joint.limit is not None
    ends = (joint.limit.lower, joint.limit.upper) if limited else (-math.inf, math.inf)
    return ends[0] or 0.0, ends[1] or 0.0


# Greatest accepted limit of a revolute joint [rad]. Some wrists turn by more than one
# turn; larger values are nearly always degrees.
_MOST_TURNED: Final = 4 * math.pi


def _limits(
    urdf: Any,
    file: str,
    arm: Arm,
    what: str,
    unit: str,
    limits: float | Mapping[str, float] | None,
) -> tuple[tuple[str, float], ...]:
    """Return limits that replace those of a URDF; refuse a joint of the arm without."""
    joints = {name: urdf.joint_map[name] for name, _ in arm}
    if isinstance(limits, Mapping | None):
        replaced = {prefixed(name): float(n) for name, n in (limits or {}).items()}
    else:
        replaced = dict.fromkeys(joints, float(limits))
    if unknown := replaced.keys() - joints:
        raise ValueError(f"{what} names {min(unknown)}, no joint of the arm")
    stated = {name: getattr(joint.limit, what, 0) for name, joint in joints.items()}
    most = 1e5 if what == "effort" else 1e3  # More than any arm has.
    without = [
        name
        for name, limit in (stated | replaced).items()
        if not 0.0 < (limit or 0.0) <= most
    ]
    if without:
        raise ValueError(
            f"{file}: 0, nothing, or more than {most:g} {unit} would mean no limit; "
            f"write in <limit>, or give the {what} of {', '.join(without)} (.json: "
            f'"{what}": {{"{without[0]}": ...}}, or one number for all, {unit})'
        )
    for name, joint in joints.items():
        low, high = _range(joint)
        turns = joint.type == "revolute"
        if turns and (not low < high or max(-low, high) > _MOST_TURNED):
            raise ValueError(
                f"{file}: revolute joint {name} has the limits {low:g} to {high:g}; "
                "give <limit lower=... upper=...> in radians, not degrees, in two "
                'turns, or type="continuous" if it has none'
            )
    return tuple(replaced.items())
