"""Modes: partition of unlabelled demonstrations by kind of motion.

A mode is e.g. to pull, or a side of the hinge: the mean of two is a motion of neither.
"""

from typing import Final

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from gplfd_policies.arrays.shapes import Float
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

WITHIN: Final = 0.4
"""s: expected distance of the shape of a demonstration from the mean of its mode. For
teachers and recordings it is 0.05 to 0.12; two modes are 2.0 to 2.7 apart."""

_LEAST: Final = (0.01, 0.1)
"""Least motion with a defined shape, root mean square: position [m], rotation [rad]."""
_ARM: Final = 1.0
"""A rotation that moves a point at this distance [m] less than the hand has no defined
shape: that of a hand on a sliding leaf is random."""


def partition(aligned: AlignedDemonstrations) -> tuple[tuple[int, ...], ...]:
    """Partition demonstrations into modes.

    The shape of a demonstration is its path over the phases, with positions divided by
    their root mean square from the start, and rotations by theirs: doors of different
    radius have the same shape. A rotation that is small relative to the motion of the
    hand is divided by that motion, over a metre. Of the partitions by Ward's method
    into m modes of K demonstrations, with W_m the sum of squared distances of shapes
    from the mean shape of their mode, the one with the least W_m / s² + m log K is
    selected. This is the Bayesian information criterion of m Gaussians with the
    standard deviation s, per number in a shape.

    Returns:
        Indices of the demonstrations of each mode. The largest mode is first; modes of
        equal size are in the order of their first demonstration.
    """
    poses = aligned.demonstrated.poses
    count = len(poses)
    if count == 1:
        return ((0,),)
    moved, turned = (
        np.sqrt((part**2).sum(axis=2).mean(axis=1))
        for part in (poses[..., :3], poses[..., 3:])
    )
    turned = np.maximum(np.maximum(turned, _LEAST[1]), moved / _ARM)
    sizes = np.stack([np.maximum(moved, _LEAST[0]), turned], axis=1)
    scaled = poses / np.repeat(sizes, 3, axis=1)[:, None, :]
    shapes: Float[np.ndarray, "K S"] = scaled.reshape(count, -1)
    tree = linkage(shapes / np.sqrt(poses.shape[1]), method="ward")
    # A merger at the height h adds h²/2 to W; without any, W is zero.
    within = np.cumsum([0.0, *(0.5 * tree[:, 2] ** 2)])[::-1]
    modes = np.arange(1, count + 1)
    best = int(modes[np.argmin(within / WITHIN**2 + modes * np.log(count))])
    labels = fcluster(tree, best, criterion="maxclust")
    members = [tuple(np.flatnonzero(labels == label).tolist()) for label in set(labels)]
    return tuple(sorted(members, key=lambda numbers: (-len(numbers), numbers)))
