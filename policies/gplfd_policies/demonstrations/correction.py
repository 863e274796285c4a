"""A correction: a motion in which somebody led the robot's hand, and its origin."""

from dataclasses import dataclass
from typing import Any, Final, Literal, get_args

import numpy as np
import scipy
from jaxtyping import Bool, Float

from gplfd_policies.arrays.records import short_repr
from gplfd_policies.demonstrations.demonstration import Demonstration

Leader = Literal["synthetic", "person"]
"""Who leads the hand."""

_WINDOW: Final = 0.5
"""Window of the cubic polynomials that a led hand follows but for its own noise [s]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Correction:
    """The hand's motion in an episode in which somebody led it for some of the time.

    The motion begins at the closed, grasped door, and not at the intervention: what
    came before fixes the phases of what follows. Read-only; two are equal if all their
    numbers are.

    Raises:
        ValueError: If the motion is not one that `Demonstration` takes, nobody led the
            hand, or who led it is unknown.
    """

    times: Float[np.ndarray, " N"]
    """Time stamps [s], strictly increasing."""
    poses: Float[np.ndarray, "N 6"]
    """Measured hand poses (x, y, z, θu_x, θu_y, θu_z), task frame [m, rad]."""
    led: Bool[np.ndarray, " N"]
    """At which samples somebody led the hand, from an intervention to the handover."""
    wrenches: Float[np.ndarray, "N 6"] | None = None
    """Force and moment of the hand on what it holds [N, N m], as a demonstration has
    them; None where they were not measured."""
    door: str = ""
    """Name of the door."""
    seed: int = 0
    """Seed of the episode."""
    by: Leader = "person"
    """Who led the hand."""
    phase: float = 0.0
    """Where along the task, 0 to 1, the policy believed the hand when it was first
    taken; 0 of a policy that has no phase."""

    __repr__ = short_repr

    def __post_init__(self) -> None:
        motion = Demonstration(
            times=self.times, poses=self.poses, wrenches=self.wrenches
        )
        for name in ("times", "poses", "wrenches"):
            object.__setattr__(self, name, getattr(motion, name))
        led = np.array(self.led)
        if led.shape != motion.times.shape or led.dtype != np.bool_ or not led.any():
            raise ValueError(
                f"led must be {motion.times.size} truth values, one per pose, and true "
                f"where somebody led the hand; got shape {led.shape}, "
                f"{np.count_nonzero(led)} of them true"
            )
        if self.by not in get_args(Leader):
            raise ValueError(
                f"by must be one of {', '.join(get_args(Leader))}, got {self.by!r}"
            )
        if not 0.0 <= self.phase <= 1.0:
            raise ValueError(f"phase must be within [0, 1], got {self.phase}")
        led.setflags(write=False)
        object.__setattr__(self, "led", led)

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Correction):
            return NotImplemented
        return self._content() == other._content()

    def __hash__(self) -> int:
        return hash(self._content())

    def _content(self) -> tuple[object, ...]:
        wrenches = None if self.wrenches is None else self.wrenches.tobytes()
        arrays = (self.times.tobytes(), self.poses.tobytes(), self.led.tobytes())
        return (*arrays, wrenches, *self.provenance.values())

    @property
    def motion(self) -> Demonstration:
        """The whole motion."""
        return Demonstration(times=self.times, poses=self.poses, wrenches=self.wrenches)

    @property
    def began(self) -> float:
        """Time of the first intervention [s]."""
        return float(self.times[self.led][0])

    @property
    def seconds(self) -> float:
        """For how long somebody led the hand [s]."""
        return float(np.diff(self.times)[self.led[:-1]].sum())

    @property
    def std(self) -> tuple[float, float]:
        """Noise of the led hand: standard deviations of position and rotation [m, rad].

        Root mean square distance per axis of the led poses from the cubic polynomial
        through their neighbours within a quarter of a second.
        """
        spacing = float(np.median(np.diff(self.times)))
        window = max(2 * round(0.5 * _WINDOW / spacing) + 1, 5)
        if window > self.times.size:
            return 0.0, 0.0
        smooth = scipy.signal.savgol_filter(self.poses, window, 3, axis=0)
        errors = (self.poses - smooth)[self.led]
        # A polynomial of four numbers takes its share of the noise away.
        square = np.mean(errors**2, axis=0) / (1.0 - 4.0 / window)
        position, rotation = np.sqrt(square.reshape(2, 3).mean(axis=1)).tolist()
        return position, rotation

    @property
    def provenance(self) -> dict[str, Any]:
        """Everything but the motion: plain data."""
        names = ("door", "seed", "by", "phase")
        return {name: getattr(self, name) for name in names}
