"""Description of a robot for MuJoCo: its URDF with stand, gripper and finger pads.

Collision geometry of the URDF is left out: only finger pads touch a handle, and
capsules replace the links of a mobile robot.
"""

import io
import logging
import math
import re
import warnings
import xml.etree.ElementTree as ET
from functools import lru_cache, partial
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

_PAD: Final = (0.01, 0.04, 0.08)  # Thickness, width and length of a finger pad [m].
_HEAVIEST: Final = 1e4  # Greatest mass of a link [kg].
# Names of bodies and joints in a scene that are not those of an arm.
_TAKEN: Final = re.compile(
    "world|motors|door(_frame)?|handle|bolt|hinge|along|out|coordinate|"
    "stand_(base|lift|lift_link)|(base|drive)_(x|y|yaw)_joint|gripper_link(_mount)?|"
    "gripper_(left|right)_finger_(joint|link)"
)
_MESHES: Final = (".stl", ".obj", ".dae", ".ply", ".glb", ".off")
_LARGEST: Final = 50 << 20  # Greatest size of a mesh that is read [bytes].
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
    for link, mesh, geom in _meshes(str(path), content_of(path)):
        body = spec.body(link)
        if body is not None:  # Links above the base link are left out.
            spec.add_mesh(**mesh)
            kind = mujoco.mjtGeom.mjGEOM_MESH
            body.add_geom(type=kind, mass=0.0, **geom, **INTANGIBLE)
    first, second = robot.fingers
    joints = {"type": mujoco.mjtEq.mjEQ_JOINT, "objtype": mujoco.mjtObj.mjOBJ_JOINT}
    equal = [0.0, 1.0, *[0.0] * 10]
    spec.add_equality(name1=first, name2=second, data=equal, **joints)
    return spec


def urdf_path(urdf: str) -> Path:
    """Return the path of a description, given as a path or an asset's name."""
    path = Path(urdf)
    if path.is_file():
        return path.resolve()
    if path.name == urdf and urdf in ASSETS:
        return asset_path(urdf)
    raise FileNotFoundError(f"{urdf}: there is no such URDF")


def content_of(path: Path) -> bytes:
    """Return a URDF with the sizes and times of its meshes, by which it is cached."""
    import yourdfpy

    logging.getLogger("yourdfpy").setLevel(logging.ERROR)  # says it once per mesh
    content, find = path.read_bytes(), yourdfpy.filename_handler_magic
    names = re.findall(rb"""filename=["']([^"']+)""", content)
    files = [Path(find(name.decode("utf-8", "replace"), path.parent)) for name in names]
    stats = [file.stat() for file in files if file.is_file()]
    stamps = [(stat.st_size, stat.st_mtime_ns) for stat in stats]
    return content + f"<!-- {stamps} -->".encode() if stamps else content


def prefixed(name: str) -> str:
    """Return the name of a part of a URDF in the scene, where some names are taken."""
    return f"urdf_{name}" if _TAKEN.fullmatch(name) else name


def read_urdf(path: str) -> Any:
    """Return a URDF as yourdfpy's object, without meshes, or raise a ValueError."""
    return _read(path, Path(path).read_bytes())[0]


def _check_tree(tree: ET.Element) -> None:
    """Raise unless joints connect the links of a URDF to a tree."""
    names = [str(link.get("name")) for link in tree.findall("link")]
    if twice := {name for name in names if names.count(name) > 1}:
        raise ValueError(f"several links are called {min(twice)}")
    parents: dict[str, str] = {}
    for joint in tree.findall("joint"):
        ends = [joint.find(end) for end in ("parent", "child")]
        parent, child = ("" if e is None else e.get("link", "") for e in ends)
        if unknown := {parent, child} - {*names}:
            raise ValueError(f"{joint.get('name')} joins {min(unknown)!r}, no link")
        if child in parents:
            raise ValueError(f"link {child} is the child of several joints")
        parents[child] = parent
    for link in names:
        above = [link]
        while above[-1] in parents and len(above) <= len(names):
            above.append(parents[above[-1]])
        if len(above) > len(names):
            raise ValueError(f"its joints form a loop through the link {link}")


