"""How a reference agent yields: one admittance, one constant stiffness.

The admittance is that of the learned agents, Eq. (22) of Arduengo et al.,
arXiv:2002.09979, M ë + D ė + K e = F. They hold on to a path that they have learned;
who finds the path while walking it needs a spring that is nearly none: with D² ≫ 4 M K
the displacement follows ė = F/D for some twenty seconds, an integral of the force, and
what pulls sideways for longer is nulled instead of balanced. With the robot's servo of
2000 N/m the loop closes at 2000/D = 20 rad/s, whose margin of delay is 80 ms.
"""

from typing import Any, Final

import numpy as np
from jaxtyping import Float

from gplfd_env.conventions.constants import CONTROL_PERIOD
from gplfd_env.spatial.se3 import compose_rotvecs
from gplfd_policies.control.admittance import Admittance
from gplfd_policies.control.steps import AgentStep
from gplfd_policies.control.stiffness import VirtualDynamics

_STIFFNESS: Final = np.repeat([5.0, 0.5], 3)
"""K [N/m, N m/rad]."""
_DYNAMICS: Final = VirtualDynamics(mass=np.repeat([1.0, 0.1], 3), damping_ratio=22.4)
"""M, and δ, which makes D = 2 δ √(M K) 100 N s/m and 10 N m s/rad."""


class Yielding:
    """Set-points that forces displace."""

    def __init__(self) -> None:
        self._admittance = Admittance(_DYNAMICS)

    def reset(self) -> None:
        """Come to rest, not displaced."""
        self._admittance.reset()

    def step(
        self,
        desired: Float[np.ndarray, " 6"],
        wrench: Float[np.ndarray, " 6"],
        **known: Any,
    ) -> AgentStep:
        """Return the step that commands a pose, displaced by a wrench.

        Args:
            desired: The pose [m, rad].
            wrench: What to yield to, task frame [N, N m].
            known: Further fields of the step.
        """
        offset = self._admittance.step(_STIFFNESS, wrench, CONTROL_PERIOD)
        action = desired + offset
        action[3:] = compose_rotvecs(offset[3:], desired[3:])
        return AgentStep(action=action, desired=desired, stiffness=_STIFFNESS, **known)
