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

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import pose_steps
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

_TAIL: Final = 0.25
"""Share of the path before its end whose screw is carried on."""
_TURN: Final = 0.5 * np.pi
"""Turn of the tail at most [rad]; of a path that turns faster it is shorter."""
_RAMP: Final = 0.15
"""Phase in which a motion that has come to rest regains its mean speed."""
_CUTS: Final = (0.6, 0.7, 0.8)
"""Shares of the path at which it is cut to see how wrong a continuation becomes."""
_AHEAD: Final = np.array([0.5, 0.75, 1.0])
"""Where that is looked at, as shares of what was cut off."""

Poses = Float[np.ndarray, "M 6"]
Shares = Float[np.ndarray, " S"]


def continued(aligned: AlignedDemonstrations, beyond: float) -> AlignedDemonstrations:
    """Let demonstrations go on where they end.

    Args:
        aligned: Demonstrations on phases 0 to 1.
        beyond: Share of each path's length by which it goes on, at the mean speed
            after a gentle start; 0 for none.

    Returns:
        As many samples on phases 0 to 1 of the longer task. Its `end` is the phase at
        which the demonstrations ended, and `drift` what the continuation is worth.

    Raises:
        ValueError: `beyond` is negative or not finite, or the demonstrations are not on
            phases 0 to 1, or continued already.
    """
    if not 0.0 <= beyond < np.inf:
        raise ValueError(f"beyond must be finite and >= 0, got {beyond}")
    if beyond == 0.0:
        return aligned
    if aligned.end < 1.0:
        raise ValueError(
            f"these demonstrations are continued already, from phase {aligned.end:.3g}"
        )
    if aligned.times[0] != 0.0 or aligned.times[-1] != 1.0:
        raise ValueError(
            "only demonstrations on phases 0 to 1 are continued, got phases "
            f"{aligned.times[0]} to {aligned.times[-1]}"
        )
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
        poses=np.stack([_at(phases, times, poses) for poses in longer]),
        duration=aligned.duration * length,
        clocks=_clocks(aligned, phases, length),
        end=1.0 / length,
        drift=length * drift(aligned),
    )


def drift(aligned: AlignedDemonstrations) -> Float[np.ndarray, " 6"]:
    """Return how wrong a continuation is, per length of the path that it goes on.

    Root mean square over demonstrations, cuts and distances h of error/h [m, rad]: the
    error of a direction that is a little wrong grows in proportion to the way.
    """
    errors = []
    for poses in aligned.poses:
        way = _way(poses)
        for cut in _CUTS:
            rest = (1.0 - cut) * _AHEAD
            guess = _screwed(poses, way, cut, rest)
            # As a share of the shorter path, which is all that is known at the cut.
            errors.append((guess - _at(cut + rest, way, poses)) / (rest[:, None] / cut))
    return np.asarray(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)))


def carried_on(poses: Poses, shares: Shares) -> Float[np.ndarray, "S 6"]:
    """Return where a path would be if it went on as it was going.

    Args:
        poses: The path, with rotation vectors on one branch.
        shares: How far on, as shares of the path's length.
    """
    return _screwed(poses, _way(poses), 1.0, shares)


def _screwed(
    poses: Poses, way: Float[np.ndarray, " M"], cut: float, ahead: Shares
) -> Float[np.ndarray, "S 6"]:
    """Carry a path on that is cut at a share of its length, by shares of it."""
    turned = np.linalg.norm(
        _at(np.array([cut]), way, poses)[0, 3:] - poses[:, 3:], axis=1
    )
    near = way[(turned <= _TURN) & (way < cut)]
    begins = max((1.0 - _TAIL) * cut, float(near.min()) if near.size else 0.0)
    begin, last = _at(np.array([begins, cut]), way, poses)
    final = _rigid(last)
    twist = (final * _rigid(begin).inv()).as_exp_coords()
    moved = RigidTransform.from_exp_coords(ahead[:, None] / (cut - begins) * twist)
    moved = moved * final
    rotvecs = unwrap_rotvecs(np.vstack([last[3:], moved.rotation.as_rotvec()]))
    return np.hstack([moved.translation, rotvecs[1:]])


def _way(poses: Poses) -> Float[np.ndarray, " M"]:
    """Return the way to each sample, turns included, as a share of the whole.

    Of a path that stays where it is, as if it went on evenly.
    """
    way = np.concatenate([[0.0], np.cumsum(pose_steps(poses))])
    if way[-1] <= 0.0:
        return np.linspace(0.0, 1.0, len(poses))
    return np.asarray(way / way[-1])


def _rigid(pose: Float[np.ndarray, " 6"]) -> RigidTransform:
    # A copy: SciPy does not take read-only rotation vectors.
    return RigidTransform.from_components(
        pose[:3], Rotation.from_rotvec(pose[3:].copy())
    )


def _at(wanted: Shares, given: Float[np.ndarray, " N"], poses: Poses) -> np.ndarray:
    """Return poses that are given at some shares at others, (S, 6)."""
    return np.column_stack([np.interp(wanted, given, curve) for curve in poses.T])


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
