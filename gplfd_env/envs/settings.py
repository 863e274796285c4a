"""Settings of environments, and the sources from which episodes are drawn."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import KW_ONLY, dataclass, replace
from typing import Any, ClassVar, Final, get_args

import mujoco
import numpy as np
from gymnasium.vector import AutoresetMode

from gplfd_env.conventions.constants import Base, Mask, Start
from gplfd_env.conventions.resets import checked_options, chosen_rows, each
from gplfd_env.doors.config import DoorConfig, DoorSpec, door_config
from gplfd_env.doors.disturbance import DisturbanceSpec, disturbance_named
from gplfd_env.doors.randomization import RandomizationSpec, door_randomization
from gplfd_env.envs.camera import Camera, require_display
from gplfd_env.robot.config import RobotConfig
from gplfd_env.robot.model import Grasp, Hold
from gplfd_env.robot.robots import RobotSpec, robot_named
from gplfd_env.robot.stance import ABOUT_A_HINGE, check_reach
from gplfd_env.simulation.command import Command
from gplfd_env.simulation.single import Robot
from gplfd_env.task.draw import SampledEpisode, draw_episode
from gplfd_env.task.episode import REWARDS, Reward
from gplfd_env.validation.fields import Range, check_choice, checked_count


@dataclass(frozen=True, kw_only=True)
class Common:
    """Settings that single and vector environments share.

    Raises:
        ValueError: An unknown or impossible value.
    """

    grasp: Grasp = "contact"
    """``"contact"`` (friction between pads and bar) or ``"weld"``."""
    randomization: RandomizationSpec | Sequence[RandomizationSpec] = "none"
    """What every reset draws anew: ``"none"``, ``"mild"``, ``"hard"``, a mapping of
    `DoorRandomization` fields, or a `DoorRandomization`; for n doors also a sequence
    of n of these."""
    disturbance: DisturbanceSpec | Sequence[DisturbanceSpec] = "none"
    """External events: ``"none"``, ``"push"``, ``"person"``, ``"stop"``, ...
    (`gplfd_env.doors.disturbance.DISTURBANCES`), a mapping of `Disturbance` fields, or
    a `Disturbance`; for n doors also a sequence of n of these."""
    reward: Reward = "dense"
    """``"dense"`` or ``"sparse"`` (1 on success, else 0)."""
    robot: RobotSpec = "tiago-like"
    """``"tiago-like"``, ``"panda-like"``, ``"ur5e-like"``, the path of a .json with the
    arguments of `gplfd_env.robot.urdf.robot_of_urdf`, or a `RobotConfig`."""
    base: Base | None = None
    """``"fixed"``, or ``"mobile"``: the base follows the hand
    (`gplfd_env.robot.whole_body`) and collides with door and walls. None for the base
    of the robot's configuration, which is ``"fixed"`` for the named robots."""
    start: Start = "grasped"
    """``"grasped"``, or ``"approach"``: the episode begins with the open hand 10 to
    20 cm in front of the handle. If actions do not command the gripper, it closes when
    the hand is at the handle or, if the handle's position is uncertain, when the hand
    rests near it (`gplfd_env.robot.gripper`)."""
    render_mode: str | None = None
    """None, ``"human"``, ``"rgb_array"``, ``"depth_array"`` or ``"rgbd_tuple"``; for n
    doors None or ``"rgb_array"``."""
    width: int = 640
    """Width of rendered pictures [px]."""
    height: int = 480
    """Height of rendered pictures [px]."""
    camera_name: str = "overview"
    """``"overview"``, ``"top"``, ``"head"`` or ``"hand_camera"``."""
    effects: bool = False
    """Shadows, reflections and smooth edges in pictures; windows always have them.
    Without a graphics card a picture takes ten times as long."""

    render_modes: ClassVar[tuple[str, ...]]

    def __post_init__(self) -> None:
        check_choice("grasp", self.grasp, get_args(Grasp))
        check_choice("reward", self.reward, REWARDS)
        if self.base is not None:
            check_choice("base", self.base, get_args(Base))
        check_choice("start", self.start, get_args(Start))
        check_choice("render_mode", self.render_mode, (None, *self.render_modes))
        if self.render_mode == "human":
            require_display()

    @property
    def robot_config(self) -> RobotConfig:
        """Configuration of the robot with the chosen base."""
        config = robot_named(self.robot)
        return config if self.base is None else config.on(self.base)

    def commanded(self, command: Command) -> Robot:
        """Return the robot with its grasp and the kind of command.

        Raises a ValueError for a weld if the hand does not hold the handle yet.
        """
        fingers_move = command.grips or self.start == "approach"
        if fingers_move and self.grasp == "weld":
            cause = "a commanded gripper" if command.grips else 'start="approach"'
            raise ValueError(
                f'grasp="weld" does not go with {cause}: the joint would hold the '
                'handle without the fingers; leave it at grasp="contact"'
            )
        hold: Hold = "gripper" if fingers_move else self.grasp
        return Robot(hold, command, self.robot_config)

    def camera(self, model: mujoco.MjModel) -> Camera:
        """Return a camera for a model; raise a ValueError if that is impossible."""
        return Camera(
            model, self.width, self.height, self.camera_name, effects=self.effects
        )


