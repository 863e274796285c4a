"""Aligned demonstrations, the input of learning: their continuation and their modes.

A demonstration that ends too early is continued by the screw motion of its last part,
such as the rotation about a hinge or the straight pull of a drawer. The error of this
extrapolation is measured by cutting demonstrations and comparing with the rest.
"""

from dataclasses import dataclass, field, replace
from functools import partial
from typing import Final

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import unwrap_rotvecs
from gplfd_env.spatial.se3 import pose_steps
from gplfd_env.spatial.turns import REGULAR
from gplfd_policies.arrays.records import interpolated, own_arrays, short_repr
from gplfd_policies.arrays.shapes import Float, Outputs, Pose, Times

_TAIL: Final = 0.25
"""Share of the path, before its end, that defines the continued screw motion."""
_TURN: Final = 0.5 * np.pi
"""Largest rotation of that part [rad]; on a path that turns faster it is shorter."""
_RAMP: Final = 0.15  # phase within which a motion at rest regains its mean speed
_CUTS: Final = (0.6, 0.7, 0.8)
"""Shares of the path at which it is cut to measure the error of its continuation."""
_AHEAD: Final = np.array([0.5, 0.75, 1.0])
"""Points at which that error is measured, as shares of the part that was cut off."""

Shares = Float[np.ndarray, " S"]


@dataclass(frozen=True, kw_only=True, slots=True)
class Rest:
    """A part without motion that was left out, by the time stamps [s]."""

    start: float
    end: float


@dataclass(frozen=True, kw_only=True, slots=True)
class AlignedDemonstrations:
    """Demonstrations sampled at common phases.

    Raises:
        ValueError: If a shape is wrong, an entry is not finite, the phases do not
            increase strictly within [0, 1], or the duration is not positive.
    """

    times: Times
    """Phases within [0, 1], strictly increasing."""
    poses: Float[np.ndarray, "K M 6"]
    """Poses [m, rad] of K demonstrations, rotation vectors on the same branch."""
    duration: float = 1.0
    """Nominal duration [s] of phases 0 to 1, without rests."""
    rests: tuple[tuple[Rest, ...], ...] = field(default=(), repr=False)
    """Periods that were left out of each demonstration; empty if rests were kept."""
    end: float = 1.0
    """Phase at which the demonstrations end and their continuation begins."""
    drift: Pose = field(default_factory=partial(np.zeros, 6))
    """Standard deviation that the continuation gains per phase [m, rad]."""
    clocks: Float[np.ndarray, "K M"] | None = None
    """Time of each demonstration at the phases, as a share of its duration."""
    wrenches: Float[np.ndarray, "K M 6"] | None = None
    """Forces and moments of the hand on what it holds, in the axes of the hand [N, N
    m]; NaN for demonstrations without, None if there are none."""

    __repr__ = short_repr

    @property
    def demonstrated(self) -> "AlignedDemonstrations":
        """The demonstrations without their continuation, on phases 0 to 1."""
        if self.end == 1.0:
            return self
        before = self.times <= self.end
        return replace(
            self,
            times=self.times[before] / self.end,
            poses=self.poses[:, before],
            duration=self.duration * self.end,
            clocks=None if self.clocks is None else self.clocks[:, before] / self.end,
            wrenches=None if self.wrenches is None else self.wrenches[:, before],
            end=1.0,
            drift=np.zeros(6),
        )

    @property
    def forces(self) -> "AlignedDemonstrations | None":
        """The wrenches as poses, of demonstrations that have them; None for none."""
        if self.wrenches is None:
            return None
        felt = np.isfinite(self.wrenches[:, 0, 0])
        return replace(
            self,
            poses=self.wrenches[felt],
            clocks=None if self.clocks is None else self.clocks[felt],
            wrenches=None,
            rests=(),
            drift=np.zeros(6),
        )

    def __post_init__(self) -> None:
        own_arrays(self, "times", "poses", "drift", "clocks", "wrenches")
        times, poses, clocks = self.times, self.poses, self.clocks
        if times.ndim != 1 or poses.ndim != 3 or poses.shape[1:] != (times.size, 6):
            raise ValueError(
                "times must have shape (M,) and poses (K, M, 6), got "
                f"{times.shape} and {poses.shape}"
            )
        if len(poses) < 1 or len(times) < 2:
            raise ValueError(f"needs a demonstration and two phases, got {poses.shape}")
        if not (np.isfinite(poses).all() and np.isfinite(times).all()):
            raise ValueError("times and poses must be finite; drop NaN and inf first")
        if times[0] < 0.0 or times[-1] > 1.0 or np.any(np.diff(times) <= 0):
            raise ValueError(
                "times are phases: they must increase strictly within [0, 1], got "
                f"{times[0]} ... {times[-1]}; divide seconds by the duration"
            )
        if clocks is not None and not (
            clocks.shape == poses.shape[:2] and (np.abs(clocks - 0.5) <= 0.5).all()
        ):
            raise ValueError(f"clocks must be (K, M), 0 to 1, or None: {clocks.shape}")
        if self.wrenches is not None:
            finite = np.isfinite(self.wrenches)
            whole = finite.all(axis=(1, 2)) | ~finite.any(axis=(1, 2))
            if finite.shape != poses.shape or not (whole.all() and finite.any()):
                raise ValueError(
                    "wrenches must be None, or of the shape of the poses and finite, "
                    f"or NaN throughout for demonstrations without: {finite.shape}"
                )
        if self.drift.shape != (6,) or not np.all(self.drift >= 0.0):
            raise ValueError(f"drift must be six numbers >= 0, got {self.drift}")
        if not (0.0 < self.end <= 1.0 and 0.0 < self.duration < np.inf):
            raise ValueError(
                "end must be a phase in (0, 1] and duration positive [s], got "
                f"{self.end} and {self.duration}"
            )


