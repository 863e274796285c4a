"""One recorded motion of the hand, and a correction of an episode by such a motion."""

import textwrap
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
import scipy

from gplfd_env.spatial.rotation_paths import rotvecs_from_quaternions, unwrap_rotvecs
from gplfd_env.spatial.se3 import into_axes, relative_poses, rotation_distance
from gplfd_env.spatial.turns import main_turn
from gplfd_policies.arrays.records import own_arrays, short_repr
from gplfd_policies.arrays.shapes import Bool, Float

_REST = 1e-9  # A motion that stays this near to its first pose [m, rad] is at rest
_SAME_ROTVEC = 1e-6
"""Unwrapping changes a component by less than this [rad] if there is no jump."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Demonstration:
    """A validated recording of hand poses, and optionally forces.

    Raises:
        ValueError: Wrong shapes, fewer than 3 samples, an entry that is not finite,
            times that do not increase, rotation vectors that jump, no motion at all.
    """

    times: Float[np.ndarray, " N"]
    """Time stamps [s], strictly increasing; the first need not be zero."""
    poses: Float[np.ndarray, "N 6"]
    """Hand poses (x, y, z, θu_x, θu_y, θu_z) [m, rad], task frame; θu is continuous."""
    wrenches: Float[np.ndarray, "N 6"] | None = None
    """Forces and moments (f_x, f_y, f_z, m_x, m_y, m_z) of the hand on what it holds
    [N, N m], in the axes of the task frame and about the hand; None if not recorded."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        own_arrays(self, "times", "poses", "wrenches")
        times, poses = self.times, self.poses
        if times.ndim != 1 or poses.shape != (*times.shape, 6):
            raise ValueError(
                "times must have shape (N,) and poses (N, 6) with columns x, y, z, "
                f"θu_x, θu_y, θu_z, got {times.shape} and {poses.shape}"
            )
        if times.size < 3:
            raise ValueError(f"a demonstration has 3 samples or more, not {times.size}")
        for name, rows in (("times", times[:, None]), ("poses", poses)):
            bad = np.flatnonzero(~np.isfinite(rows).all(axis=1))
            if bad.size:
                raise ValueError(
                    f"{name}[{bad[0]}] = {rows[bad[0]]} is not finite; drop or "
                    "interpolate the sample first"
                )
        stalled = np.flatnonzero(np.diff(times) <= 0)
        if stalled.size:
            index = int(stalled[0]) + 1
            raise ValueError(
                f"times must increase strictly, but times[{index}] = {times[index]} is "
                f"not later than {times[index - 1]}; sort the samples, drop repeats"
            )
        rotvecs = poses[:, 3:]
        moved = np.abs(unwrap_rotvecs(rotvecs) - rotvecs).max(axis=1) > _SAME_ROTVEC
        if moved.any():
            index = int(np.argmax(moved))
            raise ValueError(
                f"the rotation vectors jump at sample {index}, from "
                f"{rotvecs[index - 1]} to {rotvecs[index]}: build the demonstration by "
                "Demonstration.from_quaternions, or use unwrap_rotvecs first"
            )
        if np.abs(poses - poses[0]).max() <= _REST:
            raise ValueError(
                "the demonstration never moves: all poses are equal; check the "
                "recording and its units (metres, radians)"
            )
        felt = self.wrenches
        if felt is not None and not (
            felt.shape == poses.shape and np.isfinite(felt).all()
        ):
            raise ValueError(
                "wrenches must be finite and of shape (N, 6), force [N] and moment "
                f"[N m], one row per pose; got {felt.shape} for {len(poses)} poses"
            )

    @classmethod
    def from_quaternions(
        cls,
        times: Float[np.ndarray, "..."],
        positions: Float[np.ndarray, "..."],
        quaternions: Float[np.ndarray, "..."],
        order: Literal["wxyz", "xyzw"] = "wxyz",
        wrenches: Float[np.ndarray, "..."] | None = None,
    ) -> "Demonstration":
        """Build a demonstration from positions (N, 3) [m] and quaternions (N, 4).

        Signs of quaternions may flip; ``order`` is the position of the scalar part,
        first ("wxyz") or last ("xyzw"). Wrenches are (N, 6) as in the class, or None.
        Rotation vectors are unwrapped along the path.

        Raises:
            ValueError: As for the class, and for invalid quaternions.
        """
        positions = np.asarray(positions, dtype=np.float64)
        rotvecs = rotvecs_from_quaternions(quaternions, order=order)
        if positions.shape != rotvecs.shape:
            raise ValueError(
                f"positions must have shape (N, 3) with one row per quaternion, got "
                f"{positions.shape} for {len(rotvecs)} quaternions"
            )
        poses = np.hstack([positions, rotvecs])
        return cls(times=times, poses=poses, wrenches=wrenches)

    def relative_to_first(self) -> "Demonstration":
        """Return the motion relative to its first pose, which becomes zero: T_0⁻¹ T."""
        poses = relative_poses(self.poses, self.poses[0])
        wrenches = self.wrenches
        if wrenches is not None:
            turned = into_axes(self.poses[0, 3:], wrenches.reshape(-1, 2, 3))
            wrenches = turned.reshape(wrenches.shape)
        return Demonstration(times=self.times, poses=poses, wrenches=wrenches)


