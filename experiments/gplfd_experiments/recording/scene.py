"""Robot and door: MuJoCo's visual geoms drawn once, and moved with their bodies.

Bodies that are fixed to each other move together. Their geoms are on the entity of the
moving body that carries them, or of the world, which is body 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final, NamedTuple

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording.stream import frames, moving, static

ROOT: Final = "/world/scene"
"""Entity above all bodies; the axes are MuJoCo's world axes, z up."""

Pose = tuple[FloatArray, FloatArray]
"""Position (3,) [m] and quaternion (w, x, y, z)."""

_GEOM: Final = mujoco.mjtGeom
# Rerun's names of MuJoCo's primitives and of their positions.
_PRIMITIVES: Final[Mapping[int, tuple[Any, str]]] = {
    _GEOM.mjGEOM_BOX: (rr.Boxes3D, "centers"),
    _GEOM.mjGEOM_ELLIPSOID: (rr.Ellipsoids3D, "centers"),
    _GEOM.mjGEOM_CYLINDER: (rr.Cylinders3D, "centers"),
    _GEOM.mjGEOM_CAPSULE: (rr.Capsules3D, "translations"),
}
# MuJoCo's convention: geoms of groups 0 to 2 are drawn, 3 and above collide.
_LARGEST_VISUAL_GROUP: Final = 2
_PLANE_HALF_SIZE, _PLANE_HALF_THICKNESS = 3.0, 0.005
# Colour of geoms with a texture, which only floors have.
_TEXTURED: Final = (0.42, 0.43, 0.45, 1.0)
# Body without a link of the same name in TIAGo's description: other links draw it.
_COVERED: Final = "head_link"


class LinkMesh(NamedTuple):
    """A mesh of the manufacturer in the frame of one of our bodies."""

    name: str
    """Link in the manufacturer's description, with the number of the mesh."""
    vertices: FloatArray
    """Vertices in the body's frame [m], (3 F, 3), not shared between faces."""
    normals: FloatArray
    """Normal of the face at each vertex, (3 F, 3)."""
    colour: tuple[int, ...]
    """Red, green, blue, opacity, 0 to 255."""


BodyMeshes = Mapping[str, Sequence[LinkMesh]]
"""Meshes by the name of the body that carries them, in place of its geoms."""


