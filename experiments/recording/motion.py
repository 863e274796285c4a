"""Demonstrations, policy, via-points and force in the door's frame."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
import rerun as rr
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from experiments.episode_log import EpisodeLog
from experiments.recording import colours
from experiments.recording.stream import seconds
from experiments.recording.tube import tube_triangles, tube_vertices
from gplfd_env.task import handle_pose_on_arc
from policies.demonstrations import Demonstration

FloatArray = NDArray[np.float64]

ROOT: Final = "/world/task"
"""Entity whose transform is the task frame: closed handle, x pull, y up."""

PLAN: Final = f"{ROOT}/plan"
"""Entity of what only the view from above shows."""

TASK_SITE: Final = "task_frame"
"""Site of the model that carries the task frame."""

METRES_PER_NEWTON: Final = 0.01
"""Length of the force arrow: 10 N are 10 cm."""

_N_TRAIL: Final = 80
_FRAMES_PER_SECOND: Final = 30.0
_TRUE_ARC_DEG: Final = 75.0
_LINE: Final = 0.003
_OPACITY_BEFORE: Final = 48
_OPACITY_ADAPTED: Final = 90


def log_motion(
    stream: rr.RecordingStream,
    log: EpisodeLog,
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> None:
    """Log what the policy knew, believed and felt, in the task frame.

    Args:
        stream: Recording to write to.
        log: Episode.
        model: Model with the site `TASK_SITE`, fixed in the world.
        demonstrations: What the policy learned from, poses in the task frame.
    """
    position, rotation = task_frame(model, log.qpos[0])
    pose = rr.Transform3D(
        translation=position, quaternion=rr.Quaternion(xyzw=rotation.as_quat())
    )
    stream.log(ROOT, pose, static=True)
    _log_demonstrations(stream, demonstrations)
    _log_true_arc(stream, log)
    _log_policy(stream, log)
    _log_trail(stream, log)
    _log_force(stream, log)
    _log_leaf(stream, log)


def task_frame(model: mujoco.MjModel, qpos: FloatArray) -> tuple[FloatArray, Rotation]:
    """Origin (3,) [m] and rotation of the task frame in the world.

    Raises:
        KeyError: The model has no site `TASK_SITE`.
    """
    site = model.site(TASK_SITE).id
    data = mujoco.MjData(model)
    data.qpos[:] = qpos
    mujoco.mj_kinematics(model, data)
    matrix = data.site_xmat[site].reshape(3, 3)
    return data.site_xpos[site].copy(), Rotation.from_matrix(matrix)


def _log_demonstrations(
    stream: rr.RecordingStream, demonstrations: Sequence[Demonstration]
) -> None:
    strips = [demonstration.poses[:, :3] for demonstration in demonstrations]
    lines = rr.LineStrips3D(strips, colors=colours.DEMONSTRATION, radii=_LINE / 2)
    stream.log(f"{ROOT}/demonstrations", lines, static=True)


def _log_true_arc(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    angles = np.radians(np.linspace(0.0, _TRUE_ARC_DEG, 76))
    arc = np.stack([handle_pose_on_arc(log.radius, angle)[:3] for angle in angles])
    lines = rr.LineStrips3D([arc], colors=colours.TRUTH, radii=_LINE)
    stream.log(f"{ROOT}/true_arc", lines, static=True)


def _log_policy(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log the first forecast once and all of them as a tube that moves in time."""
    if log.forecast_times.size == 0:
        return
    means, stds = log.forecast_mean[..., :3], log.forecast_std[..., :3]
    vertices, normals = zip(
        *(tube_vertices(mean, std) for mean, std in zip(means, stds, strict=True)),
        strict=True,
    )
    before = rr.LineStrips3D([means[0]], colors=colours.BEFORE, radii=_LINE)
    stream.log(f"{ROOT}/policy_before/mean", before, static=True)
    stream.log(
        f"{ROOT}/policy_before/tube",
        rr.Mesh3D(
            vertex_positions=vertices[0],
            vertex_normals=normals[0],
            triangle_indices=tube_triangles(),
            albedo_factor=(*colours.BEFORE, _OPACITY_BEFORE),
        ),
        static=True,
    )
    index = seconds(log.forecast_times)
    mean_entity, tube_entity = f"{ROOT}/policy_now/mean", f"{ROOT}/policy_now/tube"
    style = rr.LineStrips3D.from_fields(colors=colours.ADAPTED, radii=_LINE)
    stream.log(mean_entity, style, static=True)
    stream.send_columns(mean_entity, index, rr.LineStrips3D.columns(strips=list(means)))
    stream.log(
        tube_entity,
        rr.Mesh3D.from_fields(
            triangle_indices=tube_triangles(),
            albedo_factor=(*colours.ADAPTED, _OPACITY_ADAPTED),
        ),
        static=True,
    )
    columns = rr.Mesh3D.columns(
        vertex_positions=np.concatenate(vertices),
        vertex_normals=np.concatenate(normals),
    )
    stream.send_columns(
        tube_entity, index, columns.partition([len(rings) for rings in vertices])
    )


