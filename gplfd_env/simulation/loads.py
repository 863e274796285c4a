"""External loads on the bodies of a simulation during one control period."""

from typing import NamedTuple

Vector = tuple[float, float, float]


class Loads(NamedTuple):
    """What acts on the bodies of a simulation during a control period.

    Forces on gripper and forearm, world frame [N], torque on the leaf about the upward
    axis [N m], and the hinge's stop [rad] and Coulomb friction [N m].
    """

    hand: Vector
    forearm: Vector
    hinge: float
    stop: float
    friction: float

    @property
    def wrenches(self) -> tuple[tuple[float, ...], ...]:
        """Force and torque on gripper, forearm and leaf, world frame [N, N m]."""
        still = (0.0, 0.0, 0.0)
        return (
            (*self.hand, *still),
            (*self.forearm, *still),
            (*still, 0.0, 0.0, self.hinge),
        )