def continued(aligned: AlignedDemonstrations, beyond: float) -> AlignedDemonstrations:
    """Continue demonstrations on phases 0 to 1 by a share of each path's length.

    The result has the same number of samples. Its `end` is the phase at which the
    demonstrations end, and `drift` the root mean square error of the continuation.
    """
    if not 0.0 <= beyond < np.inf:
        raise ValueError(f"beyond must be finite and >= 0, got {beyond}")
    if beyond == 0.0:
        return aligned
    first, last = aligned.times[[0, -1]]
    if aligned.end < 1.0 or first != 0.0 or last != 1.0:
        raise ValueError(
            "only demonstrations on phases 0 to 1 are continued, and only once; got "
            f"{first} to {last}, continued from {aligned.end:.3g}"
        )
    clock = np.linspace(0.0, beyond + 0.5 * _RAMP, len(aligned.times))[1:]
    started = np.minimum(clock, _RAMP)
    shares = started * started / (2.0 * _RAMP) + (clock - started)
    length = 1.0 + clock[-1]
    phases = np.linspace(0.0, 1.0, len(aligned.times))
    times = np.concatenate([aligned.times, 1.0 + clock]) / length
    longer = [np.vstack([poses, carried_on(poses, shares)]) for poses in aligned.poses]
    # The continuation keeps the mean time and the last wrench.
    elapsed, clocks, wrenches = phases * length, aligned.clocks, aligned.wrenches
    if clocks is not None:
        before = [np.interp(elapsed, aligned.times, c) / length for c in clocks]
        clocks = np.where(elapsed <= 1.0, before, phases)
    if wrenches is not None:
        felt = [interpolated(elapsed, aligned.times, wrench) for wrench in wrenches]
        wrenches = np.stack(felt)
    # The error per added length, where the rest of a path is known.
    errors = []
    for poses in aligned.poses:
        way = _way(poses)
        for cut in _CUTS:
            rest = (1.0 - cut) * _AHEAD
            missed = carried_on(poses, rest, cut) - interpolated(cut + rest, way, poses)
            # Relative to the shorter path, the only one that is known at the cut.
            errors.append(missed / (rest[:, None] / cut))
    return replace(
        aligned,
        times=phases,
        poses=np.stack([interpolated(phases, times, poses) for poses in longer]),
        wrenches=wrenches,
        duration=aligned.duration * length,
        clocks=clocks,
        end=1.0 / length,
        drift=length * np.sqrt(np.mean(np.concatenate(errors) ** 2, axis=0)),
    )


def carried_on(
    poses: Outputs, ahead: Shares, cut: float = 1.0
) -> Float[np.ndarray, "S 6"]:
    """Return the screw continuation of a path by shares of its length, after a cut."""
    way = _way(poses)
    place = interpolated(np.array([cut]), way, poses)[0]
    turned = np.linalg.norm(place[3:] - poses[:, 3:], axis=1)
    near = way[(turned <= _TURN) & (way < cut)]
    begins = max((1.0 - _TAIL) * cut, float(near.min()) if near.size else 0.0)
    begin, last = ends = interpolated(np.array([begins, cut]), way, poses)
    transform = scipy.spatial.transform
    turns, rigid = transform.Rotation.from_rotvec(ends[:, 3:]), transform.RigidTransform
    first, final = rigid.from_components(ends[:, :3], turns)
    twist = (final * first.inv()).as_exp_coords()
    twists = ahead[:, None] / (cut - begins) * twist
    moved = rigid.from_exp_coords(twists) * final
    if np.linalg.norm(poses[:, 3:], axis=1).max() > REGULAR:
        # The path turns about one axis: the turn goes on, past any full turn.
        rotvecs = last[3:] + ahead[:, None] / (cut - begins) * (last - begin)[3:]
        return np.hstack([moved.translation, rotvecs])
    rotvecs = unwrap_rotvecs(np.vstack([last[3:], moved.rotation.as_rotvec()]))
    return np.hstack([moved.translation, rotvecs[1:]])


def _way(poses: Outputs) -> Times:
    """Return the share of the path up to each sample; for a path at rest, of time."""
    way = np.concatenate([[0.0], np.cumsum(pose_steps(poses))])
    if way[-1] <= 0.0:
        return np.linspace(0.0, 1.0, len(poses))
    return np.asarray(way / way[-1])


WITHIN: Final = 0.4
"""s: expected distance of a shape from the mean of its mode; two are over 2 apart."""

_LEAST: Final = (0.01, 0.1)
"""Least motion with a defined shape, root mean square: position [m], rotation [rad]."""
_ARM: Final = 1.0
"""Distance [m] at which a rotation with a shape moves a point as far as the hand."""


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
    tree = scipy.cluster.hierarchy.linkage(
        shapes / np.sqrt(poses.shape[1]), method="ward"
    )
    # A merger at the height h adds h²/2 to W; without any, W is zero.
    within = np.cumsum([0.0, *(0.5 * tree[:, 2] ** 2)])[::-1]
    modes = np.arange(1, count + 1)
    best = int(modes[np.argmin(within / WITHIN**2 + modes * np.log(count))])
    labels = scipy.cluster.hierarchy.fcluster(tree, best, criterion="maxclust")
    members = [tuple(np.flatnonzero(labels == label).tolist()) for label in set(labels)]
    return tuple(sorted(members, key=lambda numbers: (-len(numbers), numbers)))
