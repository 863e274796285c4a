"""MuJoCo's visual geoms as Rerun primitives on the entity of what carries them."""

import functools
from collections.abc import Mapping
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording.kinematics import poses_on_carriers
from gplfd_experiments.recording.stream import static

_GEOM: Final = mujoco.mjtGeom
_MESH: Final = int(_GEOM.mjGEOM_MESH)
_PRIMITIVES: Final = (
    _GEOM.mjGEOM_BOX,
    _GEOM.mjGEOM_ELLIPSOID,
    _GEOM.mjGEOM_CYLINDER,
    _GEOM.mjGEOM_CAPSULE,
)
_LARGEST_VISUAL_GROUP: Final = 2
"""MuJoCo's convention: geoms of groups 0 to 2 are drawn, 3 and above collide."""

_PLANE_HALF_SIZE: Final = 3.0
_PLANE_HALF_THICKNESS: Final = 0.005
_TEXTURED: Final = (0.42, 0.43, 0.45, 1.0)
"""Colour of geoms whose material has a texture; only floors do."""


def visual_geoms(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Ids of the visible geoms by the body that carries them, alone or with others."""
    seen = (model.geom_group <= _LARGEST_VISUAL_GROUP) & (_colours(model)[:, 3] > 0.0)
    carriers = model.body_weldid[model.geom_bodyid].tolist()
    geoms: dict[int, list[int]] = {}
    for geom in np.flatnonzero(seen).tolist():
        geoms.setdefault(carriers[geom], []).append(geom)
    return geoms


def drawn_geoms(model: mujoco.MjModel, entities: Mapping[int, str]) -> list[Chunk]:
    """Draw all visible geoms: one chunk per body that moves on its own, one per mesh.

    Args:
        model: Model to draw.
        entities: Path by body of `visual_geoms`.
    """
    kinds, rows = _solids(model)
    chunks: list[Chunk] = []
    for body, geoms in visual_geoms(model).items():
        primitives: dict[int, list[bytes]] = {}
        for geom in geoms:
            if kinds[geom] in _PRIMITIVES:
                primitives.setdefault(kinds[geom], []).append(rows[geom].tobytes())
            elif kinds[geom] == _MESH:
                path = f"{entities[body]}/mesh_{geom}"
                chunks.append(_mesh(model, geom, path, rows[geom]))
        packed = tuple((kind, b"".join(each)) for kind, each in primitives.items())
        chunks.append(_body(entities[body], packed))
    return chunks


def _solids(model: mujoco.MjModel) -> tuple[list[int], FloatArray]:
    """Kind (ngeom) and size, pose on the carrier, colour (ngeom, 14) of every geom.

    Spheres become ellipsoids and planes become thin boxes below them, so that a body
    has at most one archetype of each sort.
    """
    kinds, sizes = np.array(model.geom_type), np.array(model.geom_size)
    positions, quaternions = poses_on_carriers(model)
    balls, planes = kinds == _GEOM.mjGEOM_SPHERE, kinds == _GEOM.mjGEOM_PLANE
    sizes[balls] = sizes[balls, :1]
    if planes.any():
        # A size of 0 means infinite.
        sides = np.where(sizes[planes] == 0.0, _PLANE_HALF_SIZE, sizes[planes])
        sizes[planes] = np.minimum(sides, _PLANE_HALF_SIZE)
        sizes[planes, 2] = _PLANE_HALF_THICKNESS
        normals = _axes(xyzw(quaternions[planes]))
        positions[planes] -= _PLANE_HALF_THICKNESS * normals
    kinds[balls], kinds[planes] = _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_BOX
    rows = np.hstack([sizes, positions, quaternions, _colours(model)])
    return kinds.tolist(), rows


# The robot's bodies are the same beside every door.
@functools.lru_cache(maxsize=256)
def _body(entity: str, primitives: tuple[tuple[int, bytes], ...]) -> Chunk:
    """Draw the primitives of one body from the bytes of their rows."""
    drawn = (
        _primitives(kind, np.frombuffer(rows).reshape(-1, 14))
        for kind, rows in primitives
    )
    return static(entity, *drawn)


def _primitives(kind: int, rows: FloatArray) -> Any:
    """Draw geoms of one kind on one body, each a row of `_solids`."""
    sizes, positions, quaternions = rows[:, :3], rows[:, 3:6], xyzw(rows[:, 6:10])
    look: dict[str, Any] = {
        "quaternions": quaternions,
        "colors": (255.0 * rows[:, 10:]).round().astype(np.uint8),
        "fill_mode": "solid",
    }
    if kind == _GEOM.mjGEOM_BOX:
        return rr.Boxes3D(half_sizes=sizes, centers=positions, **look)
    if kind == _GEOM.mjGEOM_ELLIPSOID:
        return rr.Ellipsoids3D(half_sizes=sizes, centers=positions, **look)
    radii, half = sizes[:, 0], sizes[:, 1]
    if kind == _GEOM.mjGEOM_CYLINDER:
        return rr.Cylinders3D(
            lengths=2.0 * half, radii=radii, centers=positions, **look
        )
    # MuJoCo centres a capsule; Rerun's runs from its origin along +z.
    starts = positions - half[:, None] * _axes(quaternions)
    return rr.Capsules3D(lengths=2.0 * half, radii=radii, translations=starts, **look)


def _axes(quaternions: FloatArray) -> FloatArray:
    """The z axes that quaternions (N, 4), scalar last, turn to, (N, 3)."""
    return Rotation.from_quat(quaternions).apply([0.0, 0.0, 1.0])


def _mesh(model: mujoco.MjModel, geom: int, entity: str, row: FloatArray) -> Chunk:
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    return static(
        entity,
        rr.Mesh3D(
            vertex_positions=model.mesh_vert[first : first + count],
            triangle_indices=model.mesh_face[face : face + n_faces],
            albedo_factor=row[10:],
        ),
        rr.Transform3D(
            translation=row[3:6], quaternion=rr.Quaternion(xyzw=xyzw(row[6:10]))
        ),
    )


def _colours(model: mujoco.MjModel) -> FloatArray:
    """Colour of every geom, red, green, blue, opacity in [0, 1], (ngeom, 4)."""
    materials = model.geom_matid
    painted = materials >= 0
    colours: FloatArray = np.array(model.geom_rgba, dtype=np.float64)
    colours[painted] = model.mat_rgba[materials[painted]]
    textured = np.zeros(model.ngeom, dtype=bool)
    textured[painted] = np.any(model.mat_texid[materials[painted]] >= 0, axis=1)
    colours[textured] = _TEXTURED
    return colours


def xyzw(quaternion: FloatArray) -> FloatArray:
    """MuJoCo's scalar-first quaternions (..., 4) in Rerun's order."""
    return quaternion[..., [1, 2, 3, 0]]
