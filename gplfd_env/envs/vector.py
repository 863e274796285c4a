"""Vector environments on `mujoco.batch.Batch`, as made by ``gym.make_vec``."""

from collections.abc import Mapping, Sequence
from operator import attrgetter
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium.utils.seeding import np_random
from gymnasium.vector import AutoresetMode
from gymnasium.vector.utils import batch_space

from gplfd_env.conventions.constants import (
    CONTROL_PERIOD,
    Array,
    Base,
    Info,
    Mask,
    Start,
)
from gplfd_env.conventions.resets import Seeds, each_seed, masked, unmasked
from gplfd_env.doors.config import DoorSpec
from gplfd_env.doors.disturbance import DisturbanceSpec
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.randomization import RandomizationSpec
from gplfd_env.doors.variation import Variation
from gplfd_env.envs.camera import Camera
from gplfd_env.envs.sources import Sources, commanded_robot
from gplfd_env.robot.model import Grasp
from gplfd_env.robot.placement import door_geometry
from gplfd_env.robot.robots import RobotSpec
from gplfd_env.simulation.batch import DoorBatch, SameStructureBatch
from gplfd_env.simulation.command import COMMANDS, DRIVEN, GRIPPING
from gplfd_env.task.episode import REWARDS, Episode, Episodes, Reward
from gplfd_env.task.observation import Observation, observation_space
from gplfd_env.validation.fields import Range, check_choice, checked_count


