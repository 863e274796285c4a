"""Aligned demonstrations: the result of alignment and the input of learning."""

from dataclasses import dataclass, field, replace

import numpy as np

from gplfd_policies.arrays.records import freeze, short_repr
from gplfd_policies.arrays.shapes import Float, Pose, Times
from gplfd_policies.demonstrations.rests import Rest


@dataclass(frozen=True, kw_only=True, slots=True)
class AlignedDemonstrations:
    """Demonstrations sampled at common phases; read-only.

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
    """Periods without motion that were left out of each demonstration; empty if rests
    were kept."""
    end: float = 1.0
    """Phase at which the demonstrations end and their continuation begins, see
    `gplfd_policies.demonstrations.continuation`."""
    drift: Pose = field(default_factory=lambda: np.zeros(6))
    """Standard deviation that the continuation gains per phase [m, rad]."""
    clocks: Float[np.ndarray, "K M"] | None = None
    """Time of each demonstration at the phases, as a share of its duration; None if
    unknown."""
    wrenches: Float[np.ndarray, "K M 6"] | None = None
    """Forces and moments of the hand on what it holds, in the axes of the hand
    [N, N m]; NaN for demonstrations without. None if no demonstration has any."""

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
        """The wrenches in place of the poses, to learn a movement of forces.

        Only of demonstrations with wrenches; None if there are none.
        """
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
        freeze(self, "times", "poses", "drift")
        for name in ("clocks", "wrenches"):
            if getattr(self, name) is not None:
                freeze(self, name)
        times, poses = self.times, self.poses
        if times.ndim != 1 or poses.ndim != 3 or poses.shape[1:] != (times.size, 6):
            raise ValueError(
                "times must have shape (M,) and poses (K, M, 6), got "
                f"{times.shape} and {poses.shape}"
            )
        if len(poses) < 1 or len(times) < 2:
            raise ValueError(
                "at least one demonstration and two phases are needed, got "
                f"{len(poses)} and {len(times)}"
            )
        if not (np.isfinite(poses).all() and np.isfinite(times).all()):
            raise ValueError("times and poses must be finite; drop NaN and inf first")
        clocks = self.clocks
        if clocks is not None and not (
            clocks.shape == poses.shape[:2] and (np.abs(clocks - 0.5) <= 0.5).all()
        ):
            raise ValueError(
                "clocks must be None, or of shape (K, M) and within [0, 1], a share of "
                f"the duration for every pose; got shape {clocks.shape} for poses of "
                f"{poses.shape}"
            )
        wrenches = self.wrenches
        if wrenches is not None:
            finite = np.isfinite(wrenches)
            whole = finite.all(axis=(1, 2)) | ~finite.any(axis=(1, 2))
            if wrenches.shape != poses.shape or not (whole.all() and finite.any()):
                raise ValueError(
                    "wrenches must be None, or of the shape of the poses with finite "
                    "numbers for at least one demonstration, and NaN throughout for "
                    f"those without; got shape {wrenches.shape} for poses of "
                    f"{poses.shape}"
                )
        if times[0] < 0.0 or times[-1] > 1.0 or np.any(np.diff(times) <= 0):
            raise ValueError(
                "times are phases: they must increase strictly within [0, 1], got "
                f"{times[0]} ... {times[-1]}; divide seconds by the duration"
            )
        if not 0.0 < self.end <= 1.0:
            raise ValueError(f"end must be a phase in (0, 1], got {self.end}")
        if self.drift.shape != (6,) or not np.all(self.drift >= 0.0):
            raise ValueError(f"drift must be six numbers >= 0, got {self.drift}")
        if not 0.0 < self.duration < np.inf:
            raise ValueError(
                f"duration must be positive and finite [s], got {self.duration}"
            )