def drawn_scene(
    model: mujoco.MjModel, looks: BodyMeshes | None = None
) -> Iterator[Chunk]:
    """Return every visible geom: a chunk per moving body, and one per mesh."""
    looks = looks or {}
    kinds, rows = _solids(model)
    yield static(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for body, geoms in visual_geoms(model, looks).items():
        entity, shapes = entity_of_body(model, body), []
        for kind, (archetype, places) in _PRIMITIVES.items():
            solids = rows[[geom for geom in geoms if kinds[geom] == kind]]
            if not solids.size:
                continue
            sizes, positions, turns, tints = np.split(solids, [3, 6, 10], axis=1)
            turns = _xyzw(turns)
            size: dict[str, Any] = {"half_sizes": sizes}
            if kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
                size = {"lengths": 2.0 * sizes[:, 1], "radii": sizes[:, 0]}
            if kind == _GEOM.mjGEOM_CAPSULE:
                # MuJoCo centres a capsule; Rerun's runs from its origin along +z.
                positions = positions - sizes[:, 1, None] * _axes(turns)
            shape = archetype(
                quaternions=turns,
                colors=(255.0 * tints).round().astype(np.uint8),
                fill_mode="solid",
                **{places: positions},
                **size,
            )
            shapes.append(shape)
        if shapes:  # not if all are meshes
            yield static(entity, *shapes)
        for geom in geoms:
            if kinds[geom] != _GEOM.mjGEOM_MESH:
                continue
            mesh, row = int(model.geom_dataid[geom]), rows[geom]
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
            shape = rr.Mesh3D(
                vertex_positions=model.mesh_vert[first : first + count],
                triangle_indices=model.mesh_face[face : face + n_faces],
                albedo_factor=row[10:],
            )
            turn = rr.Quaternion(xyzw=_xyzw(row[6:10]))
            place = rr.Transform3D(translation=row[3:6], quaternion=turn)
            yield static(f"{entity}/mesh_{geom}", shape, place)
    for name, meshes in looks.items():
        body = model.body(name).id
        position, quaternion = _pose_on_carrier(model, body)
        rotation = Rotation.from_quat(quaternion, scalar_first=True)
        entity = entity_of_body(model, int(model.body_weldid[body]))
        for link in meshes:
            shape = rr.Mesh3D(
                vertex_positions=rotation.apply(link.vertices) + position,
                vertex_normals=rotation.apply(link.normals),
                albedo_factor=link.colour,
            )
            yield static(f"{entity}/tiago_{link.name}", shape)


def moved_scene(model: mujoco.MjModel, log: EpisodeLog) -> list[Chunk]:
    """Return the poses of all moving bodies, by forward kinematics of ``qpos``."""
    poses = [(data.xpos.copy(), data.xquat.copy()) for data in kinematics(model, log)]
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    return [
        moving(
            entity_of_body(model, body),
            log.times[frames(log)],
            rr.Transform3D.columns(
                translation=positions[:, body], quaternion=_xyzw(quaternions[:, body])
            ),
        )
        for body in visual_geoms(model)
        if body != 0
    ]


def kinematics(model: mujoco.MjModel, log: EpisodeLog) -> Iterator[mujoco.MjData]:
    """Yield the state of a scene at every frame; always the same object."""
    data = mujoco.MjData(model)
    for row in frames(log):
        data.qpos[:] = log.motion.qpos[row]
        mujoco.mj_kinematics(model, data)
        yield data


def visual_geoms(
    model: mujoco.MjModel, looks: BodyMeshes | None = None
) -> dict[int, list[int]]:
    """Return the ids of the visible geoms by the moving body that carries them.

    Bodies that ``looks`` draw have none.
    """
    covered = {*looks, _COVERED} if looks else set()
    geoms: dict[int, list[int]] = {}
    seen = (model.geom_group <= _LARGEST_VISUAL_GROUP) & (_colours(model)[:, 3] > 0.0)
    for geom in np.flatnonzero(seen).tolist():
        body = int(model.geom_bodyid[geom])
        if model.body(body).name not in covered:
            geoms.setdefault(int(model.body_weldid[body]), []).append(geom)
    return geoms


def entity_of_body(model: mujoco.MjModel, body: int) -> str:
    """Return the path of a body's entity, below that of its moving body.

    The transform of a moving body's entity is its pose in the world.
    """
    name = model.body(body).name or f"body_{body}"
    carrier = int(model.body_weldid[body])
    above = ROOT if carrier in (0, body) else entity_of_body(model, carrier)
    return f"{above}/{name}"


def task_frame(model: mujoco.MjModel) -> tuple[FloatArray, Rotation]:
    """Origin (3,) [m] and rotation of the task frame in the world."""
    site = model.site("task_frame").id
    position, quaternion = _product(
        _pose_on_carrier(model, int(model.site_bodyid[site])),
        (model.site_pos[site], model.site_quat[site]),
    )
    return position, Rotation.from_quat(quaternion, scalar_first=True)


def _pose_on_carrier(model: mujoco.MjModel, body: int) -> Pose:
    """Pose of a body on the moving body that carries it."""
    pose = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    carrier = int(model.body_weldid[body])
    while body != carrier:
        pose = _product((model.body_pos[body], model.body_quat[body]), pose)
        body = int(model.body_parentid[body])
    return pose


def _product(outer: Pose, inner: Pose) -> Pose:
    position, quaternion = np.empty(3), np.empty(4)
    mujoco.mju_mulPose(position, quaternion, *outer, *inner)
    return position, quaternion


def _solids(model: mujoco.MjModel) -> tuple[list[int], FloatArray]:
    """Kind (ngeom) and size, pose on the carrier, colour (ngeom, 14) of every geom.

    Spheres become ellipsoids and planes become thin boxes below them, so that a body
    has at most one archetype of each sort.
    """
    kinds, sizes = np.array(model.geom_type), np.array(model.geom_size)
    positions, quaternions = np.array(model.geom_pos), np.array(model.geom_quat)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        if model.body_weldid[body] != body:
            positions[geom], quaternions[geom] = _product(
                _pose_on_carrier(model, body), (positions[geom], quaternions[geom])
            )
    balls, planes = kinds == _GEOM.mjGEOM_SPHERE, kinds == _GEOM.mjGEOM_PLANE
    sizes[balls] = sizes[balls, :1]
    if planes.any():
        # A size of 0 means infinite.
        sides = np.where(sizes[planes] == 0.0, _PLANE_HALF_SIZE, sizes[planes])
        sizes[planes] = np.minimum(sides, _PLANE_HALF_SIZE)
        sizes[planes, 2] = _PLANE_HALF_THICKNESS
        normals = _axes(_xyzw(quaternions[planes]))
        positions[planes] -= _PLANE_HALF_THICKNESS * normals
    kinds[balls], kinds[planes] = _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_BOX
    rows = np.hstack([sizes, positions, quaternions, _colours(model)])
    return kinds.tolist(), rows


def _colours(model: mujoco.MjModel) -> FloatArray:
    """Colour of every geom, red, green, blue, opacity in [0, 1], (ngeom, 4)."""
    painted = np.flatnonzero(model.geom_matid >= 0)
    materials = model.geom_matid[painted]
    colours: FloatArray = np.array(model.geom_rgba, dtype=np.float64)
    colours[painted] = model.mat_rgba[materials]
    colours[painted[np.any(model.mat_texid[materials] >= 0, axis=1)]] = _TEXTURED
    return colours


def _axes(quaternions: FloatArray) -> FloatArray:
    """Return the rotated z axes, (N, 3), of quaternions (N, 4), scalar last."""
    return Rotation.from_quat(quaternions).apply([0.0, 0.0, 1.0])


def _xyzw(quaternion: FloatArray) -> FloatArray:
    """MuJoCo's scalar-first quaternions (..., 4) in Rerun's order."""
    return quaternion[..., [1, 2, 3, 0]]