@lru_cache(maxsize=8)
def _read(path: str, content: bytes) -> tuple[Any, str]:
    """Return a URDF as yourdfpy's object and as text, both with prefixed names."""
    import yourdfpy

    try:
        tree = ET.fromstring(content)
        if any("xacro" in element.tag for element in tree.iter()):
            raise ValueError("it is a xacro file; `xacro FILE > arm.urdf` makes a URDF")
        _check_tree(tree)
        for element in tree.iter():
            for attribute in ("xyz", "rpy"):
                numbers = element.get(attribute, "")
                if not np.isfinite([float(n) for n in numbers.split()]).all():
                    raise ValueError(f"{element.tag} has {attribute}={numbers!r}")
            for attribute in ("name", "link", "joint"):
                if element.tag != "visual" and attribute in element.attrib:
                    element.set(attribute, prefixed(element.attrib[attribute]))
        text = ET.tostring(tree)
        urdf = yourdfpy.URDF.load(
            io.BytesIO(text),
            load_meshes=False,
            load_collision_meshes=False,
            filename_handler=partial(
                yourdfpy.filename_handler_magic, dir=Path(path).parent
            ),
        )
    except Exception as error:
        raise ValueError(f"{path} is not a URDF of an arm: {error}") from error
    return urdf, text.decode()


def _completed(robot: RobotConfig) -> str:
    """Return the URDF of a robot on its stand, with gripper and finger pads."""
    path = urdf_path(robot.urdf)
    urdf, text = _read(str(path), path.read_bytes())  # which also checks it
    tree, root = ET.fromstring(text), robot.base_link or urdf.base_link
    for part in [*tree.findall("link"), *tree.findall("joint")]:
        name = str(part.get("name"))
        link = name if part.tag == "link" else urdf.joint_map[name].parent
        if root not in lineage(urdf, link):
            tree.remove(part)
            continue
        for unused in (*part.findall("mimic"), *part.findall("collision")):
            part.remove(unused)
        for shape in part.findall("visual"):
            if shape.find("geometry/mesh") is not None:
                part.remove(shape)
            shape.attrib.pop("name", None)  # It may be that of another part.
        if part.tag == "joint" and name not in {*robot.arm, *robot.fingers}:
            part.set("type", "fixed")
    for other in tree.findall("mujoco"):
        tree.remove(other)
    options = {"fusestatic": "false", "discardvisual": "false", "strippath": "false"}
    ET.SubElement(ET.SubElement(tree, "mujoco"), "compiler", options)
    _mend_inertias(tree, urdf, robot, path.name)
    for quantity, limits in (("effort", robot.effort), ("velocity", robot.velocity)):
        for name, number in limits:
            (joint,) = tree.findall(f"joint[@name='{name}']")
            limit = joint.find("limit")
            limit = ET.SubElement(joint, "limit") if limit is None else limit
            limit.set(quantity, repr(number))
    axes = urdf.get_transform(root, urdf.base_link)[:3, :3]
    mounts = [("stand", "stand_lift_link", root, axes)]
    if robot.flange:
        axes = grasp_axes(*robot.flange_axes)
        mounts.append(("gripper", robot.flange, "gripper_link", axes))
    for added, parent, child, axes in mounts:
        tree.extend(ET.parse(asset_path(f"{added}.urdf")).getroot())
        # A fixed joint with a rotation.
        attributes = {"name": f"{child}_mount", "type": "fixed"}
        joint = ET.SubElement(tree, "joint", attributes)
        ET.SubElement(joint, "parent", {"link": parent})
        ET.SubElement(joint, "child", {"link": child})
        ET.SubElement(joint, "origin", _origin(np.zeros(3), axes))
    for side, outwards, finger in zip(
        ("right", "left"), (1.0, -1.0), robot.fingers, strict=True
    ):
        moved = tree.find(f"joint[@name='{finger}']/child")
        body = "" if moved is None else moved.attrib["link"]
        place, axes = np.array([outwards * _PAD[0] / 2, 0.0, PAD_BEHIND]), np.eye(3)
        if not robot.flange:
            closed = urdf.get_transform(robot.tool, body)
            axes = closed[:3, :3] @ robot.grasp_axes
            place = closed[:3, :3] @ robot.grasp_point + closed[:3, 3] + axes @ place
        (link,) = tree.findall(f"link[@name='{body}']")
        pad = ET.SubElement(link, "collision", {"name": f"{side}_finger_pad"})
        ET.SubElement(pad, "origin", _origin(place, axes))
        size = " ".join(map(str, _PAD))
        ET.SubElement(ET.SubElement(pad, "geometry"), "box", {"size": size})
    return ET.tostring(tree, encoding="unicode")


