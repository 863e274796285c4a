"""Robots from their URDF: an arm alone, which a stand carries and a gripper completes.

yourdfpy reads the description and computes its kinematics; MuJoCo takes the same text
with the stand, the gripper and the finger pads in it. Collision geometry of the URDF is
left out: only finger pads touch a handle, and capsules stand for the links of a mobile
robot.
"""

import math
import os
import warnings
import xml.etree.ElementTree as ET
from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import lru_cache
from pathlib import Path
from typing import Any, Final, get_args

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.assets import asset_path
from gplfd_env.conventions.constants import Array, Base
from gplfd_env.doors.config import Swing
from gplfd_env.robot.config import (
    BASE_RADIUS,
    HELD,
    Before,
    Capsule,
    RobotConfig,
    Stance,
    Vector,
    grasp_axes,
)

ASSETS: Final = ("tiago_like.urdf", "panda_like.urdf", "ur5e_like.urdf")
"""The robots of this project."""

PAD_BEHIND: Final = 0.02
"""How far the middle of a finger pad is behind the grasped point [m]."""

_PAD: Final = (0.01, 0.04, 0.08)
"""Thickness, width and length of a finger pad [m]."""

_GRIPPER_REACH: Final = 0.16
"""Distance of the grasped point from the flange of the generic gripper [m]."""

_LINK_RADIUS: Final = 0.055
_ARMATURE: Final = 0.1
_TILT: Final = math.radians(30.0)
"""How far the approach at the home posture may be from level [rad]."""


Grasp = Callable[[Array], tuple[Array, Array]]
"""Position (3,) [m] and axes (3, 3) of the grasp frame in the arm's root frame, from
joint positions [rad]."""


def described_robot(robot: RobotConfig) -> mujoco.MjSpec:
    """Return a robot as MuJoCo reads it, one body per link; it has no servos yet."""
    path = _path(robot.urdf)
    if not robot.stand:
        return mujoco.MjSpec.from_file(str(path))
    spec = mujoco.MjSpec.from_string(_completed(robot))
    for name, (vertices, faces, body, place, turn, colour) in _meshes(str(path)).items():
        spec.add_mesh(name=name, uservert=vertices, userface=faces)
        spec.body(body).add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH,
            meshname=name,
            pos=place,
            quat=turn,
            rgba=colour,
            mass=0.0,
            contype=0,
            conaffinity=0,
        )
    first, second = robot.fingers
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=first,
        name2=second,
        data=[0.0, 1.0, *[0.0] * 9],
    )
    return spec


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
    stances: Sequence[tuple[Before, Stance]] = (),
) -> RobotConfig:
    """Make a robot of the URDF of an arm, which a stand or a mobile base carries.

    Args:
        path: The URDF. Its joints between root and tool are the arm's, its other
            joints but the fingers' are locked.
        name: What messages call it; the URDF's own name by default.
        base: Whether the stand is fixed or drives.
        tool: Link of the hand; by default the link of the fingers, or the last link of
            the longest chain.
        grasp_point: Between the finger tips, frame of the tool [m]; needed with
            fingers. The generic gripper's is 0.16 m beyond the tool.
        approach: Direction in which the hand approaches, frame of the tool.
        closing: Direction in which the first finger opens, frame of the tool; by
            default that of its joint, or the tool's x axis for the generic gripper.
        fingers: Two prismatic joints, zero where closed; None for an arm without a
            gripper, which gets the generic one.
        home: Positions of the arm's joints that hold a bar, the approach level [rad]:
            the robot stands so that they hold the closed handle. By default the best
            of seeded random postures.
        armature: Rotor inertia of the joints, of all or of each [kg m²].
        stances: How it stands before doors; by default from `home` alone.

    Raises:
        ValueError: A file that is no URDF, or names and numbers that do not fit it.
    """
    path = _path(os.fspath(path))
    urdf = _read(str(path))
    if fingers is not None:
        for finger in fingers:
            if finger not in urdf.joint_map or urdf.joint_map[finger].type != "prismatic":
                raise ValueError(
                    f"{path.name}: fingers are two prismatic joints, got {finger!r}; "
                    f"there are {_joints(urdf, 'prismatic')}"
                )
        joint = urdf.joint_map[fingers[0]]
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
    values = np.broadcast_to(armature, len(joints))
    parts: dict[str, Any] = {
        "name": name or urdf.robot.name,
        "urdf": str(path),
        "base": base,
        "arm": joints,
        "armature": tuple(map(float, values)),
        "forearm": arm[len(arm) // 2][1],
        "head": ("stand_base", (-0.19, 0.0, 1.47)),
        "capsules": _capsules(urdf, [link for _, link in arm]),
        "stances": tuple(stances),
    }
    if fingers is None:
        point = np.array(approach) * _GRIPPER_REACH if grasp_point is None else grasp_point
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
                0.045, *(float(urdf.joint_map[one].limit.upper) for one in fingers)
            ),
            "grasp_point": tuple(map(float, point)),
            "approach": approach,
            "closing": closing,
            "hand_camera": _camera(grasp_axes(approach, closing), point),
        }
    robot = RobotConfig(**parts)
    if stances:
        return robot
    return _standing(robot, urdf, tool, grasp_axes(approach, closing), point, home)