def turned(demonstration: Demonstration) -> float:
    """Return the largest rotation since the start [°], accumulated if over 180."""
    rotvecs = demonstration.poses[:, 3:]
    _, turns = main_turn(rotvecs)
    farthest = np.abs(turns - turns[0]).max()
    apart = rotation_distance(rotvecs, rotvecs[0]).max()
    return float(np.degrees(max(farthest, apart)))


def checked_demonstrations(demonstrations: object) -> tuple[Demonstration, ...]:
    """Return demonstrations as a tuple; raise TypeError if they are anything else."""
    several = tuple(demonstrations) if isinstance(demonstrations, Iterable) else (None,)
    if all(isinstance(entry, Demonstration) for entry in several):
        return several
    remedy = "put a single one into a list: [demonstration]"
    if hasattr(demonstrations, "demonstrations"):
        remedy = "pass its attribute: loaded.demonstrations"
    raise TypeError(
        "demonstrations must be a sequence of gplfd_policies.Demonstration, got "
        f"{textwrap.shorten(repr(demonstrations), 80, placeholder=' ...')}; {remedy}"
    )


Who = Literal["synthetic", "person"]  # Who leads the hand.

_WINDOW: Final = 0.5
"""Window of cubic polynomials by which the noise of a led hand is measured [s]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Correction:
    """Motion of the hand in an episode in which somebody led it for some time."""

    motion: Demonstration
    """Measured motion from the closed, grasped door on: the part before the
    intervention determines the phases of the rest."""
    led: Bool[np.ndarray, " N"]
    """Samples at which somebody led the hand, from intervention to handover."""
    door: str = ""
    """Name of the door."""
    seed: int = 0
    """Seed of the episode."""
    by: Who = "person"
    """Who led the hand."""
    phase: float = 0.0
    """Phase, 0 to 1, estimated by the policy when the hand was first led; else 0."""
    device: str = ""
    """Device with which a person led the simulated hand; "" if unknown."""
    inputs: Float[np.ndarray, "N n"] | None = None
    """Input of that device at each sample, from which the episode can be reproduced."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        led, wanted = np.array(self.led), self.motion.times.shape
        object.__setattr__(self, "led", led)
        if led.shape != wanted or led.dtype != np.bool_ or not led.any():
            raise ValueError(
                f"led must have shape {wanted} and be true where somebody led the "
                f"hand; got shape {led.shape}, {np.count_nonzero(led)} of them true"
            )
        if self.by not in get_args(Who) or not 0.0 <= self.phase <= 1.0:
            raise ValueError(
                f"by must be one of {get_args(Who)} and phase within [0, 1], got "
                f"{self.by!r} and {self.phase}"
            )
        own_arrays(self, "inputs")
        inputs = self.inputs
        if inputs is not None and (inputs.ndim != 2 or len(inputs) != len(led)):
            raise ValueError(f"inputs need {len(led)} rows: {inputs.shape}")

    @property
    def seconds(self) -> float:
        """Time for which somebody led the hand [s]."""
        return float(np.diff(self.motion.times)[self.led[:-1]].sum())

    @property
    def std(self) -> tuple[float, float]:
        """Noise of the led hand: standard deviations of position and rotation [m, rad].

        They are the root mean square distances per axis of the led poses from the cubic
        polynomial through their neighbours within a quarter of a second.
        """
        times, poses = self.motion.times, self.motion.poses
        window = max(2 * round(0.5 * _WINDOW / np.median(np.diff(times))) + 1, 5)
        if window > times.size:
            return 0.0, 0.0
        smooth = scipy.signal.savgol_filter(poses, window, 3, axis=0)
        # Correct for the noise that a polynomial of four numbers removes.
        square = np.mean((poses - smooth)[self.led] ** 2, axis=0) / (1.0 - 4.0 / window)
        position, rotation = np.sqrt(square.reshape(2, 3).mean(axis=1)).tolist()
        return position, rotation
