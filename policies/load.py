"""What the hand does about the force that a door puts up against being opened.

In Eq. (22) of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, every external force displaces the set-point. A force
*across* the path tells that the path is wrong, and yielding is right. The force *along*
it is the door's weight: yielding to it only stretches the virtual spring until a heavy
door stalls.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

Wrench = Float[np.ndarray, " 6"]
Direction = Float[np.ndarray, " 3"]


@runtime_checkable
class LoadRule(Protocol):
    """Decides which forces displace the set-point, and whether it waits."""

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, float]:
        """Return the wrench to yield to and the pace of the command phase."""


@dataclass(frozen=True, kw_only=True, slots=True)
class CarriedLoad:
    """Carries resistance along the path up to a limit; yields to everything else."""

    limit: float = 25.0
    """Resistance that the hand carries without yielding [N]. A friction grasp of 16 N
    per finger slips at 37 N."""

    def __post_init__(self) -> None:
        if not 0.0 < self.limit < math.inf:
            raise ValueError(
                f"CarriedLoad.limit must be positive and finite [N], got {self.limit}; "
                "to carry nothing use YieldToAll"
            )

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, float]:
        """Take the carried load out of a wrench.

        Args:
            wrench: Force and moment on the hand, task frame [N, N m].
            direction: Unit vector along which the policy moves the hand.

        Returns:
            What is left to yield to, and the pace of the command phase: 1 (by the
            clock) without load, 0 at the limit, and down to -1 from 1.19 times the
            limit on, where the set-point comes back to the hand.
        """
        load = max(-float(direction @ wrench[:3]), 0.0)
        left = wrench.copy()
        left[:3] += min(load, self.limit) * direction
        return left, 1.0 - min((load / self.limit) ** 4, 2.0)


@dataclass(frozen=True, kw_only=True, slots=True)
class YieldToAll:
    """Every force displaces the set-point, which never waits: Eq. (22) as printed."""

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, float]:
        """Return the wrench as it is, and the clock's pace."""
        return wrench, 1.0
