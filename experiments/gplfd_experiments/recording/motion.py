"""Demonstrations, policy, via-points and force in the door's frame."""

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
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours
from gplfd_experiments.recording.lanes import colour_of, shown_stiffness
from gplfd_experiments.recording.scene import task_frame
from gplfd_experiments.recording.stream import frames, moving, static
from gplfd_experiments.recording.tube import tube_triangles, tube_vertices
from gplfd_policies.demonstrations.demonstration import Demonstration

ROOT: Final = "/world/task"
"""Entity whose transform is the task frame: closed handle, x pull, y up."""

PLAN: Final = f"{ROOT}/plan"
"""Entity that only the view from above shows."""

VIEW: Final = f"{ROOT}/view"
"""Entity of the frame of the views: the closed handle, z up."""

_VIEW_AXES: Final = [[-1.0, 0.0, 0.0], [0.0, 0.0, 1.0], [0.0, 1.0, 0.0]]
"""Its axes x (away from the robot), y and z as columns, in the task frame."""

STIFFNESS: Final = f"{ROOT}/hand/stiffness"
"""Entity of the ball that shows the stiffness of the hand."""

METRES_PER_NEWTON: Final = 0.01
"""Length of the force arrow: 10 N are 10 cm."""

_TRUE_ARC_DEG: Final = 75.0
_LINE, _DOT, _TRAIL, _BALL = 0.003, 0.006, 0.009, 0.03
"""Half the widths of lines [m]; the trail is thicker than the lines on it."""
_ABOVE_HAND: Final = (0.0, 0.16, 0.0)
"""Position of the ball of the stiffness relative to the hand, task frame [m]."""
_OPACITY_BEFORE, _OPACITY_ADAPTED = 48, 90
_KNOT_SPACING, _DOT_SPACING = 0.01, 0.005
"""Travelled distance [m] between points of the trail and between shown via-points."""


def door_frame(
    model: mujoco.MjModel, door: DoorConfig, demonstrations: Sequence[Demonstration]
) -> list[Chunk]:
    """Return static entities in the task frame, and the task frame itself."""
    side, radius, hinge = (
        door.hinge_sign,
        door.radius,
        -door.hinge_sign * door.hand_radius,
    )
    angles = np.radians(np.linspace(0.0, _TRUE_ARC_DEG, 76))
    if door.motion == "hinged":
        # About the hinge.
        path = handle_pose_on_arc(door.hand_radius, angles)[:, :3]
        path = path * [door.swing_sign, 1.0, side]
        leaf = [[[0.0, 0.0, 0.0], [0.0, 0.0, side * radius]]]
    else:
        # Relative to the handle, with which it moves.
        path = DoorGeometry.of(door).hand_poses(angles.clip(max=end_angle(door)))[:, :3]
        far = [
            0.0,
            0.0,
            -side * (door.fold_distance if door.motion == "folding" else radius),
        ]
        if door.motion == "flap":
            far = list(links_of(door)[-1].anchor)
        leaf, hinge = [[far, [0.0, 0.0, 0.0]]], 0.0
    position, rotation = task_frame(model)
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
        f"{ROOT}/hand/trail": rr.LineStrips3D.from_fields(radii=_TRAIL),
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
    paths = forecasts.mean[:, :, :3]
    # Without uncertainty, the tube is a line.
    stds = np.nan_to_num(forecasts.std[:, :, :3])
    vertices, normals = tube_vertices(paths, stds)
    means = paths.astype(np.float32)
    tubes = rr.Mesh3D.columns(
        vertex_positions=vertices.reshape(-1, 3), vertex_normals=normals.reshape(-1, 3)
    )
    # Without a stiffness the tube has the policy's colour.
    rows = np.searchsorted(log.times, forecasts.times).clip(max=log.times.size - 1)
    tints = colour_of(shown_stiffness(log)[rows], colours.ADAPTED)
    opacity = np.full((len(tints), 1), _OPACITY_ADAPTED, np.uint8)
    columns = [
        *tubes.partition(np.full(len(vertices), vertices.shape[1])),
        *rr.Mesh3D.columns(albedo_factor=np.hstack([tints, opacity])),
        *rr.LineStrips3D.columns(strips=means),
    ]
    now = moving(f"{ROOT}/policy_now", forecasts.times, columns)
    triangles = tube_triangles()
    before = static(
        f"{ROOT}/policy_before",
        rr.Mesh3D(
            vertex_positions=vertices[0],
            vertex_normals=normals[0],
            triangle_indices=triangles,
            albedo_factor=(*colours.BEFORE, _OPACITY_BEFORE),
        ),
        rr.LineStrips3D(means[:1], colors=colours.BEFORE, radii=_LINE),
    )
    look = static(
        f"{ROOT}/policy_now",
        rr.Mesh3D.from_fields(triangle_indices=triangles),
        rr.LineStrips3D.from_fields(colors=colours.ADAPTED, radii=_LINE),
    )
    return [before, look, now]


