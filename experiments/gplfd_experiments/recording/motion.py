"""Demonstrations, policy (a tube of ±1.96 σ), via-points and force at the door."""

import functools
from collections.abc import Iterator, Sequence
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from rerun.chunk import Chunk
from scipy.spatial.transform import Rotation

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.motion import end_angle, links_of
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, panels, scene
from gplfd_experiments.recording.stream import frames, moving, static
from gplfd_policies.demonstrations.demonstration import Demonstration

ROOT: Final = "/world/task"
"""Entity whose transform is the task frame: closed handle, x pull, y up."""
PLAN: Final = f"{ROOT}/plan"  # Entity that only the view from above shows.
VIEW: Final = f"{ROOT}/view"
"""Entity of the frame of the views: the closed handle, z up."""
TRAIL: Final = f"{ROOT}/hand/trail"  # Entity of the path of the hand so far.
STIFFNESS: Final = f"{ROOT}/hand/stiffness"
"""Entity of the ball that shows the stiffness of the hand."""

Float32Array = NDArray[np.float32]  # As exact as the viewer draws.
N_RINGS, N_SIDES = 32, 12  # Cross-sections along the path, and corners of each.

_SLOW: Final = 0.15
"""Share of the path's largest speed below which its direction is not used."""
_THINNEST: Final = 0.002  # Half-width [m] below which a tube would not be seen.
# Axes of the views, x (away from the robot), y and z as columns, in the task frame.
_VIEW_AXES: Final = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
_METRES_PER_NEWTON: Final = 0.01  # Length of the force arrow: 10 N are 10 cm.
_TRUE_ARC_DEG: Final = 75.0
# Half the widths of lines [m]; the trail is thicker than the lines on it.
_LINE, _DOT, _TRAIL, _BALL = 0.003, 0.006, 0.009, 0.03
# Position of the ball of the stiffness relative to the hand, task frame [m].
_ABOVE_HAND: Final = (0.0, 0.16, 0.0)
_OPACITY_BEFORE, _OPACITY_ADAPTED = 48, 90
# Travelled distance [m] between points of the trail and between shown via-points.
_KNOT_SPACING, _DOT_SPACING = 0.01, 0.005


def door_frame(
    model: mujoco.MjModel, door: DoorConfig, demonstrations: Sequence[Demonstration]
) -> list[Chunk]:
    """Return static entities in the task frame, and the task frame itself."""
    side, angles = door.hinge_sign, np.radians(np.linspace(0.0, _TRUE_ARC_DEG, 76))
    if door.motion == "hinged":
        # The leaf turns about the hinge.
        path = handle_pose_on_arc(door.hand_radius, angles)[:, :3]
        path = path * [door.swing_sign, 1.0, side]
        hinge = -side * door.hand_radius
        leaf = [[[0.0, 0.0, 0.0], [0.0, 0.0, side * door.radius]]]
    else:
        # The leaf moves with the handle.
        path = DoorGeometry.of(door).hand_poses(angles.clip(max=end_angle(door)))[:, :3]
        width = door.fold_distance if door.motion == "folding" else door.radius
        far = [0.0, 0.0, -side * width]
        if door.level:
            far = list(links_of(door)[-1].anchor)
        leaf, hinge = [[far, [0.0, 0.0, 0.0]]], 0.0
    position, rotation = scene.task_frame(model)
    turn = rr.Quaternion(xyzw=rotation.as_quat())
    strips = [demonstration.poses[:, :3] for demonstration in demonstrations]
    looks: dict[str, Any] = {
        ROOT: rr.Transform3D(translation=position, quaternion=turn),
        VIEW: rr.Transform3D(mat3x3=_VIEW_AXES),
        f"{ROOT}/demonstrations": rr.LineStrips3D(
            strips, colors=colours.DEMONSTRATION, radii=_LINE / 2
        ),
        f"{ROOT}/true_arc": rr.LineStrips3D([path], colors=colours.TRUTH, radii=_LINE),
        PLAN: rr.Transform3D(translation=[0.0, 0.0, hinge]),
        f"{PLAN}/closed": rr.LineStrips3D(leaf, colors=colours.MARK, radii=_LINE / 2),
        f"{PLAN}/leaf": rr.LineStrips3D(leaf, colors=colours.LEAF, radii=2.0 * _LINE),
        TRAIL: rr.LineStrips3D.from_fields(radii=_TRAIL),
        f"{ROOT}/hand/via_points": rr.Points3D.from_fields(
            colors=colours.HAND, radii=_DOT
        ),
        f"{ROOT}/hand/force": rr.Arrows3D.from_fields(colors=colours.FORCE, radii=_DOT),
    }
    return [static(entity, look) for entity, look in looks.items()]