def lineage(urdf: Any, link: str) -> list[str]:
    """Return a link of a URDF and those above it, up to the root."""
    above = {joint.child: joint.parent for joint in urdf.joint_map.values()}
    links = [link]
    while links[-1] in above:
        links.append(above[links[-1]])
    return links


def _mend_inertias(tree: ET.Element, urdf: Any, robot: RobotConfig, file: str) -> None:
    """Leave out impossible inertias off the arm, balance those of moving links."""
    turned = [urdf.joint_map[joint].child for joint in robot.arm]
    mended: list[str] = []
    for link in tree.findall("link"):
        name, inertial = str(link.get("name")), link.find("inertial")
        stated = urdf.link_map[name].inertial
        mass = (stated and stated.mass) or 0.0
        if mass > _HEAVIEST:
            raise ValueError(f"link {name} has a mass of {mass:g} kg")
        inertia = np.zeros((3, 3))
        if stated is not None and stated.inertia is not None:
            inertia = stated.inertia
        least, middle, most = np.linalg.eigvalsh(inertia)
        # The inertias of a body fulfil least + middle >= most.
        if mass > 1e-9 and least > 1e-12 and least + middle - most > -1e-9:
            continue
        if inertial is not None:
            link.remove(inertial)
        if name in turned or mass or most:
            mended.append(name)
            if turned[0] in lineage(urdf, name):
                even = repr(max(float(np.trace(inertia)) / 3.0, 1e-6))
                moments = {"ixy": "0", "ixz": "0", "iyz": "0"}
                inertial = ET.SubElement(link, "inertial")
                ET.SubElement(inertial, "mass", {"value": repr(max(mass, 1e-3))})
                moments |= dict.fromkeys(("ixx", "iyy", "izz"), even)
                ET.SubElement(inertial, "inertia", moments)
    if mended:
        _warn_once(
            f"{file}: no body has the inertia of {', '.join(mended)}; it is left out "
            "off the arm, and the same about all axes on the arm",
            robot.content,
        )


@lru_cache(maxsize=8)
def _warn_once(text: str, content: bytes) -> None:
    """Warn of what is in a URDF, which is read for every scene."""
    warnings.warn(text, stacklevel=2)


def _origin(place: Array, axes: Array) -> dict[str, str]:
    turn = Rotation.from_matrix(axes).as_euler("xyz")
    place_and_turn = [" ".join(map(repr, x.tolist())) for x in (place, turn)]
    return dict(zip(("xyz", "rpy"), place_and_turn, strict=True))


@lru_cache(maxsize=8)
def _meshes(
    path: str, content: bytes
) -> tuple[tuple[str, dict[str, Any], dict[str, Any]], ...]:
    """Return links, meshes and geoms of a URDF; warn of files that cannot be read."""
    import trimesh

    meshes, urdf, absent = [], _read(path, content)[0], list[str]()
    for link in urdf.robot.links:
        for number, visual in enumerate(link.visuals):
            mesh = visual.geometry.mesh
            if mesh is None:
                continue
            try:
                file = urdf._filename_handler(mesh.filename)
                if not Path(file).is_file():
                    raise FileNotFoundError("no such file in its folder or those above")
                if Path(file).suffix.lower() not in _MESHES:
                    raise ValueError(f"a mesh is a {', '.join(_MESHES)} file")
                if Path(file).stat().st_size > _LARGEST:
                    raise ValueError(f"it has more than {_LARGEST >> 20} MiB")
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