def _path(urdf: str) -> Path:
    """Return the path of a description, which may be an asset's name."""
    path = Path(urdf)
    if path.is_file():
        return path.resolve()
    if path.name == urdf and urdf in ASSETS:
        return asset_path(urdf)
    raise FileNotFoundError(f"{urdf}: there is no such URDF")


@lru_cache(maxsize=8)
def _read(path: str) -> Any:
    """Return a URDF as yourdfpy's object, without its meshes."""
    import yourdfpy

    try:
        urdf = yourdfpy.URDF.load(
            path, load_meshes=False, load_collision_meshes=False, mesh_dir=""
        )
        if not urdf.joint_map:
            raise ValueError("it has no joints")
    except Exception as error:
        raise ValueError(f"{path} is no URDF of an arm: {error}") from error
    return urdf


def _joints(urdf: Any, *kinds: str) -> str:
    names = [name for name, joint in urdf.joint_map.items() if joint.type in kinds]
    return ", ".join(names) or "none"


def _unit(what: str, vector: Any) -> Vector:
    numbers = np.array(vector, dtype=np.float64)
    length = float(np.linalg.norm(numbers)) if numbers.shape == (3,) else 0.0
    if not (math.isfinite(length) and length > 0.0):
        raise ValueError(f"{what} must be a direction (x, y, z), got {vector!r}")
    x, y, z = (numbers / length).tolist()
    return x, y, z


def _arm_of(urdf: Any, path: Path, tool: str) -> list[tuple[str, str]]:
    """Return the turning joints from the root to a tool, each with the link it moves.

    Without a tool it is the last link of the chain with the most of them; the last
    pair's link is then that tool.
    """
    above = {joint.child: joint for joint in urdf.joint_map.values()}
    if tool and tool not in urdf.link_map:
        raise ValueError(
            f"{path.name} has no link {tool!r}; it has {', '.join(urdf.link_map)}"
        )

    def chain(link: str) -> list[tuple[str, str]]:
        found = []
        while link in above:
            joint = above[link]
            if joint.type in ("revolute", "continuous") and joint.mimic is None:
                found.append((joint.name, joint.child))
            link = joint.parent
        return found[::-1]

    parents = {joint.parent for joint in urdf.joint_map.values()}
    ends = [tool] if tool else [link for link in urdf.link_map if link not in parents]
    # Of equal chains the last link that the file names: a frame at the flange.
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