def policy_motion(log: EpisodeLog) -> list[Chunk]:
    """Return the first forecast as a static tube, and all as a moving tube."""
    forecasts = log.forecasts
    if not forecasts.times.size:
        return []
    # Without uncertainty, the tube is a line.
    paths, stds = forecasts.mean[:, :, :3], np.nan_to_num(forecasts.std[:, :, :3])
    vertices, normals = tube_vertices(paths, stds)
    means, triangles = paths.astype(np.float32), tube_triangles()
    tubes = rr.Mesh3D.columns(
        vertex_positions=vertices.reshape(-1, 3), vertex_normals=normals.reshape(-1, 3)
    )
    # Without a stiffness the tube has the policy's colour.
    rows = np.searchsorted(log.times, forecasts.times).clip(max=log.times.size - 1)
    tints = panels.colour_of(panels.mean_stiffness(log)[rows], colours.ADAPTED)
    opacity = np.full((len(tints), 1), _OPACITY_ADAPTED, np.uint8)
    columns = [
        *tubes.partition(np.full(len(vertices), vertices.shape[1])),
        *rr.Mesh3D.columns(albedo_factor=np.hstack([tints, opacity])),
        *rr.LineStrips3D.columns(strips=means),
    ]
    first = rr.Mesh3D(
        vertex_positions=vertices[0],
        vertex_normals=normals[0],
        triangle_indices=triangles,
        albedo_factor=(*colours.BEFORE, _OPACITY_BEFORE),
    )
    mesh = rr.Mesh3D.from_fields(triangle_indices=triangles)
    line = rr.LineStrips3D.from_fields(colors=colours.ADAPTED, radii=_LINE)
    before = rr.LineStrips3D(means[:1], colors=colours.BEFORE, radii=_LINE)
    return [
        static(f"{ROOT}/policy_before", first, before),
        static(f"{ROOT}/policy_now", mesh, line),
        moving(f"{ROOT}/policy_now", forecasts.times, columns),
    ]


def hand_motion(log: EpisodeLog) -> Iterator[Chunk]:
    """Return the hand's path, its via-points, the force on it, and the leaf."""
    positions, rows = log.motion.ee_pose[:, :3], frames(log)
    vectors = _METRES_PER_NEWTON * log.forces.wrench[rows, :3]
    arrows = rr.Arrows3D.columns(origins=positions[rows], vectors=vectors)
    yield moving(f"{ROOT}/hand/force", log.times[rows], arrows)
    # Not with the handle, which may rotate in the leaf.
    leaf = DoorGeometry.of(log.config).hand_poses(log.opening.door_angle[rows])
    pose: dict[str, Any] = {"quaternion": Rotation.from_rotvec(leaf[:, 3:]).as_quat()}
    if log.config.motion != "hinged":
        pose["translation"] = leaf[:, :3]
    yield moving(f"{PLAN}/leaf", log.times[rows], rr.Transform3D.columns(**pose))
    # The trail has a strip per stretch.
    knots = _knots(log)
    ends = positions.astype(np.float32)
    strips = np.stack([ends[knots[:-1]], ends[knots[1:]]], axis=1)
    yield from _so_far(TRAIL, log, knots[1:], rr.LineStrips3D, strips=strips)
    # Only the first of coincident via-points.
    dots = _spaced(positions, np.flatnonzero(log.decisions.via_point), _DOT_SPACING)
    place = f"{ROOT}/hand/via_points"
    yield from _so_far(place, log, dots, rr.Points3D, positions=positions[dots])


def hand_stiffness(log: EpisodeLog) -> Iterator[Chunk]:
    """Return the colour of the hand's trail, and a ball that shows the stiffness."""
    stiffness, knots = panels.mean_stiffness(log), _knots(log)[1:]
    tints = panels.colour_of(stiffness[knots], colours.HAND)
    yield from _so_far(TRAIL, log, knots, rr.LineStrips3D, colors=tints)
    acts, rows = np.isfinite(stiffness), frames(log)
    if not acts.any():
        return
    values = stiffness[rows][acts[rows]]
    labels = [f"{value:.0f} N/m" for value in values]
    tints = panels.colour_of(values, colours.HAND)
    yield static(STIFFNESS, rr.Points3D.from_fields(radii=_BALL, show_labels=True))
    yield ball(STIFFNESS, log, acts, _ABOVE_HAND, colors=tints, labels=labels)


def ball(
    entity: str,
    log: EpisodeLog,
    acts: NDArray[np.bool_],
    above: tuple[float, float, float],
    **looks: Any,
) -> Chunk:
    """Return a ball above the hand [m] at the frames of the rows (T,) that have one."""
    rows = frames(log)
    visible = acts[rows]
    positions = log.motion.ee_pose[rows[visible], :3] + above
    columns = rr.Points3D.columns(positions=positions, **looks)
    return moving(entity, log.times[rows], columns.partition(visible.astype(int)))


