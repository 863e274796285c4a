"""Robot and door: MuJoCo's visual geoms drawn once, and moved with their bodies.

Bodies that are fixed to each other move together. Their geoms are on the entity of the
moving body that carries them, or of the world, which is body 0.
"""

from collections.abc import Iterator, Mapping
from typing import Any, Final

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

TASK_SITE: Final = "task_frame"
"""Site of the model that carries the task frame."""

Pose = tuple[FloatArray, FloatArray]
"""Position (3,) [m] and quaternion (w, x, y, z)."""

_GEOM: Final = mujoco.mjtGeom
_PRIMITIVES: Final[Mapping[int, tuple[Any, str]]] = {
    _GEOM.mjGEOM_BOX: (rr.Boxes3D, "centers"),
    _GEOM.mjGEOM_ELLIPSOID: (rr.Ellipsoids3D, "centers"),
    _GEOM.mjGEOM_CYLINDER: (rr.Cylinders3D, "centers"),
    _GEOM.mjGEOM_CAPSULE: (rr.Capsules3D, "translations"),
}
"""Rerun's names of MuJoCo's primitives and of their positions."""
_LARGEST_VISUAL_GROUP: Final = 2
"""MuJoCo's convention: geoms of groups 0 to 2 are drawn, 3 and above collide."""

_PLANE_HALF_SIZE: Final = 3.0
_PLANE_HALF_THICKNESS: Final = 0.005
_TEXTURED: Final = (0.42, 0.43, 0.45, 1.0)
"""Colour of geoms with a texture, which only floors have."""


def drawn_scene(model: mujoco.MjModel) -> list[Chunk]:
    """Return every visible geom: a chunk per moving body, and one per mesh."""
    kinds, rows = _solids(model)
    chunks = [static(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)]
    for body, geoms in visual_geoms(model).items():
        entity = entity_of_body(model, body)
        primitives: dict[int, list[FloatArray]] = {}
        for geom in geoms:
            if kinds[geom] in _PRIMITIVES:
                primitives.setdefault(kinds[geom], []).append(rows[geom])
            elif kinds[geom] == _GEOM.mjGEOM_MESH:
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
                chunks.append(static(f"{entity}/mesh_{geom}", shape, place))
        shapes = [_shape(kind, np.array(solids)) for kind, solids in primitives.items()]
        chunks.append(static(entity, *shapes))
    return chunks


def moved_scene(model: mujoco.MjModel, log: EpisodeLog) -> list[Chunk]:
    """Return the poses of all moving bodies, by forward kinematics of ``qpos``."""
    bodies = [body for body in visual_geoms(model) if body != 0]
    rows = frames(log)
    positions = np.empty((rows.size, model.nbody, 3))
    quaternions = np.empty((rows.size, model.nbody, 4))
    for frame, data in enumerate(kinematics(model, log)):
        positions[frame], quaternions[frame] = data.xpos, data.xquat
    return [
        moving(
            entity_of_body(model, body),
            log.times[rows],
            rr.Transform3D.columns(
                translation=positions[:, body], quaternion=_xyzw(quaternions[:, body])
            ),
        )
        for body in bodies
    ]


def kinematics(model: mujoco.MjModel, log: EpisodeLog) -> Iterator[mujoco.MjData]:
    """Yield the state of a scene at every frame; always the same object."""
    data = mujoco.MjData(model)
    for row in frames(log):
        data.qpos[:] = log.motion.qpos[row]
        mujoco.mj_kinematics(model, data)
        yield data


def visual_geoms(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Return the ids of the visible geoms by the moving body that carries them."""
    seen = (model.geom_group <= _LARGEST_VISUAL_GROUP) & (_colours(model)[:, 3] > 0.0)
    carriers = model.body_weldid[model.geom_bodyid].tolist()
    geoms: dict[int, list[int]] = {}
    for geom in np.flatnonzero(seen).tolist():
        geoms.setdefault(carriers[geom], []).append(geom)
    return geoms


def entity_of_body(model: mujoco.MjModel, body: int) -> str:
    """Return the path of a body's entity, below that of its moving body.

    The transform of a moving body's entity is its pose in the world.
    """
    name = model.body(body).name or f"body_{body}"
    carrier = int(model.body_weldid[body])
    if carrier in (0, body):
        return f"{ROOT}/{name}"
    return f"{entity_of_body(model, carrier)}/{name}"


def task_frame(model: mujoco.MjModel) -> tuple[FloatArray, Rotation]:
    """Origin (3,) [m] and rotation of the task frame in the world."""
    site = model.site(TASK_SITE).id
    position, quaternion = _product(
        pose_on_carrier(model, int(model.site_bodyid[site])),
        (model.site_pos[site], model.site_quat[site]),
    )
    return position, Rotation.from_quat(quaternion, scalar_first=True)


def pose_on_carrier(model: mujoco.MjModel, body: int) -> Pose:
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
    fixed = np.flatnonzero(model.body_weldid != np.arange(model.nbody)).tolist()
    poses = {body: pose_on_carrier(model, body) for body in fixed}
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        if body in poses:
            positions[geom], quaternions[geom] = _product(
                poses[body], (positions[geom], quaternions[geom])
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


def _shape(kind: int, solids: FloatArray) -> Any:
    """Draw the primitives of one kind of one body: rows of `_solids`, (N, 14)."""
    sizes, positions = solids[:, :3], solids[:, 3:6]
    quaternions = _xyzw(solids[:, 6:10])
    size: dict[str, Any] = {"half_sizes": sizes}
    if kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
        size = {"lengths": 2.0 * sizes[:, 1], "radii": sizes[:, 0]}
    if kind == _GEOM.mjGEOM_CAPSULE:
        # MuJoCo centres a capsule; Rerun's runs from its origin along +z.
        positions = positions - sizes[:, 1, None] * _axes(quaternions)
    archetype, places = _PRIMITIVES[kind]
    return archetype(
        quaternions=quaternions,
        colors=(255.0 * solids[:, 10:]).round().astype(np.uint8),
        fill_mode="solid",
        **{places: positions},
        **size,
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


def _axes(quaternions: FloatArray) -> FloatArray:
    """Return the rotated z axes, (N, 3), of quaternions (N, 4), scalar last."""
    return Rotation.from_quat(quaternions).apply([0.0, 0.0, 1.0])


def _xyzw(quaternion: FloatArray) -> FloatArray:
    """MuJoCo's scalar-first quaternions (..., 4) in Rerun's order."""
    return quaternion[..., [1, 2, 3, 0]]