@dataclass(frozen=True)
class Settings(Common):
    """Settings of an environment with one door."""

    door: DoorSpec = "medium"
    """Name of a preset, radius [m], mapping of `DoorConfig` fields, or `DoorConfig`;
    see `gplfd_env.doors.config.door_config`."""

    render_modes = ("human", "rgb_array", "depth_array", "rgbd_tuple")


@dataclass(frozen=True)
class VectorSettings(Common):
    """Settings of an environment with n doors."""

    num_envs: int = 1
    """Number of simulations n."""
    door: DoorSpec | Sequence[DoorSpec] = "medium"
    """As for the single environment, or a sequence of n of these."""
    _: KW_ONLY
    max_episode_steps: int | None = None
    """Control periods after which an episode is truncated; None or -1 for no limit."""
    autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP
    """``"NextStep"`` (the step after an episode's end resets it), ``"SameStep"`` (its
    last observation and info are in ``final_obs`` and ``final_info``) or ``"Disabled"``
    (ended simulations stand still, at no cost, until
    ``reset(options={"reset_mask": ...})``)."""
    num_threads: int = 0
    """Threads that step the simulations; 0 for one per core."""

    render_modes = ("rgb_array",)

    def __post_init__(self) -> None:
        super().__post_init__()
        checked_count("num_envs", self.num_envs, Range(low=1))
        checked_count("num_threads", self.num_threads, Range(low=0))
        if self.max_episode_steps not in (None, -1):
            checked_count("max_episode_steps", self.max_episode_steps, Range(low=1))
        mode = getattr(self.autoreset_mode, "value", self.autoreset_mode)
        check_choice(
            "autoreset_mode", mode, [allowed.value for allowed in AutoresetMode]
        )

    @property
    def limit(self) -> float:
        """Control periods after which an episode is truncated, possibly infinite."""
        steps = self.max_episode_steps
        return np.inf if steps is None or steps == -1 else steps


_RESOLVERS: Final[Mapping[str, tuple[Callable[[Any], Any], str]]] = {
    "door": (door_config, "name, radius, mapping or DoorConfig"),
    "randomization": (door_randomization, "name, mapping or DoorRandomization"),
    "disturbance": (disturbance_named, "name, mapping or Disturbance"),
}
"""What episodes are drawn from: functions that resolve it, and values for messages."""


@dataclass(frozen=True, kw_only=True)
class Sources:
    """A door, a randomization and a disturbance for each of n simulations.

    Raises a ValueError for a door that the robot with this base and start cannot reach,
    or a randomization that does not suit the start.
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
            check_reach(randomization.outermost(door), self.robot, self.start)
        for door, disturbance in zip(doors, disturbances, strict=True):
            if not (disturbance.idle or door.motion in ABOUT_A_HINGE):
                raise ValueError(
                    f"no disturbance of a door with motion = {door.motion!r}: forces "
                    "and stops are defined for a leaf that turns about an upright "
                    f"hinge ({', '.join(ABOUT_A_HINGE)})"
                )

    @classmethod
    def of(cls, settings: Settings | VectorSettings) -> "Sources":
        """Return the sources that the settings name, or raise a ValueError."""
        n = settings.num_envs if isinstance(settings, VectorSettings) else None
        values = {
            name: each(name, getattr(settings, name), n, resolve)
            for name, (resolve, _) in _RESOLVERS.items()
        }
        return cls(
            n=n, robot=settings.robot_config, start=settings.start, values=values
        )

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
        door, randomization, disturbance = (
            of_name[row] for of_name in self.values.values()
        )
        return draw_episode(door, randomization, disturbance, random, self.start)
