"""Modes: which of some unlabelled demonstrations show one kind of motion.

A door is pulled or pushed, its hinge is on the right or the left, its handle turns up
or down. The mean of two kinds is none of them, so that each has to be learned alone.
"""

from typing import Final

import numpy as np
from scipy.cluster.hierarchy import fcluster, linkage

from gplfd_policies.arrays.shapes import Float
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

WITHIN: Final = 0.4
"""s: expected distance of the shape of a demonstration from the mean of its mode. Those
of tidy and messy teachers and of the recordings in examples/ are 0.05 to 0.12 away, the
means of two modes 2.0 to 2.7 from each other."""

_LEAST: Final = (0.01, 0.1)
"""Smallest motion that has a shape, root mean square: position [m], rotation [rad]."""

_ARM: Final = 1.0
"""Nor has a rotation a shape that moves a point at this distance by less than the hand
has moved [m]: what the hand turns on a leaf that only slides is chance."""


def partition(aligned: AlignedDemonstrations) -> tuple[tuple[int, ...], ...]:
    """Partition demonstrations into modes.

    The shape of a demonstration is its path over the phases, with positions divided by
    their root mean square from the start, and rotations by theirs: doors of different
    radius have one shape. A rotation that is small against the way of the hand is
    divided by that way, over a metre. Ward's method merges the two modes whose union
    adds least to W, the sum of squared distances of K shapes from the mean shape of
    their mode. Of the partitions into m modes that it passes, the one with the least

        W_m / s² + m log K

    is taken: the Bayesian information criterion of m Gaussians with the standard
    deviation s, per number that a shape has. A large W of one mode cannot be explained
    by a large s, because s is known: `WITHIN`.

    Returns:
        Numbers of the demonstrations of each mode, the largest mode first, of equally
        large modes the one whose demonstration was given first.
    """
    poses = aligned.demonstrated.poses
    count = len(poses)
    if count == 1:
        return ((0,),)
    moved, turned = (
        np.sqrt((part**2).sum(axis=2).mean(axis=1))
        for part in (poses[..., :3], poses[..., 3:])
    )
    sizes = np.stack(
        [
            np.maximum(moved, _LEAST[0]),
            np.maximum(np.maximum(turned, _LEAST[1]), moved / _ARM),
        ],
        axis=1,
    )
    scaled = poses / np.repeat(sizes, 3, axis=1)[:, None, :]
    shapes: Float[np.ndarray, "K S"] = scaled.reshape(count, -1)
    tree = linkage(shapes / np.sqrt(poses.shape[1]), method="ward")
    # A merger at the height h adds h²/2 to W; without any, W is zero.
    within = np.cumsum([0.0, *(0.5 * tree[:, 2] ** 2)])[::-1]
    modes = np.arange(1, count + 1)
    best = int(modes[np.argmin(within / WITHIN**2 + modes * np.log(count))])
    labels = fcluster(tree, best, criterion="maxclust")
    members = [tuple(np.flatnonzero(labels == one).tolist()) for one in set(labels)]
    return tuple(sorted(members, key=lambda numbers: (-len(numbers), numbers)))
