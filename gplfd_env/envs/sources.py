"""What the episodes of many simulations are drawn from."""

from collections.abc import Callable, Mapping
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

from gplfd_env.conventions.constants import Base, Start
from gplfd_env.conventions.resets import checked_options, chosen_rows, each
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.doors.disturbance import disturbance_named
from gplfd_env.doors.randomization import door_randomization
from gplfd_env.robot.stance import check_reach
from gplfd_env.task.draw import Drawn, draw_episode

Mask = NDArray[np.bool_]

_RESOLVE: Final[Mapping[str, Callable[[Any], Any]]] = {
    "door": door_config,
    "randomization": door_randomization,
    "disturbance": disturbance_named,
}
"""By name, in the order of `draw_episode`."""


class Sources:
    """A door, a randomization and a disturbance for each of n simulations.

    Args:
        num_envs: n.
        base: Whose reach decides which doors there may be.
        start: What episodes begin with.
        given: By name, one for all or a sequence of n.

    Raises:
        ValueError: One that there is not, or a door that is out of reach.
    """

    def __init__(self, num_envs: int, base: Base, start: Start, **given: Any) -> None:
        self._num_envs, self._base, self._start = num_envs, base, start
        self._values = self._in_reach(
            {
                name: each(name, given[name], num_envs, resolve)
                for name, resolve in _RESOLVE.items()
            }
        )

    @property
    def doors(self) -> list[DoorConfig]:
        """The doors, before anything is drawn."""
        return list(self._values["door"])

    def take(self, options: Mapping[str, Any] | None, *, begun: bool) -> Mask:
        """Check all options of a reset, then keep them; return its mask.

        Args:
            options: As for `gplfd_env.envs.vector.DoorOpeningVectorEnv.reset`.
            begun: Whether there was a reset before.
        """
        given = checked_options(
            options,
            {
                name: "as for the single environment, or a sequence of num_envs"
                for name in _RESOLVE
            }
            | {"reset_mask": "an array of num_envs booleans"},
        )
        rows = chosen_rows(given.get("reset_mask"), self._num_envs, begun=begun)
        values = {name: list(each) for name, each in self._values.items()}
        for name, resolve in _RESOLVE.items():
            if name in given:
                new = each(name, given[name], self._num_envs, resolve)
                for row in np.flatnonzero(rows):
                    values[name][row] = new[row]
        self._values = self._in_reach(values)
        return rows

    def draw(self, row: int, random: np.random.Generator) -> Drawn:
        """Draw an episode of a simulation."""
        door, randomization, disturbance = (one[row] for one in self._values.values())
        return draw_episode(door, randomization, disturbance, random, self._start)

    def _in_reach(self, values: dict[str, list[Any]]) -> dict[str, list[Any]]:
        """Return what episodes are drawn from, all of which the robot can reach."""
        pairs = zip(values["door"], values["randomization"], strict=True)
        for door, randomization in set(pairs):
            check_reach(randomization.outermost(door), self._base, self._start)
        return values