def _so_far(
    entity: str,
    log: EpisodeLog,
    rows: NDArray[np.intp],
    archetype: Any,
    **values: NDArray[Any],
) -> Iterator[Chunk]:
    """Return what grows by one value at each of some rows (n,); values are (n, ...)."""
    counts = np.arange(1, rows.size + 1)
    if rows.size:
        [(name, array)] = values.items()
        so_far = {name: np.concatenate([array[:count] for count in counts])}
        columns = archetype.columns(**so_far).partition(counts)
        yield moving(entity, log.times[rows], columns)


def _knots(log: EpisodeLog) -> NDArray[np.intp]:
    """Return the rows of the ends of the trail's stretches."""
    return _spaced(log.motion.ee_pose[:, :3], np.arange(log.times.size), _KNOT_SPACING)


def _spaced(
    positions: FloatArray, rows: NDArray[np.intp], spacing: float
) -> NDArray[np.intp]:
    """Return rows about ``spacing`` [m] of travel apart, independent of later rows."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    stretch = np.floor(travelled[rows] / spacing)
    return rows[np.diff(stretch, prepend=-1.0) > 0.0]


def tube_vertices(
    mean: FloatArray, std: FloatArray
) -> tuple[Float32Array, Float32Array]:
    """Corners and unit normals of tubes, both (..., `N_RINGS` * `N_SIDES`, 3).

    Each cross-section is the ellipse across the path ``mean`` (..., M, 3) [m], with
    half axes of 1.96 ``std`` in the horizontal and in the vertical direction. The
    variance along the path is not shown.
    """
    # Path and σ at the rings, interpolated, both (..., rings, 3).
    rows = np.linspace(0.0, mean.shape[-2] - 1.0, N_RINGS)
    before = np.minimum(rows.astype(np.intp), mean.shape[-2] - 2)
    share = (rows - before)[:, None]
    centre, sigma = (
        (1.0 - share) * values[..., before, :] + share * values[..., before + 1, :]
        for values in (mean, std)
    )
    # Where a path hardly advances, its direction is noise; the nearest one is used.
    tangent = np.gradient(centre, axis=-2)
    speed = _length(tangent)
    slow = speed <= _SLOW * speed.max(axis=-2, keepdims=True)
    rings = np.arange(N_RINGS)
    distance = np.abs(rings[:, None] - rings)
    distance = distance + np.where(slow, N_RINGS, 0).swapaxes(-1, -2)
    nearest = np.argmin(distance, axis=-1)[..., None]
    tangent = np.take_along_axis(tangent / np.maximum(speed, 1e-300), nearest, axis=-2)
    # A constant path gets an arbitrary direction.
    tangent = np.where(speed.max(axis=-2, keepdims=True) > 0.0, tangent, [1.0, 0, 0])
    # Across the path: horizontally, the tangent times the upward unit vector (0, 1, 0),
    # which for a vertical path is any horizontal direction; and the third direction.
    side = tangent[..., [2, 1, 0]] * [-1.0, 0.0, 1.0]
    length = _length(side)
    side = np.where(length > 1e-6, side / np.maximum(length, 1e-6), [0.0, 0.0, 1.0])
    upward = np.cross(side, tangent)

    half_width = np.maximum(panels.QUANTILE * _length(side * sigma), _THINNEST)
    half_height = np.maximum(panels.QUANTILE * _length(upward * sigma), _THINNEST)
    angle = np.linspace(0.0, 2.0 * np.pi, N_SIDES, endpoint=False)[:, None]
    cosine, sine = np.cos(angle).astype(np.float32), np.sin(angle).astype(np.float32)

    def around(a: FloatArray, b: FloatArray) -> Float32Array:
        # (..., rings, sides, 3)
        a32, b32 = a.astype(np.float32), b.astype(np.float32)
        return cosine * a32[..., None, :] + sine * b32[..., None, :]

    vertices = around(half_width * side, half_height * upward)
    vertices += centre[..., None, :].astype(np.float32)
    # Normals of the ellipse; the slope along the path changes the shading little.
    normals = around(side / half_width, upward / half_height)
    normals /= _length(normals)
    shape = (*mean.shape[:-2], N_RINGS * N_SIDES, 3)
    return vertices.reshape(shape), normals.reshape(shape)


@functools.cache
def tube_triangles() -> NDArray[np.uint32]:
    """Corners of every triangle, the same for all tubes, (n, 3)."""
    ring, side = np.meshgrid(np.arange(N_RINGS - 1), np.arange(N_SIDES), indexing="ij")
    here = ring * N_SIDES + side
    beside = ring * N_SIDES + (side + 1) % N_SIDES
    first = np.stack([here, here + N_SIDES, beside], axis=-1)
    second = np.stack([beside, here + N_SIDES, beside + N_SIDES], axis=-1)
    return np.concatenate([first, second]).reshape(-1, 3).astype(np.uint32)


def _length(vectors: NDArray[Any]) -> NDArray[Any]:
    """Lengths of vectors (..., 3), kept as (..., 1)."""
    length: NDArray[Any] = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    return length[..., None]
