"""Where demonstrations end, the motion goes on as it was going.

A robot that was shown a door opened to 45° is not done there if the door is to be wide
open. The last piece of a demonstration, carried on unchanged, is a screw about a fixed
axis: the turn about a hinge, the straight pull of a drawer. How wrong that becomes is
seen within the demonstrations themselves: each is cut short, carried on, and compared
with what it did.
"""

from dataclasses import replace
from typing import Final

import numpy as np
from jaxtyping import Float
from scipy.spatial.transform import RigidTransform, Rotation

from gplfd_env.rotation_paths import unwrap_rotvecs
from policies.aligned import AlignedDemonstrations

_TAIL: Final = 0.25
"""Share of the path before its end whose screw is carried on."""
_RAMP: Final = 0.15
"""Phase in which a motion that has come to rest regains its mean speed."""
_CUTS: Final = (0.6, 0.7, 0.8)
"""Shares of the path at which it is cut to see how wrong a continuation becomes."""

Poses = Float[np.ndarray, "M 6"]
Shares = Float[np.ndarray, " S"]


def continued(aligned: AlignedDemonstrations, beyond: float) -> AlignedDemonstrations:
    """Let demonstrations go on where they end.

    Args:
        aligned: Demonstrations on phases that begin at 0 and end at 1.
        beyond: Share of each path's length by which it goes on, at the mean speed
            after a gentle start; 0 for none.

    Returns:
        As many samples on phases 0 to 1 of the longer task. Its `end` is the phase at
        which the demonstrations ended, and `drift` what the continuation is worth.

    Raises:
        ValueError: `beyond` is negative or not finite, or the demonstrations are
            continued already.
    """
    if not 0.0 <= beyond < np.inf:
        raise ValueError(f"beyond must be finite and >= 0, got {beyond}")
    if aligned.end < 1.0:
        raise ValueError(
            f"these demonstrations are continued already, from phase {aligned.end:.3g}"
        )
    if beyond == 0.0:
        return aligned
    clock = np.linspace(0.0, beyond + 0.5 * _RAMP, len(aligned.times))[1:]
    started = np.minimum(clock, _RAMP)
    shares = started * started / (2.0 * _RAMP) + (clock - started)
    length = 1.0 + clock[-1]
    phases = np.linspace(0.0, 1.0, len(aligned.times))
    times = np.concatenate([aligned.times, 1.0 + clock]) / length
    longer = [np.vstack([poses, carried_on(poses, shares)]) for poses in aligned.poses]
    return replace(
        aligned,
        times=phases,
        poses=np.stack([_sampled(phases, times, poses) for poses in longer]),
        duration=aligned.duration * length,
        clocks=_clocks(aligned, phases, length),
        end=1.0 / length,
        drift=length * drift(aligned),
    )


def drift(aligned: AlignedDemonstrations) -> Float[np.ndarray, " 6"]:
    """Return how wrong a continuation is, per share of the path that it goes on.

    Root mean square over demonstrations, cuts and distances h of error/h [m, rad]: the
    error of a direction that is a little wrong grows in proportion to the way.
    """
    errors = []
    for poses in aligned.poses:
        way = _way(poses)
        for cut in _CUTS:
            last = int(np.searchsorted(way, cut))
            rest = way[last + 1 :] - way[last]
            far = rest > 0.5 * (1.0 - cut)
            # As a share of the shorter path, which is all that is known at the cut.
            guess = carried_on(poses[: last + 1], rest[far] / way[last])
            off = guess - poses[last + 1 :][far]
            errors.append(off / (rest[far] / way[last])[:, None])
    return np.asarray(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)))


def carried_on(poses: Poses, shares: Shares) -> Float[np.ndarray, "S 6"]:
    """Return where a path would be if it went on as it was going.

    Args:
        poses: The path, with rotation vectors on one branch.
        shares: How far on, as shares of the path's length.
    """
    way = _way(poses)
    begin = int(np.searchsorted(way, 1.0 - _TAIL, side="right")) - 1
    last = _rigid(poses[-1])
    twist = (last * _rigid(poses[begin]).inv()).as_exp_coords()
    screws = shares[:, None] / (1.0 - way[begin]) * twist
    moved = RigidTransform.from_exp_coords(screws) * last
    rotvecs = np.vstack([poses[-1, 3:], moved.rotation.as_rotvec()])
    return np.hstack([moved.translation, unwrap_rotvecs(rotvecs)[1:]])


def _clocks(
    aligned: AlignedDemonstrations, phases: Float[np.ndarray, " M"], length: float
) -> Float[np.ndarray, "K M"] | None:
    """Return the clocks of the longer task, whose continuation keeps the mean time."""
    if aligned.clocks is None:
        return None
    demonstrated = [
        np.interp(phases * length, aligned.times, clock) / length
        for clock in aligned.clocks
    ]
    return np.where(phases * length <= 1.0, demonstrated, phases)


def _way(poses: Poses) -> Float[np.ndarray, " M"]:
    """Return the way to each sample, as a share of the path's length."""
    steps = np.linalg.norm(np.diff(poses[:, :3], axis=0), axis=1)
    way = np.concatenate([[0.0], np.cumsum(steps)])
    return np.asarray(way / max(way[-1], np.finfo(np.float64).tiny))


def _rigid(pose: Float[np.ndarray, " 6"]) -> RigidTransform:
    # A copy: SciPy does not take read-only rotation vectors.
    return RigidTransform.from_components(
        pose[:3], Rotation.from_rotvec(pose[3:].copy())
    )


def _sampled(phases: np.ndarray, times: np.ndarray, poses: np.ndarray) -> np.ndarray:
    return np.column_stack([np.interp(phases, times, curve) for curve in poses.T])
