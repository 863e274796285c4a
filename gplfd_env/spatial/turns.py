"""Rotations by about a full turn and more, such as those of valves and lids.

Rotation vectors are singular at 2π: near there, a small tilt of the hand is a large
change of the vector. A motion about one axis is therefore described by its turn,
accumulated along the path, and by a tilt that fades out near full turns.
"""

import numpy as np
import numpy.typing as npt

from gplfd_env.spatial.rotation_paths import Array
from gplfd_env.spatial.se3 import compose_rotvecs

REGULAR = 2.0 * np.pi * 5.0 / 6.0
"""Angle up to which rotation vectors describe any motion [rad]: 300°."""


def main_turn(rotvecs: npt.ArrayLike) -> tuple[Array, Array]:
    """Return the axis (3,) about which a path turns most, and turns (N,) [rad]."""
    path = np.asarray(rotvecs, dtype=np.float64)
    steps = compose_rotvecs(path[1:], -path[:-1])
    reached = np.vstack([np.zeros(3), np.cumsum(steps, axis=0)])
    distances = np.linalg.norm(reached, axis=1)
    axis = reached[np.argmax(distances)] / max(distances.max(), 1e-12)
    half = 0.5 * np.linalg.norm(path, axis=1)
    along = 0.5 * np.sinc(half / np.pi) * (path @ axis)
    turns = np.unwrap(2.0 * np.arctan2(along, np.cos(half)))
    return axis, turns + 2.0 * np.pi * np.round((path[0] @ axis - turns[0]) / 2 / np.pi)


def accumulated_rotvecs(rotvecs: Array) -> tuple[Array, float]:
    """Return a path of rotation vectors without singularities, and its largest tilt.

    A path (N, 3) [rad] within `REGULAR` is returned as it is, with tilt zero. Otherwise
    a vector v near a full turn becomes φ a + w (v - φ a), with the `main_turn` φ about
    a; the weight w falls smoothly from one, 60° away, to zero. The rotation then errs
    by less than the tilt [rad]: the rest of the rotation beside that turn.
    """
    angles = np.linalg.norm(rotvecs, axis=1)
    if angles.max() <= REGULAR:
        return rotvecs, 0.0
    axis, turns = main_turn(rotvecs)
    turned = turns[:, None] * axis
    # The equivalent vectors nearest to the turn.
    directions = rotvecs / np.maximum(angles, 1e-12)[:, None]
    missed = np.sum(directions * turned, axis=1) - angles
    rounds = 2.0 * np.pi * np.round(missed / (2.0 * np.pi))
    near = rotvecs + rounds[:, None] * directions
    share = np.minimum((np.sin(0.5 * angles) / np.sin(0.5 * REGULAR)) ** 2, 1.0)
    share[np.abs(turns) < np.pi] = 1.0
    weight = share**2 * (3.0 - 2.0 * share)
    tilt = np.linalg.norm(compose_rotvecs(rotvecs, -turned), axis=1)
    largest = float(tilt.max(where=weight < 1.0, initial=0.0))
    return turned + weight[:, None] * (near - turned), largest
