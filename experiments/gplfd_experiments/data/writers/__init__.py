"""Writers of demonstrations, episodes and commanded paths for other programs."""

import numpy as np
from scipy.spatial.transform import Rotation

from gplfd_experiments.files.arrays import FloatArray


def states_of(poses: FloatArray) -> FloatArray:
    """Return poses [m, rad], (N, 6), as positions and quaternions, scalar last.

    Successive quaternions have consistent signs, as actions are learned from states.
    """
    rotations = Rotation.from_rotvec(poses[:, 3:])
    states = np.hstack([poses[:, :3], rotations.as_quat()])
    flips = np.sum(states[1:, 3:] * states[:-1, 3:], axis=1) < 0.0
    states[1:, 3:] *= np.cumprod(np.where(flips, -1.0, 1.0))[:, None]
    return states
