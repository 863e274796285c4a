"""Description of a robot for MuJoCo: its URDF with stand, gripper and finger pads.

Collision geometry of the URDF is left out: only finger pads touch a handle, and
capsules replace the links of a mobile robot.
"""

import logging
import math
import warnings
import xml.etree.ElementTree as ET
from functools import lru_cache
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_env.conventions.assets import asset_path
from gplfd_env.conventions.constants import INTANGIBLE, Array
from gplfd_env.robot.config import RobotConfig, grasp_axes

ASSETS: Final = ("tiago_like.urdf", "panda_like.urdf", "ur5e_like.urdf")
"""Descriptions of the robots of this project."""

PAD_BEHIND: Final = 0.02
"""How far the middle of a finger pad is behind the grasped point [m]."""

_PAD: Final = (0.01, 0.04, 0.08)
"""Thickness, width and length of a finger pad [m]."""

_MOST_TURNED: Final = 4 * math.pi
"""Greatest accepted limit of a revolute joint [rad]. Some wrists turn by more than one
turn; larger values are nearly always degrees."""

_GREY: Final = (0.75, 0.76, 0.78, 1.0)


def described_robot(robot: RobotConfig) -> mujoco.MjSpec:
    """Return a robot as a MuJoCo spec, one body per link, still without servos."""
    path = urdf_path(robot.urdf)
    if not robot.stand:
        return mujoco.MjSpec.from_file(str(path))
    spec = mujoco.MjSpec.from_string(_completed(robot))
    for joint in map(spec.joint, robot.arm):
        if joint.range[0] == joint.range[1]:
            # The joint is continuous; no door needs more than a turn to each side.
            joint.limited, joint.range = True, (-2.0 * math.pi, 2.0 * math.pi)
    for body, mesh, geom in _meshes(str(path)):
        spec.add_mesh(**mesh)
        spec.body(body).add_geom(
            type=mujoco.mjtGeom.mjGEOM_MESH, mass=0.0, **geom, **INTANGIBLE
        )
    first, second = robot.fingers
    spec.add_equality(
        type=mujoco.mjtEq.mjEQ_JOINT,
        objtype=mujoco.mjtObj.mjOBJ_JOINT,
        name1=first,
        name2=second,
        data=[0.0, 1.0, *[0.0] * 10],
    )
    return spec


def urdf_path(urdf: str) -> Path:
    """Return the path of a description, given as a path or an asset's name."""
    path = Path(urdf)
    if path.is_file():
        return path.resolve()
    if path.name == urdf and urdf in ASSETS:
        return asset_path(urdf)
    raise FileNotFoundError(f"{urdf}: there is no such URDF")


@lru_cache(maxsize=8)
def read_urdf(path: str) -> Any:
    """Return a URDF as yourdfpy's object, without its meshes.

    Raises a ValueError if the file is not a URDF, or a revolute joint has no limits in
    radians, which neither yourdfpy nor MuJoCo explains.
    """
    import yourdfpy

    try:
        urdf = yourdfpy.URDF.load(path, load_meshes=False, load_collision_meshes=False)
    except Exception as error:
        raise ValueError(f"{path} is not a URDF of an arm: {error}") from error
    for joint in urdf.joint_map.values():
        limit = joint.limit
        low, high = (limit and limit.lower) or 0.0, (limit and limit.upper) or 0.0
        turns = joint.type == "revolute"
        if turns and (not low < high or max(-low, high) > _MOST_TURNED):
            raise ValueError(
                f"{path}: the revolute joint {joint.name} has the limits {low:g} to "
                f"{high:g}; give <limit lower=... upper=...> in radians, not degrees, "
                "from lower to upper and within two turns, or "
                'type="continuous" if it has none'
            )
    return urdf


