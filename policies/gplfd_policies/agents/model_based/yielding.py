"""Compliance of model-based agents: one admittance, one constant stiffness.

The admittance is that of the learned agents, Eq. (22) of Arduengo et al.,
arXiv:2002.09979, M ë + D ė + K e = F. Those follow a path that they have learned; an
agent that finds the path on the way needs a very soft spring: with D² ≫ 4 M K the
displacement follows ė = F/D for some twenty seconds, an integral of the force, and a
lasting lateral force is nulled instead of balanced. With the robot's servo of 2000 N/m
the loop closes at 2000/D = 20 rad/s, whose margin of delay is 80 ms.
"""

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import VirtualDynamics

NEARLY_FREE: Final = VirtualDynamics(mass=np.repeat([1.0, 0.1], 3), damping_ratio=22.4)
"""At 5 N/m and 0.5 N m/rad, D is 100 N s/m and 10 N m s/rad."""


class Yielding:
    """Set-points that forces displace.

    Args:
        stiffness: K, translation [N/m] and rotation [N m/rad]. Tuned.
        dynamics: M, and δ, which makes D = 2 δ √(M K). Tuned.
    """

    def __init__(
        self,
        *,
        stiffness: tuple[float, float] = (5.0, 0.5),
        dynamics: VirtualDynamics = NEARLY_FREE,
    ) -> None:
        self._stiffness = np.repeat(stiffness, 3)
        self._admittance = Admittance(dynamics)

    def reset(self) -> None:
        """Come to rest, not displaced."""
        self._admittance.reset()

    def step(
        self,
        desired: Float[np.ndarray, " 6"],
        wrench: Float[np.ndarray, " 6"],
        **known: Any,
    ) -> AgentStep:
        """Return the step that commands a pose, displaced by a wrench."""
        offset = self._admittance.step(self._stiffness, wrench, CONTROL_PERIOD)
        action = desired + offset
        action[3:] = compose_rotvecs(offset[3:], desired[3:])
        return AgentStep(
            action=action, desired=desired, stiffness=self._stiffness, **known
        )