class DoorOpeningVectorEnv(gym.vector.VectorEnv[Observation, Array, Any]):
    """n simulations of `~gplfd_env.envs.door_opening.DoorOpeningEnv` on threads.

    Every simulation has its own door, random generator and episode. It equals the
    single environment with the same seed bit for bit, on any number of threads.
    Observations and infos are stacked along the first axis, with Gymnasium's ``"_key"``
    masks in infos. If a simulation diverges, only this simulation is truncated.

    Args:
        num_envs: Number of simulations n.
        door: As for the single environment, or a sequence of n of these; likewise
            `randomization` and `disturbance`. Arguments that the single environment has
            mean the same.
        render_mode: None or ``"rgb_array"``.
        max_episode_steps: Control periods after which an episode is truncated; None or
            -1 for no limit.
        autoreset_mode: ``"NextStep"`` (the step after an episode's end resets it),
            ``"SameStep"`` (its last observation and info are in ``final_obs`` and
            ``final_info``) or ``"Disabled"`` (ended simulations stand still, at no
            cost, until ``reset(options={"reset_mask": ...})``).
        num_threads: Threads that step the simulations; 0 for one per core.

    Raises:
        ValueError: As the single environment, and for an unknown autoreset mode.
    """

    command = COMMANDS["pose"]
    """Meaning of an action."""

    physics: type[SameStructureBatch] = SameStructureBatch
    """Class that steps simulations with doors of equal structure."""

    def __init__(
        self,
        num_envs: int = 1,
        door: DoorSpec | Sequence[DoorSpec] = "medium",
        *,
        grasp: Grasp = "contact",
        randomization: RandomizationSpec | Sequence[RandomizationSpec] = "none",
        disturbance: DisturbanceSpec | Sequence[DisturbanceSpec] = "none",
        reward: Reward = "dense",
        robot: RobotSpec = "tiago-like",
        base: Base | None = None,
        start: Start = "grasped",
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera_name: str = "overview",
        effects: bool = False,
        max_episode_steps: int | None = None,
        autoreset_mode: str | AutoresetMode = AutoresetMode.NEXT_STEP,
        num_threads: int = 0,
    ) -> None:
        check_choice("reward", reward, REWARDS)
        check_choice("render_mode", render_mode, (None, "rgb_array"))
        checked_count("num_envs", num_envs, Range(low=1, high=100_000))
        checked_count("num_threads", num_threads, Range(low=0, high=1024))
        self._limit = np.inf
        if max_episode_steps not in (None, -1):
            steps = Range(low=1, high=1e9)
            self._limit = checked_count("max_episode_steps", max_episode_steps, steps)
        mode = getattr(autoreset_mode, "value", autoreset_mode)
        check_choice("autoreset_mode", mode, [other.value for other in AutoresetMode])
        self.render_mode, self._reward = render_mode, reward
        self.num_envs = n = int(num_envs)
        self.autoreset_mode = AutoresetMode(mode)
        modes, rate = ["rgb_array"], round(1 / CONTROL_PERIOD)
        self.metadata = {"render_modes": modes, "render_fps": rate}
        self.metadata["autoreset_mode"] = self.autoreset_mode
        self._robot = commanded_robot(self.command, robot, base, grasp, start)
        specs = door, randomization, disturbance
        self._sources = Sources.of(n, self._robot.config, start, specs)
        observed = observation_space(self.command, self._robot.config)
        self.single_observation_space = observed
        self.single_action_space = self.command.space
        self.observation_space = batch_space(observed, n)
        self.action_space = batch_space(self.single_action_space, n)
        begin = [Variation(door=door) for door in self._sources.doors]
        self._batch = DoorBatch(self._robot, begin, num_threads, self.physics)
        scene = self._batch.state_of(0).model
        self._camera = Camera(scene, width, height, camera_name, effects=effects)
        self._episodes: Episodes | None = None
        self._random: list[tuple[np.random.Generator, int]] = []
        self._everyone = np.ones(n, dtype=bool)
        self._ended = np.zeros(n, dtype=bool)
        self._sensed = self._batch.read(None)

    @property
    def variations(self) -> tuple[Variation, ...]:
        """Door and circumstances of every episode; none before the first reset."""
        return () if self._episodes is None else self._episodes.variations

    @property
    def door_geometries(self) -> tuple[DoorGeometry, ...]:
        """Hinges and handle axes of these doors in the task frames."""
        robot = self._robot.config
        return tuple(door_geometry(drawn, robot) for drawn in self.variations)

    @property
    def models(self) -> tuple[mujoco.MjModel, ...]:
        """Model of every simulation, live; a reset may change it to another door."""
        return self._batch.models

    @property
    def qpos(self) -> Array:
        """Joint positions (n, nq) [m, rad], a copy; fewer are padded with zeros."""
        return self._batch.read(None, of=attrgetter("qpos"))

    @property  # type: ignore[misc]
    def np_random(self) -> tuple[np.random.Generator, ...]:  # type: ignore[override]
        """The generators, one per simulation; none before the first reset."""
        return tuple(generator for generator, _ in self._random)

    @property
    def np_random_seed(self) -> tuple[int, ...]:  # type: ignore[override]
        """The seeds of these generators."""
        return tuple(seed for _, seed in self._random)

    def reset(
        self, *, seed: Seeds = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Close the doors, place the hands, and begin episodes.

        A seed s seeds simulation i with s + i; or one seed, or None, is given per
        simulation. Options are those of the single environment, or sequences of n, and
        ``"reset_mask"``, (n,) bool: only these simulations are reset, and the masks of
        the infos mark them. Raises a ValueError for an unknown option, or a door, seed
        or mask that does not fit.
        """
        seeds, first = enumerate(each_seed(seed, self.num_envs)), not self._random
        fresh = {row: np_random(x) for row, x in seeds if first or x is not None}
        begun = self._episodes is not None
        self._sources, rows = self._sources.changed(options, begun=begun)
        now, every = self._random, range(self.num_envs)
        self._random = [fresh[x] if x in fresh and rows[x] else now[x] for x in every]
        episodes = self._restart(rows)
        return episodes.observation(self._sensed), masked(episodes.info(), rows)

    def step(self, actions: Array) -> tuple[Observation, Array, Mask, Mask, Info]:
        """Command every hand for one control period by actions (n, ...).

        Actions of simulations that are being reset or stand still are ignored. Raises a
        ValueError if the shape is wrong or an action is not finite, and
        gymnasium.error.ResetNeeded before the first reset.
        """
        if self._episodes is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        resting = self._ended if np.count_nonzero(self._ended) else None
        shape = self.num_envs, *self.command.rest.shape
        commands = self.command.check(actions, shape, resting)
        if self._robot.config.base == "mobile":
            commands = self.command.clamped(commands)
        episodes, stepped = self._episodes, None if resting is None else ~resting
        inputs = episodes.prepare_step(commands, stepped)
        rows = None if stepped is None else np.flatnonzero(stepped).tolist()
        diverged = self._batch.advance(commands, rows, inputs)
        if diverged is not None:
            stepped = ~diverged if stepped is None else stepped & ~diverged
            rows = np.flatnonzero(stepped).tolist()
        self._sensed = self._batch.read(rows, self._sensed)
        episodes.advance(np.ascontiguousarray(self._sensed.T), stepped)
        if diverged is not None:
            episodes.mark_diverged(diverged)
        if self.autoreset_mode is AutoresetMode.NEXT_STEP and resting is not None:
            self._restart(resting)
        outcome = map(np.asarray, episodes.outcome(self._limit))
        rewards, terminations, truncations = outcome
        self._ended = terminations | truncations
        infos = masked(episodes.info(), self._everyone)
        if self.autoreset_mode is AutoresetMode.SAME_STEP and self._ended.any():
            infos = self._reset_at_once(episodes, infos)
        observations = episodes.observation(self._sensed)
        return observations, rewards, terminations, truncations, infos

    def render(self) -> tuple[Any, ...] | None:
        """Return a picture of every simulation, each (height, width, 3) uint8."""
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make_vec(..., render_mode="rgb_array")')
            return None
        states = map(self._batch.state_of, range(self.num_envs))
        return tuple(self._camera.picture("rgb_array", state) for state in states)

    def close_extras(self, **kwargs: Any) -> None:
        """Free the renderer; a later picture creates another."""
        self._camera.close()

    def _restart(self, rows: Mask) -> Episodes:
        """Draw and begin new episodes for some simulations."""
        chosen = np.flatnonzero(rows).tolist()
        drawn = {row: self._sources.draw(row, self._random[row][0]) for row in chosen}
        for row in chosen:
            self._batch.load(row, drawn[row].variation)
        self._batch.restart(chosen)
        self._sensed = self._batch.read(chosen, self._sensed)
        reward, values = self._reward, self._sensed
        begun = {
            row: Episode.begin(x, self._robot, reward, values[row].tolist())
            for row, x in drawn.items()
        }
        if self._episodes is None:
            self._episodes = Episodes(list(begun.values()))
        else:
            self._episodes.replace(begun)
        self._ended = self._ended & ~rows
        return self._episodes

    def _reset_at_once(self, episodes: Episodes, infos: Info) -> Info:
        """Reset simulations in the step in which they ended; return its infos."""
        ended = self._ended
        last = episodes.observation(self._sensed)
        final_obs = np.full(self.num_envs, None, dtype=object)
        for row in np.flatnonzero(ended):
            final_obs[row] = {name: last[name][row].copy() for name in last}
        final_info = masked(unmasked(infos), ended)
        self._restart(ended)
        final = {"final_obs": final_obs, "final_info": final_info}
        new = masked(episodes.info(), self._everyone)
        return new | masked(final, ended)


class DoorOpeningImpedanceVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `gplfd_env.envs.door_opening.DoorOpeningImpedanceEnv`."""

    command = COMMANDS["impedance"]


class DoorOpeningMobileVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `gplfd_env.envs.door_opening.DoorOpeningMobileEnv`."""

    command = DRIVEN

    def __init__(self, num_envs: int = 1, *args: Any, **arguments: Any) -> None:
        check_choice("base", arguments.setdefault("base", "mobile"), ("mobile",))
        super().__init__(num_envs, *args, **arguments)


class DoorOpeningGripperVectorEnv(DoorOpeningVectorEnv):
    """n simulations of `gplfd_env.envs.door_opening.DoorOpeningGripperEnv`."""

    command = GRIPPING
