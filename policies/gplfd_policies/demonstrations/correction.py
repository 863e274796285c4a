"""A correction: motion of an episode in which somebody led the hand, and its origin."""

from dataclasses import dataclass
from typing import Final, Literal, get_args

import numpy as np
import scipy

from gplfd_policies.arrays.records import own_arrays, short_repr
from gplfd_policies.arrays.shapes import Bool, Float
from gplfd_policies.demonstrations.demonstration import Demonstration

Who = Literal["synthetic", "person"]
"""Who leads the hand."""

_WINDOW: Final = 0.5
"""Window of cubic polynomials by which the noise of a led hand is measured [s]."""


@dataclass(frozen=True, kw_only=True, slots=True, eq=False)
class Correction:
    """Motion of the hand in an episode in which somebody led it for some of the time.

    Raises:
        ValueError: If nobody led the hand, or a field is not as described.
    """

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
    """Phase, 0 to 1, that the policy estimated when the hand was first led; 0 for a
    policy without a phase."""
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
        if self.inputs is not None:
            own_arrays(self, "inputs")
            if self.inputs.ndim != 2 or len(self.inputs) != len(led):
                raise ValueError(f"inputs need {len(led)} rows: {self.inputs.shape}")

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
