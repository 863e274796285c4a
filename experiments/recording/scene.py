"""Robot and door: MuJoCo's visual geoms as Rerun primitives under their bodies."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from experiments.episode_log import EpisodeLog
from experiments.recording.stream import seconds

FloatArray = NDArray[np.float64]

ROOT: Final = "/world/scene"
"""Entity above all bodies; the axes are MuJoCo's world axes, z up."""

_GEOM: Final = mujoco.mjtGeom
_LARGEST_VISUAL_GROUP: Final = 2
"""MuJoCo's convention: geoms of groups 0 to 2 are drawn, 3 and above collide."""

_FRAMES_PER_SECOND: Final = 50.0
_STILL: Final = 1e-9
"""A body that moves less than this in the whole episode [m, 1] is logged once."""

_PLANE_HALF_SIZE: Final = 3.0
_PLANE_HALF_THICKNESS: Final = 0.005
_TEXTURED: Final = (0.42, 0.43, 0.45, 1.0)
"""Colour of geoms whose material has a texture; only floors do."""


def log_scene(
    stream: rr.RecordingStream, log: EpisodeLog, model: mujoco.MjModel
) -> None:
    """Log every visual geom once and the bodies' motion as columns.

    Args:
        stream: Recording to write to.
        log: Episode; its ``qpos`` is turned into body poses by forward kinematics.
        model: The model that the episode ran in.
    """
    stream.log(ROOT, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
    drawn = visual_geoms(model)
    for body, geoms in drawn.items():
        _log_geoms(stream, entity_of_body(model, body), model, geoms)
    _log_motion(stream, log, model, list(drawn))


def visual_geoms(model: mujoco.MjModel) -> dict[int, list[int]]:
    """Ids of the visible geoms by their body's id."""
    geoms: dict[int, list[int]] = {}
    for geom in range(model.ngeom):
        seen = model.geom_group[geom] <= _LARGEST_VISUAL_GROUP
        if seen and _colour(model, geom)[3] > 0.0:
            geoms.setdefault(int(model.geom_bodyid[geom]), []).append(geom)
    return geoms


def entity_of_body(model: mujoco.MjModel, body: int) -> str:
    """Path of a body's entity; its transform is the body's pose in the world."""
    return f"{ROOT}/{model.body(body).name or f'body_{body}'}"


def body_poses(
    model: mujoco.MjModel, qpos: FloatArray, bodies: list[int]
) -> tuple[FloatArray, FloatArray]:
    """World poses of bodies: (F, B, 3) [m] and quaternions (w, x, y, z) (F, B, 4)."""
    data = mujoco.MjData(model)
    positions = np.empty((len(qpos), len(bodies), 3))
    quaternions = np.empty((len(qpos), len(bodies), 4))
    for frame, configuration in enumerate(qpos):
        data.qpos[:] = configuration
        mujoco.mj_kinematics(model, data)
        positions[frame] = data.xpos[bodies]
        quaternions[frame] = data.xquat[bodies]
    return positions, quaternions


def _log_motion(
    stream: rr.RecordingStream,
    log: EpisodeLog,
    model: mujoco.MjModel,
    bodies: list[int],
) -> None:
    every = max(1, round(1.0 / (_FRAMES_PER_SECOND * log.dt)))
    # The last state is always a frame.
    frames = np.unique(
        np.append(np.arange(0, log.times.size, every), log.times.size - 1)
    )
    positions, quaternions = body_poses(model, log.qpos[frames], bodies)
    index = seconds(log.times[frames])
    for number, body in enumerate(bodies):
        position, quaternion = positions[:, number], quaternions[:, number]
        entity = entity_of_body(model, body)
        moved = max(np.ptp(position, axis=0).max(), np.ptp(quaternion, axis=0).max())
        if moved < _STILL:
            pose = rr.Transform3D(
                translation=position[0],
                quaternion=rr.Quaternion(xyzw=_xyzw(quaternion[0])),
            )
            stream.log(entity, pose, static=True)
        else:
            stream.send_columns(
                entity,
                index,
                rr.Transform3D.columns(
                    translation=position, quaternion=_xyzw(quaternion)
                ),
            )


def _log_geoms(
    stream: rr.RecordingStream, entity: str, model: mujoco.MjModel, geoms: list[int]
) -> None:
    """Log the geoms of one body, one entity per kind of primitive."""
    by_kind: dict[int, list[int]] = {}
    for geom in geoms:
        by_kind.setdefault(int(model.geom_type[geom]), []).append(geom)
    for kind, members in by_kind.items():
        if kind in _PRIMITIVES:
            name, primitive = _PRIMITIVES[kind]
            stream.log(f"{entity}/{name}", primitive(model, members), static=True)
        elif kind == _GEOM.mjGEOM_MESH:
            for geom in members:
                path = f"{entity}/mesh_{geom}"
                stream.log(path, *_mesh(model, geom), static=True)


def _placement(model: mujoco.MjModel, geoms: list[int]) -> dict[str, Any]:
    colours = [_colour(model, geom) for geom in geoms]
    return {
        "quaternions": _xyzw(model.geom_quat[geoms]),
        "colors": (255.0 * np.array(colours)).round().astype(np.uint8),
        "fill_mode": "solid",
    }


def _boxes(model: mujoco.MjModel, geoms: list[int]) -> rr.Boxes3D:
    return rr.Boxes3D(
        half_sizes=model.geom_size[geoms],
        centers=model.geom_pos[geoms],
        **_placement(model, geoms),
    )


def _ellipsoids(model: mujoco.MjModel, geoms: list[int]) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(
        half_sizes=model.geom_size[geoms],
        centers=model.geom_pos[geoms],
        **_placement(model, geoms),
    )


def _spheres(model: mujoco.MjModel, geoms: list[int]) -> rr.Ellipsoids3D:
    return rr.Ellipsoids3D(
        radii=model.geom_size[geoms, 0],
        centers=model.geom_pos[geoms],
        **_placement(model, geoms),
    )


def _cylinders(model: mujoco.MjModel, geoms: list[int]) -> rr.Cylinders3D:
    return rr.Cylinders3D(
        lengths=2.0 * model.geom_size[geoms, 1],
        radii=model.geom_size[geoms, 0],
        centers=model.geom_pos[geoms],
        **_placement(model, geoms),
    )


def _capsules(model: mujoco.MjModel, geoms: list[int]) -> rr.Capsules3D:
    # MuJoCo centres a capsule; Rerun's runs from its origin along +z.
    half = model.geom_size[geoms, 1]
    along = Rotation.from_quat(_xyzw(model.geom_quat[geoms])).apply([0.0, 0.0, 1.0])
    return rr.Capsules3D(
        lengths=2.0 * half,
        radii=model.geom_size[geoms, 0],
        translations=model.geom_pos[geoms] - half[:, None] * along,
        **_placement(model, geoms),
    )


def _planes(model: mujoco.MjModel, geoms: list[int]) -> rr.Boxes3D:
    # A thin box below the plane; a size of 0 means infinite.
    half_sizes = np.array(model.geom_size[geoms])
    half_sizes[half_sizes == 0.0] = _PLANE_HALF_SIZE
    half_sizes = np.minimum(half_sizes, _PLANE_HALF_SIZE)
    half_sizes[:, 2] = _PLANE_HALF_THICKNESS
    normal = Rotation.from_quat(_xyzw(model.geom_quat[geoms])).apply([0.0, 0.0, 1.0])
    return rr.Boxes3D(
        half_sizes=half_sizes,
        centers=model.geom_pos[geoms] - _PLANE_HALF_THICKNESS * normal,
        **_placement(model, geoms),
    )


def _mesh(model: mujoco.MjModel, geom: int) -> Iterator[Any]:
    mesh = int(model.geom_dataid[geom])
    first, count = model.mesh_vertadr[mesh], model.mesh_vertnum[mesh]
    face, n_faces = model.mesh_faceadr[mesh], model.mesh_facenum[mesh]
    yield rr.Mesh3D(
        vertex_positions=model.mesh_vert[first : first + count],
        triangle_indices=model.mesh_face[face : face + n_faces],
        albedo_factor=_colour(model, geom),
    )
    yield rr.Transform3D(
        translation=model.geom_pos[geom],
        quaternion=rr.Quaternion(xyzw=_xyzw(model.geom_quat[geom])),
    )


def _colour(model: mujoco.MjModel, geom: int) -> tuple[float, ...]:
    material = int(model.geom_matid[geom])
    if material < 0:
        return tuple(map(float, model.geom_rgba[geom]))
    if np.any(model.mat_texid[material] >= 0):
        return _TEXTURED
    return tuple(map(float, model.mat_rgba[material]))


def _xyzw(quaternion: FloatArray) -> FloatArray:
    """MuJoCo's scalar-first quaternions (..., 4) in Rerun's order."""
    return np.roll(quaternion, -1, axis=-1)


_PRIMITIVES: Final[
    dict[int, tuple[str, Callable[[mujoco.MjModel, list[int]], Any]]]
] = {
    int(_GEOM.mjGEOM_PLANE): ("planes", _planes),
    int(_GEOM.mjGEOM_BOX): ("boxes", _boxes),
    int(_GEOM.mjGEOM_SPHERE): ("spheres", _spheres),
    int(_GEOM.mjGEOM_ELLIPSOID): ("ellipsoids", _ellipsoids),
    int(_GEOM.mjGEOM_CYLINDER): ("cylinders", _cylinders),
    int(_GEOM.mjGEOM_CAPSULE): ("capsules", _capsules),
}
"""Name of the entity and the function that makes it, by MuJoCo's type of geom."""