def hand_motion(log: EpisodeLog) -> list[Chunk]:
    """Return the hand's path, its via-points, the force on it, and the leaf."""
    positions, rows = log.motion.ee_pose[:, :3], frames(log)
    arrows = rr.Arrows3D.columns(
        origins=positions[rows], vectors=METRES_PER_NEWTON * log.forces.wrench[rows, :3]
    )
    # Not with the handle, which may rotate in the leaf.
    leaf = DoorGeometry.of(log.config).hand_poses(log.opening.door_angle[rows])
    turns = Rotation.from_rotvec(leaf[:, 3:]).as_quat()
    transforms = (
        rr.Transform3D.columns(quaternion=turns)
        if log.config.motion == "hinged"
        else rr.Transform3D.columns(translation=leaf[:, :3], quaternion=turns)
    )
    chunks = [
        moving(f"{ROOT}/hand/force", log.times[rows], arrows),
        moving(f"{PLAN}/leaf", log.times[rows], transforms),
    ]
    # The trail so far, a strip per stretch of about `_KNOT_SPACING`.
    knots = _spaced(positions, np.arange(log.times.size), _KNOT_SPACING)
    counts = np.arange(1, knots.size)
    if counts.size:
        ends = positions.astype(np.float32)
        strips = np.stack([ends[knots[:-1]], ends[knots[1:]]], axis=1)
        so_far = np.concatenate([strips[:count] for count in counts])
        columns = rr.LineStrips3D.columns(strips=so_far).partition(counts)
        chunks.append(moving(f"{ROOT}/hand/trail", log.times[knots[counts]], columns))
    # All via-points so far; only the first of coincident ones.
    rows = _spaced(positions, np.flatnonzero(log.decisions.via_point), _DOT_SPACING)
    counts = np.arange(1, rows.size + 1)
    if counts.size:
        so_far = np.concatenate([positions[rows[:count]] for count in counts])
        dots = rr.Points3D.columns(positions=so_far).partition(counts)
        chunks.append(moving(f"{ROOT}/hand/via_points", log.times[rows], dots))
    return chunks


def hand_stiffness(log: EpisodeLog) -> Iterator[Chunk]:
    """Return the colour of the hand's trail, and a ball that shows the stiffness."""
    positions, stiffness = log.motion.ee_pose[:, :3], shown_stiffness(log)
    knots = _spaced(positions, np.arange(log.times.size), _KNOT_SPACING)
    counts = np.arange(1, knots.size)
    if counts.size:
        tints = colour_of(stiffness[knots[1:]], colours.HAND)
        so_far = np.concatenate([tints[:count] for count in counts])
        columns = rr.LineStrips3D.columns(colors=so_far).partition(counts)
        yield moving(f"{ROOT}/hand/trail", log.times[knots[counts]], columns)
    if not np.isfinite(stiffness).any():
        return
    rows = frames(log)
    finite = np.isfinite(stiffness[rows])
    values = stiffness[rows[finite]]
    columns = rr.Points3D.columns(
        positions=positions[rows[finite]] + _ABOVE_HAND,
        colors=colour_of(values, colours.HAND),
        labels=[f"{value:.0f} N/m" for value in values],
    ).partition(finite.astype(int))
    yield static(STIFFNESS, rr.Points3D.from_fields(radii=_BALL, show_labels=True))
    yield moving(STIFFNESS, log.times[rows], columns)


def _spaced(
    positions: FloatArray, rows: NDArray[np.intp], spacing: float
) -> NDArray[np.intp]:
    """Return rows about ``spacing`` [m] of travel apart, independent of later rows."""
    steps = np.linalg.norm(np.diff(positions, axis=0), axis=1)
    travelled = np.concatenate([[0.0], np.cumsum(steps)])
    stretch = np.floor(travelled[rows] / spacing)
    return rows[np.diff(stretch, prepend=-1.0) > 0.0]