def _completed(robot: RobotConfig) -> str:
    """Return the URDF of a robot on its stand, with gripper and finger pads."""
    path = urdf_path(robot.urdf)
    urdf = read_urdf(str(path))  # which also checks it
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
    for element in tree.iter():
        # MuJoCo reserves the name "world" for the fixed body.
        for attribute in ("name", "link"):
            if element.get(attribute) == "world":
                element.set(attribute, "urdf_world")
    options = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
    ET.SubElement(ET.SubElement(tree, "mujoco"), "compiler", options)
    children = {element.get("link") for element in tree.findall("joint/child")}
    names = {str(element.get("name")) for element in tree.findall("link")}
    (root,) = names - children
    mounts = [("stand", "stand_lift_link", root, np.eye(3))]
    if robot.flange:
        axes = grasp_axes(*robot.flange_axes)
        mounts.append(("gripper", robot.flange, "gripper_link", axes))
    for part, parent, child, axes in mounts:
        added = ET.parse(asset_path(f"{part}.urdf")).getroot()
        tree.extend(added)
        # A fixed joint with a rotation.
        attributes = {"name": f"{child}_mount", "type": "fixed"}
        joint = ET.SubElement(tree, "joint", attributes)
        ET.SubElement(joint, "parent", {"link": parent})
        ET.SubElement(joint, "child", {"link": child})
        ET.SubElement(joint, "origin", _origin(np.zeros(3), axes))
    links = {str(link.get("name")): link for link in tree.findall("link")}
    moved = {
        str(joint.get("name")): str(child.get("link"))
        for joint in tree.findall("joint")
        for child in joint.findall("child")
    }
    for side, outwards, finger in zip(
        ("right", "left"), (1.0, -1.0), robot.fingers, strict=True
    ):
        body = moved[finger]
        place, axes = np.array([outwards * _PAD[0] / 2, 0.0, PAD_BEHIND]), np.eye(3)
        if not robot.flange:
            closed = urdf.get_transform(robot.tool, body)
            axes = closed[:3, :3] @ robot.grasp_axes
            place = closed[:3, :3] @ robot.grasp_point + closed[:3, 3] + axes @ place
        pad = ET.SubElement(links[body], "collision", {"name": f"{side}_finger_pad"})
        ET.SubElement(pad, "origin", _origin(place, axes))
        size = " ".join(map(str, _PAD))
        ET.SubElement(ET.SubElement(pad, "geometry"), "box", {"size": size})
    return ET.tostring(tree, encoding="unicode")


def _origin(place: Array, axes: Array) -> dict[str, str]:
    turn = Rotation.from_matrix(axes).as_euler("xyz")
    return {
        "xyz": " ".join(map(repr, place.tolist())),
        "rpy": " ".join(map(repr, turn.tolist())),
    }


@lru_cache(maxsize=8)
def _meshes(path: str) -> tuple[tuple[str, dict[str, Any], dict[str, Any]], ...]:
    """Return the meshes of a URDF: link, fields of MuJoCo's mesh, fields of its geom.

    A file that cannot be read, or contains no mesh, is left out. One warning names
    the first.
    """
    import trimesh

    logging.getLogger("yourdfpy").setLevel(logging.ERROR)  # says it once per mesh
    meshes, urdf, absent = [], read_urdf(path), list[str]()
    for link in urdf.robot.links:
        for number, visual in enumerate(link.visuals):
            mesh = visual.geometry.mesh
            if mesh is None:
                continue
            try:
                file = urdf._filename_handler(mesh.filename)
                if not Path(file).is_file():
                    raise FileNotFoundError(
                        "no such file; it is searched from the folder of the URDF, "
                        "for package:// also in those above"
                    )
                shape: Any = trimesh.load(file, force="mesh")
                if len(shape.vertices) < 4:  # which MuJoCo refuses
                    raise ValueError("it holds no mesh")
            except Exception as error:  # trimesh's loaders raise all kinds
                absent.append(f"{mesh.filename}: {error}")
                continue
            name = f"{link.name}_{number}"
            pose = np.eye(4) if visual.origin is None else visual.origin
            geom = {
                "meshname": name,
                "pos": pose[:3, 3],
                "quat": Rotation.from_matrix(pose[:3, :3]).as_quat(scalar_first=True),
                "rgba": getattr(getattr(visual.material, "color", None), "rgba", _GREY),
            }
            scale = 1.0 if mesh.scale is None else mesh.scale
            fields = {
                "name": name,
                "uservert": (shape.vertices * scale).ravel(),
                "userface": shape.faces.ravel(),
                # MuJoCo rejects flat meshes, which have no volume, unless as shells.
                "inertia": mujoco.mjtMeshInertia.mjMESH_INERTIA_SHELL,
            }
            meshes.append((link.name, fields, geom))
    if absent:
        more = f"; likewise {len(absent) - 1} more" if absent[1:] else ""
        warnings.warn(f"the robot is drawn without {absent[0]}{more}", stacklevel=2)
    return tuple(meshes)
