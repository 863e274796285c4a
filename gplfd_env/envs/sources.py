"""What the arguments of environments mean: the robot, and the sources of episodes."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, Final, get_args

import numpy as np

from gplfd_env.conventions.constants import Base, Mask, Start
from gplfd_env.conventions.resets import checked_options, chosen_rows, each
from gplfd_env.doors.config import MOTIONS, DoorConfig, door_config
from gplfd_env.doors.disturbance import disturbance_named
from gplfd_env.doors.randomization import door_randomization
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.model import Grasp
from gplfd_env.robot.placement import check_reach
from gplfd_env.robot.robots import RobotSpec, robot_named
from gplfd_env.simulation.command import Command
from gplfd_env.simulation.single import Robot
from gplfd_env.task.draw import SampledEpisode, draw_episode
from gplfd_env.validation.fields import check_choice


def commanded_robot(
    command: Command, robot: RobotSpec, base: Base | None, grasp: Grasp, start: Start
) -> Robot:
    """Return the robot that arguments of an environment describe, or refuse them."""
    check_choice("grasp", grasp, get_args(Grasp))
    check_choice("start", start, get_args(Start))
    config = robot_named(robot)
    if base is not None:
        check_choice("base", base, get_args(Base))
        config = config.on(base)
    if not (command.grips or start == "approach"):
        return Robot(grasp, command, config)
    if grasp == "weld":
        cause = "a commanded gripper" if command.grips else 'start="approach"'
        raise ValueError(
            f'grasp="weld" does not go with {cause}: the joint would hold the handle; '
            'leave it at grasp="contact"'
        )
    return Robot("gripper", command, config)


# What episodes are drawn from: functions that resolve it, and values for messages.
_RESOLVERS: Final[Mapping[str, tuple[Callable[[Any], Any], str]]] = {
    "door": (door_config, "name, radius, mapping or DoorConfig"),
    "randomization": (door_randomization, "name, mapping or DoorRandomization"),
    "disturbance": (disturbance_named, "name, mapping or Disturbance"),
}


@dataclass(frozen=True, kw_only=True)
class Sources:
    """A door, a randomization and a disturbance for each of n simulations.

    Raises a ValueError for what the robot cannot reach, or does not suit the start.
    """

    n: int | None
    """None for a single environment, which does not accept sequences."""
    robot: RobotConfig
    start: Start
    values: Mapping[str, list[Any]]
    """A value per simulation for each key of `_RESOLVERS`, before anything is drawn."""

    def __post_init__(self) -> None:
        doors, randomizations, disturbances = self.values.values()
        for door, randomization in set(zip(doors, randomizations, strict=True)):
            randomization.check_start(self.start)
            for outermost in randomization.outermost(door):
                check_reach(outermost, self.robot, self.start)
        for door, disturbance in zip(doors, disturbances, strict=True):
            if not (disturbance.idle or MOTIONS[door.motion].upright_hinge):
                upright = (name for name in MOTIONS if MOTIONS[name].upright_hinge)
                raise ValueError(
                    f"no disturbance of a door with motion = {door.motion!r}: only of "
                    f"an upright hinge ({', '.join(upright)})"
                )

    @classmethod
    def of(
        cls, n: int | None, robot: RobotConfig, start: Start, specs: Sequence[Any]
    ) -> "Sources":
        """Return the sources for a value, or n values, of each key of `_RESOLVERS`."""
        pairs = zip(_RESOLVERS.items(), specs, strict=True)
        values = {name: each(name, x, n, resolve) for (name, (resolve, _)), x in pairs}
        return cls(n=n, robot=robot, start=start, values=values)

    @property
    def doors(self) -> list[DoorConfig]:
        """The doors, before anything is drawn."""
        return self.values["door"]

    def changed(
        self, options: Mapping[str, Any] | None, *, begun: bool = True
    ) -> tuple["Sources", Mask]:
        """Return the sources after the options of a reset, and the reset's mask."""
        allowed = {name: meaning for name, (_, meaning) in _RESOLVERS.items()}
        if self.n is not None:
            same = "as for the single environment, or a sequence of num_envs"
            allowed = dict.fromkeys(_RESOLVERS, same)
            allowed["reset_mask"] = "an array of num_envs booleans"
        changes = checked_options(options, allowed)
        mask = changes.pop("reset_mask", None)
        rows = chosen_rows(mask, len(self.doors), begun=begun)
        values = dict(self.values)
        for name, value in changes.items():
            after = each(name, value, self.n, _RESOLVERS[name][0])
            pairs = zip(rows, after, values[name], strict=True)
            values[name] = [new if reset else old for reset, new, old in pairs]
        return replace(self, values=values), rows

    def draw(self, row: int, random: np.random.Generator) -> SampledEpisode:
        """Draw an episode of a simulation."""
        door, randomization, disturbance = (x[row] for x in self.values.values())
        return draw_episode(door, randomization, disturbance, random, self.start)