def _log_trail(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log the hand's path and its via-points, growing with time."""
    ends = np.unique(np.linspace(1, log.times.size - 1, _N_TRAIL).astype(int))
    positions = log.ee_pose[:, :3]
    # Points of the trail are spaced as its updates are: each update adds one.
    knots = np.concatenate([[0], ends])
    trail = f"{ROOT}/hand/trail"
    style = rr.LineStrips3D.from_fields(colors=colours.HAND, radii=_LINE)
    stream.log(trail, style, static=True)
    strips = [positions[knots[: count + 2]] for count in range(ends.size)]
    stream.send_columns(
        trail, seconds(log.times[ends]), rr.LineStrips3D.columns(strips=strips)
    )
    rows = np.flatnonzero(log.via_point)
    if rows.size == 0:
        return
    rows = rows[np.unique(np.linspace(0, rows.size - 1, _N_TRAIL).astype(int))]
    points = f"{ROOT}/hand/via_points"
    dots = rr.Points3D.from_fields(colors=colours.HAND, radii=0.006)
    stream.log(points, dots, static=True)
    so_far = [positions[rows[: count + 1]] for count in range(rows.size)]
    columns = rr.Points3D.columns(positions=np.concatenate(so_far))
    stream.send_columns(
        points,
        seconds(log.times[rows]),
        columns.partition([len(taken) for taken in so_far]),
    )


def _log_force(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log the door's force on the hand as an arrow at the hand."""
    entity = f"{ROOT}/hand/force"
    rows = _rows(log)
    style = rr.Arrows3D.from_fields(colors=colours.FORCE, radii=0.006)
    stream.log(entity, style, static=True)
    columns = rr.Arrows3D.columns(
        origins=log.ee_pose[rows, :3], vectors=METRES_PER_NEWTON * log.wrench[rows, :3]
    )
    stream.send_columns(entity, seconds(log.times[rows]), columns)


def _log_leaf(stream: rr.RecordingStream, log: EpisodeLog) -> None:
    """Log the line from hinge to handle, closed and now, for the view from above."""
    hinge = np.array([0.0, 0.0, -log.radius])
    closed = rr.LineStrips3D(
        [np.stack([hinge, np.zeros(3)])], colors=colours.MARK, radii=_LINE / 2
    )
    stream.log(f"{PLAN}/closed", closed, static=True)
    entity, rows = f"{PLAN}/leaf", _rows(log)
    style = rr.LineStrips3D.from_fields(colors=colours.LEAF, radii=2.0 * _LINE)
    stream.log(entity, style, static=True)
    handle = log.handle_pose[rows, :3]
    strips = np.stack([np.broadcast_to(hinge, handle.shape), handle], axis=1)
    columns = rr.LineStrips3D.columns(strips=list(strips))
    stream.send_columns(entity, seconds(log.times[rows]), columns)


def _rows(log: EpisodeLog) -> NDArray[np.intp]:
    """Rows at which moving things are logged, evenly spaced."""
    every = max(1, round(1.0 / (_FRAMES_PER_SECOND * log.dt)))
    return np.arange(0, log.times.size, every)