def _completed(robot: RobotConfig) -> str:
    """Return the URDF of a robot on its stand, with gripper and finger pads."""
    path = _path(robot.urdf)
    tree = ET.parse(path).getroot()
    moving = {*robot.arm, *robot.fingers}
    for joint in tree.findall("joint"):
        for mimic in joint.findall("mimic"):
            joint.remove(mimic)
        if joint.get("name") not in moving:
            joint.set("type", "fixed")
    for link in tree.findall("link"):
        for kind in ("collision", "visual"):
            for shape in link.findall(kind):
                if kind == "collision" or shape.find("geometry/mesh") is not None:
                    link.remove(shape)
    for other in tree.findall("mujoco"):
        tree.remove(other)
    options = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
    ET.SubElement(ET.SubElement(tree, "mujoco"), "compiler", options)
    children = {one.get("link") for one in tree.findall("joint/child")}
    (root,) = (
        str(one.get("name")) for one in tree.findall("link") if one.get("name") not in children
    )
    tree.extend(ET.parse(asset_path("stand.urdf")).getroot())
    _join(tree, "stand_lift_link", root, np.eye(3))
    if robot.flange:
        tree.extend(ET.parse(asset_path("gripper.urdf")).getroot())
        _join(tree, robot.flange, "gripper_link", grasp_axes(*robot.flange_axes))
    links = {str(one.get("name")): one for one in tree.findall("link")}
    joints = {str(one.get("name")): one for one in tree.findall("joint")}
    for side, outwards, finger in zip(
        ("right", "left"), (1.0, -1.0), robot.fingers, strict=True
    ):
        child = joints[finger].find("child")
        link = str(child.get("link")) if child is not None else ""
        place, axes = np.array([outwards * _PAD[0] / 2, 0.0, PAD_BEHIND]), np.eye(3)
        if not robot.flange:
            at_zero = _read(str(path)).get_transform(robot.tool, link)
            axes = at_zero[:3, :3] @ robot.grasp_axes
            place = at_zero[:3, :3] @ robot.grasp_point + at_zero[:3, 3] + axes @ place
        pad = ET.SubElement(links[link], "collision", {"name": f"{side}_finger_pad"})
        ET.SubElement(pad, "origin", _origin(place, axes))
        size = " ".join(map(str, _PAD))
        ET.SubElement(ET.SubElement(pad, "geometry"), "box", {"size": size})
    return ET.tostring(tree, encoding="unicode")


def _join(tree: ET.Element, parent: str, child: str, axes: Array) -> None:
    """Mount a link on another with a turn, by a fixed joint."""
    joint = ET.SubElement(tree, "joint", {"name": f"{child}_mount", "type": "fixed"})
    ET.SubElement(joint, "parent", {"link": parent})
    ET.SubElement(joint, "child", {"link": child})
    ET.SubElement(joint, "origin", _origin(np.zeros(3), axes))


def _origin(place: Array, axes: Array) -> dict[str, str]:
    turn = Rotation.from_matrix(axes).as_euler("xyz")
    return {
        "xyz": " ".join(map(repr, place.tolist())),
        "rpy": " ".join(map(repr, turn.tolist())),
    }


def _camera(axes: Array, point: Array) -> tuple[Vector, Vector, Vector]:
    """Return a camera beside the palm that looks at the finger tips."""
    place = point + axes @ [0.0, -0.12, 0.175]
    vectors = (place, -axes[:, 0], axes @ [0.0, -0.83, -0.56])
    position, right, up = (tuple(vector.tolist()) for vector in vectors)
    return position, right, up


def _capsules(urdf: Any, links: Sequence[str]) -> tuple[Capsule, ...]:
    """Return capsules along the links of an arm, and those of the stand."""
    found = [
        Capsule("base_body", "stand_base", (0, 0, 0.17, 0, 0, 0.19), BASE_RADIUS),
        Capsule("column_body", "stand_lift_link", (0, 0, -0.1, 0, 0, -0.4), 0.08),
    ]
    for link, following in zip(links, links[1:], strict=False):
        x, y, z = urdf.get_transform(following, link)[:3, 3].tolist()
        if math.hypot(x, y, z) > _LINK_RADIUS:
            ends = (0.0, 0.0, 0.0, x, y, z)
            found.append(Capsule(f"{link}_body", link, ends, _LINK_RADIUS))
    return tuple(found)


