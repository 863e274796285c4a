"""What the hand does about the force that a door puts up against being opened.

In Eq. (22) of Arduengo et al., *Gaussian-Process-based Robot Learning from
Demonstration*, arXiv:2002.09979, every external force displaces the set-point. A force
*across* the path tells that the path is wrong, and yielding is right. The force *along*
it is the door's weight: yielding to it only stretches the virtual spring until a heavy
door stalls.
"""

import math
from dataclasses import dataclass
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

Wrench = Float[np.ndarray, "*N 6"]
Direction = Float[np.ndarray, "*N 3"]
Pace = Float[np.ndarray, "*N"]


@runtime_checkable
class LoadRule(Protocol):
    """Decides which forces displace the set-point, and whether it waits.

    Rules keep no memory. Agents use one rule for all members of a batch if the
    members' rules are equal.
    """

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, Pace]:
        """Return the wrenches to yield to and the pace of the command phases."""


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

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, Pace]:
        """Take the carried load out of wrenches.

        Args:
            wrench: Force and moment on each hand, task frame [N, N m].
            direction: Unit vector along which the policy moves the hand.

        Returns:
            What is left to yield to, and the pace of the command phase: 1 (by the
            clock) without load, 0 at the limit, and down to -1 from 1.19 times the
            limit on, where the set-point comes back to the hand.
        """
        # Not `vecdot`: see `policies.compliance`.
        along = np.add.reduce(direction * wrench[..., :3], axis=-1)
        load = np.maximum(-along, 0.0)
        left = wrench.copy()
        left[..., :3] += np.minimum(load, self.limit)[..., None] * direction
        # Not `**`: for arrays its last bit depends on the processor.
        slowing = np.minimum(np.float_power(load / self.limit, 4.0), 2.0)
        return left, np.asarray(1.0 - slowing)


@dataclass(frozen=True, kw_only=True, slots=True)
class YieldToAll:
    """Every force displaces the set-point, which never waits: Eq. (22) as printed."""

    def share(self, wrench: Wrench, direction: Direction) -> tuple[Wrench, Pace]:
        """Return the wrenches as they are, and the clock's pace."""
        return wrench, np.ones(wrench.shape[:-1])
