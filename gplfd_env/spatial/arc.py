"""The circle on which a hinged door moves its handle."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

Array = NDArray[np.float64]


def handle_pose_on_arc(radius: ArrayLike, angle: ArrayLike) -> Array:
    """Return the handle's poses (..., 6) at opening angles, task frame [m, rad].

    x = R sin φ, z = -R (1 - cos φ), rotation +φ about y; radii and angles broadcast.
    """
    radii, angles = np.broadcast_arrays(radius, angle)
    poses = np.zeros((*angles.shape, 6))
    poses[..., 0] = radii * np.sin(angles)
    poses[..., 2] = radii * (np.cos(angles) - 1.0)
    poses[..., 4] = angles
    return poses