def _standing(
    robot: RobotConfig,
    urdf: Any,
    tool: str,
    axes: Array,
    point: Array,
    home: Sequence[float] | None,
) -> RobotConfig:
    """Return a robot that stands before every door as at its home posture.

    `axes` and `point` are those of the grasp frame in the frame of the tool.
    """

    def grasp(posture: Array) -> tuple[Array, Array]:
        urdf.update_cfg(dict(zip(robot.arm, posture.tolist(), strict=True)))
        there = urdf.get_transform(tool)
        return there[:3, :3] @ point + there[:3, 3], there[:3, :3] @ axes

    limits = np.array([_range(urdf.joint_map[name]) for name in robot.arm])
    if home is None:
        home = _found_home(grasp, limits)
    posture = np.array(home, dtype=np.float64)
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
    # A lever is held with the last joint turned by a quarter, the way that is farther
    # from its limits.
    middle = limits[-1].mean()
    turned[-1] += math.copysign(math.pi / 2, middle - turned[-1])
    found = []
    for held in HELD:
        own = posture if held == "bar" else turned
        place, frame = grasp(own)
        stance = Stance(
            handle_xy_w=(float(place[0]), float(place[1])),
            door_yaw=math.atan2(-frame[1, 2], -frame[0, 2]),
            below_handle=float(place[2]),
            closed_posture=tuple(own.tolist()),
            roll=_roll(frame),
            radius=1.05,
            height=1.22,
        )
        found += [
            (Before(base, swing, held, side), stance)
            for base in get_args(Base)
            for swing in get_args(Swing)
            for side in ("right", "left")
        ]
    return replace(robot, stances=tuple(found))


def _roll(frame: Array) -> float:
    """Return the roll of a grasp frame in quarter turns, axes as columns [rad].

    Zero if the fingers close across an upright bar, the first to the right.
    """
    approach, up = -frame[:, 2], np.array([0.0, 0.0, 1.0])
    right = np.cross(approach, up)
    turn = math.atan2(-frame[:, 0] @ up, frame[:, 0] @ right)
    return round(turn / (math.pi / 2)) * (math.pi / 2)


def _range(joint: Any) -> tuple[float, float]:
    """Return the limits of a joint; of a continuous one a turn to each side [rad]."""
    if joint.limit is None or joint.type == "continuous":
        return -math.pi, math.pi
    return float(joint.limit.lower), float(joint.limit.upper)


def _found_home(grasp: Grasp, limits: Array) -> Array:
    """Return the best of random postures with a level approach away from the base.

    The best has the largest product of its distance to joint limits and of the least
    singular value of the hand's Jacobian. Raises a ValueError if none is level.
    """
    rng = np.random.default_rng(0)
    low, high = np.maximum(limits.T[0], -math.pi), np.minimum(limits.T[1], math.pi)
    best, posture = 0.0, None
    for share in rng.uniform(0.1, 0.9, size=(4000, len(limits))):
        tried = low + share * (high - low)
        place, frame = grasp(tried)
        out = np.hypot(*place[:2])
        ahead = -frame[:2, 2] @ place[:2] > 0.8 * out
        upright = abs(_roll(frame)) in (0.0, math.pi)
        if abs(frame[2, 2]) > 0.15 or not (ahead and upright and out > 0.45):
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
    return posture


@lru_cache(maxsize=8)
def _meshes(path: str) -> dict[str, tuple[Array, Array, str, Array, Array, Array]]:
    """Return the meshes of a URDF: vertices, faces, link, place, turn and colour.

    A file that is not found is left out with a warning.
    """
    found = {}
    urdf = _read(path)
    for link in urdf.robot.links:
        for number, visual in enumerate(link.visuals):
            mesh = visual.geometry.mesh
            if mesh is None:
                continue
            import trimesh

            file = urdf._filename_handler(mesh.filename)
            try:
                shape = trimesh.load(file, force="mesh")
            except (OSError, ValueError) as error:
                warnings.warn(
                    f"the robot is drawn without {mesh.filename}: {error}", stacklevel=2
                )
                continue
            pose = np.eye(4) if visual.origin is None else visual.origin
            colour = np.array([0.75, 0.76, 0.78, 1.0])
            material = visual.material
            if material is not None and material.color is not None:
                colour = np.array(material.color.rgba, dtype=np.float64)
            scale = 1.0 if mesh.scale is None else mesh.scale
            found[f"{link.name}_{number}"] = (
                (shape.vertices * scale).ravel(),
                shape.faces.ravel(),
                link.name,
                pose[:3, 3],
                Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True),
                colour,
            )
    return found
