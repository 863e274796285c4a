"""Where a model's bodies are: fixed parts from the model, moving ones from states."""

from typing import Final

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray

ROOT: Final = "/world/scene"
"""Entity above all bodies; the axes are MuJoCo's world axes, z up."""

TASK_SITE: Final = "task_frame"
"""Site of the model that carries the task frame."""


def task_frame(model: mujoco.MjModel) -> tuple[FloatArray, Rotation]:
    """Origin (3,) [m] and rotation of the task frame in the world.

    Raises:
        KeyError: The model has no site `TASK_SITE`.
    """
    site = model.site(TASK_SITE).id
    position, quaternion = _product(
        pose_on_carrier(model, int(model.site_bodyid[site])),
        (model.site_pos[site], model.site_quat[site]),
    )
    return position, Rotation.from_quat(quaternion, scalar_first=True)


def poses_on_carriers(model: mujoco.MjModel) -> tuple[FloatArray, FloatArray]:
    """Positions (ngeom, 3) [m] and quaternions (w, x, y, z) (ngeom, 4) of all geoms.

    Each is relative to the `carrier` of the geom's body.
    """
    positions, quaternions = np.array(model.geom_pos), np.array(model.geom_quat)
    bodies = model.geom_bodyid.tolist()
    fixed = np.flatnonzero(model.body_weldid != np.arange(model.nbody)).tolist()
    poses = {body: pose_on_carrier(model, body) for body in fixed}
    for geom, body in enumerate(bodies):
        if body in poses:
            position, quaternion = positions[geom], quaternions[geom]
            positions[geom], quaternions[geom] = _product(
                poses[body], (position, quaternion)
            )
    return positions, quaternions


def entity_of_body(model: mujoco.MjModel, body: int) -> str:
    """Path of a body's entity, below that of the moving body that carries it.

    Of a body that moves on its own, the entity's transform is its pose in the world.
    """
    name = model.body(body).name or f"body_{body}"
    top = carrier(model, body)
    if top in (0, body):
        return f"{ROOT}/{name}"
    return f"{entity_of_body(model, top)}/{name}"


def carrier(model: mujoco.MjModel, body: int) -> int:
    """Return the body that a body is rigidly fixed to; 0, the world, never moves."""
    return int(model.body_weldid[body])


def pose_on_carrier(model: mujoco.MjModel, body: int) -> tuple[FloatArray, FloatArray]:
    """Position (3,) [m] and quaternion (w, x, y, z) of a body on its `carrier`."""
    pose = np.zeros(3), np.array([1.0, 0.0, 0.0, 0.0])
    top = carrier(model, body)
    while body != top:
        pose = _product((model.body_pos[body], model.body_quat[body]), pose)
        body = int(model.body_parentid[body])
    return pose


def body_poses(
    model: mujoco.MjModel, qpos: FloatArray, bodies: list[int]
) -> tuple[FloatArray, FloatArray]:
    """World poses of bodies: (B, F, 3) [m] and quaternions (w, x, y, z) (B, F, 4)."""
    data = mujoco.MjData(model)
    positions = np.empty((len(qpos), model.nbody, 3))
    quaternions = np.empty((len(qpos), model.nbody, 4))
    now, xpos, xquat = data.qpos, data.xpos, data.xquat
    for frame, configuration in enumerate(qpos):
        now[:] = configuration
        mujoco.mj_kinematics(model, data)
        positions[frame] = xpos
        quaternions[frame] = xquat
    return (
        positions[:, bodies].swapaxes(0, 1),
        quaternions[:, bodies].swapaxes(0, 1),
    )


def _product(
    outer: tuple[FloatArray, FloatArray], inner: tuple[FloatArray, FloatArray]
) -> tuple[FloatArray, FloatArray]:
    position, quaternion = np.empty(3), np.empty(4)
    mujoco.mju_mulPose(position, quaternion, *outer, *inner)
    return position, quaternion
