"""The tangent-normal frame of a path, in which stiffness is defined.

Columns of a frame are the directions along the path, up, and across it, so that the
frame of the pull along x is the task frame. Products are written out, because BLAS may
add in an order that depends on the other rows.
"""

import numpy as np

from gplfd_policies.arrays.rows import PerRow
from gplfd_policies.arrays.shapes import Axes, Float, Frames, Vectors


def path_frame(tangent: Vectors) -> Frames:
    """Return frames whose first columns are unit tangents (..., 3), or their opposites.

    A frame is the least rotation of the task's axes from x to the tangent t or to -t,
    whichever is nearer: I + [u] + [u]²/(1 + x·t) with u = x × t. A push has the same
    frame as a pull. For a tangent in the horizontal plane, up is y. Where t is across
    x, the columns for such a tangent only change their sign.
    """
    tangent = np.where(tangent[..., :1] < 0.0, -tangent, tangent)
    x, y, z = tangent[..., 0], tangent[..., 1], tangent[..., 2]
    share = 1.0 / (1.0 + x)
    frame = np.empty((*tangent.shape, 3))
    frame[..., 0] = tangent
    frame[..., 0, 1:] = -tangent[..., 1:]
    frame[..., 1, 1] = 1.0 - y * y * share
    frame[..., 2, 2] = 1.0 - z * z * share
    frame[..., 1, 2] = frame[..., 2, 1] = -y * z * share
    return frame


def product(
    left: Float[np.ndarray, "*#N 3 3"], right: Float[np.ndarray, "*#N 3 J"]
) -> Float[np.ndarray, "*M 3 J"]:
    """Return the matrix products of stacks."""
    # Summed in the order of the rows.
    return np.asarray(np.add.reduce(left[..., None] * right[..., None, :, :], axis=-2))


def directional_std(frame: Frames, std: Axes, level: PerRow | float = 0.0) -> Axes:
    """Return σ along the directions of frames, and about the axes [m, rad].

    σ_d² = Σ_i T_id² σ_i² + 2 T_xd T_zd σ_xz with the covariance σ_xz of x and z [m²];
    other positions are independent.
    """
    turned = np.array(std)
    variance = (std[..., :3] * std[..., :3])[..., None]
    along = product((frame * frame).swapaxes(-1, -2), variance)[..., 0]
    both = frame[..., 0, :] * frame[..., 2, :]
    along += 2.0 * both * np.asarray(level)[..., None]
    turned[..., :3] = np.sqrt(np.maximum(along, 0.0))
    return turned
