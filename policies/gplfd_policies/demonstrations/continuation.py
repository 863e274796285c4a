"""Continuation of demonstrations beyond their end.

A demonstration that opens a door to 45° ends too early if the door must open wide. It
is continued by the screw motion of its last part about a fixed axis, such as the
rotation about a hinge or the straight pull of a drawer. The error of this extrapolation
is measured on the demonstrations themselves: each is cut, continued, and compared with
the part that was cut off.
"""

from dataclasses import replace
from typing import Any, Final

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import pose_steps
from gplfd_policies.arrays.resolution import interpolated
from gplfd_policies.arrays.shapes import Float, Outputs, Pose, Times
from gplfd_policies.demonstrations.aligned import AlignedDemonstrations

_TAIL: Final = 0.25
"""Share of the path, before its end, that defines the continued screw motion."""
_TURN: Final = 0.5 * np.pi
"""Largest rotation of that part [rad]; on a path that turns faster it is shorter."""
_RAMP: Final = 0.15
"""Phase within which a motion at rest regains its mean speed."""
_CUTS: Final = (0.6, 0.7, 0.8)
"""Shares of the path at which it is cut to measure the error of its continuation."""
_AHEAD: Final = np.array([0.5, 0.75, 1.0])
"""Points at which that error is measured, as shares of the part that was cut off."""

Shares = Float[np.ndarray, " S"]


def continued(aligned: AlignedDemonstrations, beyond: float) -> AlignedDemonstrations:
    """Continue demonstrations on phases 0 to 1 by a share of each path's length.

    The result has the same number of samples on phases 0 to 1 of the longer task. Its
    `end` is the phase at which the demonstrations end, and `drift` the error of the
    continuation.
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
    clocks = None
    if aligned.clocks is not None:
        # The continuation keeps the mean time.
        demonstrated = [
            np.interp(phases * length, aligned.times, demonstrated_clock) / length
            for demonstrated_clock in aligned.clocks
        ]
        clocks = np.where(phases * length <= 1.0, demonstrated, phases)
    wrenches = aligned.wrenches
    if wrenches is not None:
        # The last wrench is kept.
        elapsed = phases * length
        wrenches = np.stack(
            [interpolated(elapsed, aligned.times, wrench) for wrench in wrenches]
        )
    return replace(
        aligned,
        times=phases,
        poses=np.stack([interpolated(phases, times, poses) for poses in longer]),
        wrenches=wrenches,
        duration=aligned.duration * length,
        clocks=clocks,
        end=1.0 / length,
        drift=length * drift(aligned),
    )


def drift(aligned: AlignedDemonstrations) -> Pose:
    """Return the error of a continuation per added length of path [m, rad].

    It is the root mean square of error/h over demonstrations, cuts and distances h,
    because the error of a slightly wrong direction grows with h.
    """
    errors = []
    for poses in aligned.poses:
        way = _way(poses)
        for cut in _CUTS:
            rest = (1.0 - cut) * _AHEAD
            guess = _screwed(poses, way, cut, rest)
            # Relative to the shorter path, the only one that is known at the cut.
            missed = guess - interpolated(cut + rest, way, poses)
            errors.append(missed / (rest[:, None] / cut))
    return np.asarray(np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)))


def carried_on(poses: Outputs, shares: Shares) -> Float[np.ndarray, "S 6"]:
    """Return the screw continuation of a path."""
    return _screwed(poses, _way(poses), 1.0, shares)


def _screwed(
    poses: Outputs, way: Times, cut: float, ahead: Shares
) -> Float[np.ndarray, "S 6"]:
    """Continue a path that is cut at a share of its length, by further shares."""
    turned = np.linalg.norm(
        interpolated(np.array([cut]), way, poses)[0, 3:] - poses[:, 3:], axis=1
    )
    near = way[(turned <= _TURN) & (way < cut)]
    begins = max((1.0 - _TAIL) * cut, float(near.min()) if near.size else 0.0)
    begin, last = interpolated(np.array([begins, cut]), way, poses)
    final = _rigid(last)
    twist = (final * _rigid(begin).inv()).as_exp_coords()
    moved = scipy.spatial.transform.RigidTransform.from_exp_coords(
        ahead[:, None] / (cut - begins) * twist
    )
    moved = moved * final
    rotvecs = unwrap_rotvecs(np.vstack([last[3:], moved.rotation.as_rotvec()]))
    return np.hstack([moved.translation, rotvecs[1:]])


def _way(poses: Outputs) -> Times:
    """Return the share of the path up to each sample; for a path at rest, of time."""
    way = np.concatenate([[0.0], np.cumsum(pose_steps(poses))])
    if way[-1] <= 0.0:
        return np.linspace(0.0, 1.0, len(poses))
    return np.asarray(way / way[-1])


def _rigid(pose: Pose) -> Any:
    transform = scipy.spatial.transform
    # A copy, because SciPy rejects read-only rotation vectors.
    rotation = transform.Rotation.from_rotvec(pose[3:].copy())
    return transform.RigidTransform.from_components(pose[:3], rotation)
