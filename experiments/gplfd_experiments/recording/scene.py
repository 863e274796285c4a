"""Robot and door: MuJoCo's visual geoms drawn once, and moved with their bodies.

Bodies that are fixed to each other are one moving body, or the world, which is body 0.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import ArrayLike
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording.colours import BACKGROUND
from gplfd_experiments.recording.stream import frames, moving, static

ROOT: Final = "/world/scene"
"""Entity above all bodies; the axes are MuJoCo's world axes, z up."""

Transform = tuple[FloatArray, FloatArray]
"""Position (3,) [m] and quaternion (w, x, y, z)."""
Eye = tuple[ArrayLike, ArrayLike, ArrayLike]
"""Position, target and up direction of a 3-D view [m]."""

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


def drawn_scene(model: mujoco.MjModel) -> Iterator[Chunk]:
    """Return every visible geom: a chunk per moving body, and one per mesh.

    Spheres become ellipsoids and planes thin boxes: a body has one archetype of a sort.
    """
    kinds, sizes = np.array(model.geom_type), np.array(model.geom_size)
    places, quaternions = np.array(model.geom_pos), np.array(model.geom_quat)
    for geom, body in enumerate(model.geom_bodyid.tolist()):
        if model.body_weldid[body] != body:
            places[geom], quaternions[geom] = _product(
                _pose_on_carrier(model, body), (places[geom], quaternions[geom])
            )
    turns = quaternions[:, [1, 2, 3, 0]]
    axes = Rotation.from_quat(turns).apply([0.0, 0.0, 1.0])
    balls, planes = kinds == _GEOM.mjGEOM_SPHERE, kinds == _GEOM.mjGEOM_PLANE
    sizes[balls] = sizes[balls, :1]
    # A size of 0 means infinite.
    sides = np.where(sizes[planes] == 0.0, _PLANE_HALF_SIZE, sizes[planes])
    sizes[planes] = np.minimum(sides, _PLANE_HALF_SIZE)
    sizes[planes, 2] = _PLANE_HALF_THICKNESS
    places[planes] -= _PLANE_HALF_THICKNESS * axes[planes]
    kinds[balls], kinds[planes] = _GEOM.mjGEOM_ELLIPSOID, _GEOM.mjGEOM_BOX
    # MuJoCo centres a capsule; Rerun's runs from its origin along +z.
    capsules = kinds == _GEOM.mjGEOM_CAPSULE
    places[capsules] -= sizes[capsules, 1, None] * axes[capsules]
    colours = _colours(model)

    yield static(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP)
    for body, visible in visual_geoms(model).items():
        entity, shapes, geoms = entity_of_body(model, body), [], np.array(visible)
        for kind, (archetype, position) in _PRIMITIVES.items():
            rows = geoms[kinds[geoms] == kind]
            if not rows.size:
                continue
            size: dict[str, Any] = {"half_sizes": sizes[rows]}
            if kind in (_GEOM.mjGEOM_CYLINDER, _GEOM.mjGEOM_CAPSULE):
                size = {"lengths": 2.0 * sizes[rows, 1], "radii": sizes[rows, 0]}
            shape = archetype(
                quaternions=turns[rows],
                colors=(255.0 * colours[rows]).round().astype(np.uint8),
                fill_mode="solid",
                **{position: places[rows]},
                **size,
            )
            shapes.append(shape)
        if shapes:  # not if all are meshes
            yield static(entity, *shapes)
        for geom in geoms[kinds[geoms] == _GEOM.mjGEOM_MESH].tolist():
            mesh = int(model.geom_dataid[geom])
            first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
            face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
            solid = rr.Mesh3D(
                vertex_positions=model.mesh_vert[first : first + count],
                triangle_indices=model.mesh_face[face : face + n_faces],
                albedo_factor=colours[geom],
            )
            turn = rr.Quaternion(xyzw=turns[geom])
            place = rr.Transform3D(translation=places[geom], quaternion=turn)
            yield static(f"{entity}/mesh_{geom}", solid, place)


def moved_scene(model: mujoco.MjModel, log: EpisodeLog) -> list[Chunk]:
    """Return the poses of all moving bodies, by forward kinematics of ``qpos``."""
    poses = [(data.xpos.copy(), data.xquat.copy()) for data in kinematics(model, log)]
    positions, quaternions = map(np.array, zip(*poses, strict=True))
    turns = quaternions[:, :, [1, 2, 3, 0]]
    return [
        moving(
            entity_of_body(model, body),
            log.times[frames(log)],
            rr.Transform3D.columns(
                translation=positions[:, body], quaternion=turns[:, body]
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


def visual_geoms(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Return the ids of the visible geoms by the moving body that carries them."""
    geoms: dict[int, list[int]] = {}
    seen = (model.geom_group <= _LARGEST_VISUAL_GROUP) & (_colours(model)[:, 3] > 0.0)
    for geom in np.flatnonzero(seen).tolist():
        carrier = int(model.body_weldid[model.geom_bodyid[geom]])
        geoms.setdefault(carrier, []).append(geom)
    return geoms


def entity_of_body(model: mujoco.MjModel, body: int) -> str:
    """Return the path of the entity of a moving body, whose transform is its pose."""
    return f"{ROOT}/{model.body(body).name or f'body_{body}'}"


def task_frame(model: mujoco.MjModel) -> tuple[FloatArray, Rotation]:
    """Origin (3,) [m] and rotation of the task frame in the world."""
    site = model.site("task_frame").id
    position, quaternion = _product(
        _pose_on_carrier(model, int(model.site_bodyid[site])),
        (model.site_pos[site], model.site_quat[site]),
    )
    return position, Rotation.from_quat(quaternion, scalar_first=True)


def _pose_on_carrier(model: mujoco.MjModel, body: int) -> Transform:
    """Pose of a body on the moving body that carries it."""
    pose = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    carrier = int(model.body_weldid[body])
    while body != carrier:
        pose = _product((model.body_pos[body], model.body_quat[body]), pose)
        body = int(model.body_parentid[body])
    return pose


def _product(outer: Transform, inner: Transform) -> Transform:
    position, quaternion = np.empty(3), np.empty(4)
    mujoco.mju_mulPose(position, quaternion, *outer, *inner)
    return position, quaternion


def _colours(model: mujoco.MjModel) -> FloatArray:
    """Colour of every geom, red, green, blue, opacity in [0, 1], (ngeom, 4)."""
    painted = np.flatnonzero(model.geom_matid >= 0)
    materials = model.geom_matid[painted]
    colours: FloatArray = np.array(model.geom_rgba, dtype=np.float64)
    colours[painted] = model.mat_rgba[materials]
    colours[painted[np.any(model.mat_texid[materials] >= 0, axis=1)]] = _TEXTURED
    return colours


def view_3d(
    name: str, origin: str, contents: Sequence[str], eye: Eye
) -> rrb.Spatial3DView:
    """Return a 3-D view of entities, given by queries, in the frame of ``origin``."""
    place, target, up = eye
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=contents,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(position=place, look_target=target, eye_up=up),
    )
