"""External loads, base rates and gripper widths during one control period."""

from collections.abc import Collection
from typing import Any, Final, NamedTuple

from gplfd_env.robot.whole_body import Planar

Vector = tuple[float, float, float]


class Loads(NamedTuple):
    """External loads on the bodies of a simulation."""

    hand: Vector  # Force on the gripper, world frame [N].
    forearm: Vector  # Force on the forearm, world frame [N].
    hinge: float  # Torque on the leaf about the upward axis [N m].
    stop: float  # Angle at which the leaf meets a stop [rad].
    friction: float  # Coulomb friction of the hinge [N m].

    @property
    def wrenches(self) -> tuple[tuple[float, ...], ...]:
        """Force and torque on gripper, forearm and leaf, world frame [N, N m]."""
        still = (0.0, 0.0, 0.0)
        return (
            (*self.hand, *still),
            (*self.forearm, *still),
            (*still, 0.0, 0.0, self.hinge),
        )


class ExtraInputs(NamedTuple):
    """Inputs of simulations besides the hands' commands, by row of the simulation."""

    loads: dict[int, Loads]  # External loads, of episodes with a disturbance.
    base_rates: dict[int, Planar]  # Commanded rates of mobile bases.
    gripper_widths: dict[int, float]  # Commanded widths of movable fingers [m].

    def of(self, rows: Collection[int]) -> "ExtraInputs":
        """Return the inputs of some simulations."""
        parts: Any = [
            {row: inputs[row] for row in rows if row in inputs} for inputs in self
        ]
        return ExtraInputs(*parts)


NO_EXTRA_INPUTS: Final = ExtraInputs({}, {}, {})
