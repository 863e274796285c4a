"""Single environments: ``gplfd/DoorOpening-v1`` and variants with other commands."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces

from gplfd_env.conventions.constants import CONTROL_PERIOD, Array, Base, Info, Start
from gplfd_env.doors.config import DoorConfig, DoorSpec
from gplfd_env.doors.disturbance import DisturbanceSpec
from gplfd_env.doors.geometry import DoorGeometry
from gplfd_env.doors.randomization import RandomizationSpec
from gplfd_env.doors.variation import Variation
from gplfd_env.envs.camera import Camera, require_display
from gplfd_env.envs.sources import Sources, commanded_robot
from gplfd_env.robot.model import Grasp
from gplfd_env.robot.placement import door_geometry
from gplfd_env.robot.robots import RobotSpec
from gplfd_env.simulation.command import COMMANDS, DRIVEN, GRIPPING
from gplfd_env.simulation.single import DoorSimulation
from gplfd_env.task.episode import REWARDS, Episode, Reward
from gplfd_env.task.observation import Observation, observation_space
from gplfd_env.validation.fields import check_choice


class DoorOpeningEnv(gym.Env[Observation, Array]):
    """A robot arm, by default TIAGo-like, that opens a door.

    Action, (6,): the commanded pose of the hand in the task frame, position [m] and
    rotation vector [rad] relative to the closed grasp. A stiff Cartesian servo
    (2000 N/m, 100 N m/rad) inside MuJoCo follows it within the joint effort limits.

    Observation (dict): ``ee_pose`` (6,) [m, rad], ``ee_twist`` (6,) [m/s, rad/s],
    ``wrench`` (6,) [N, N m] on the hand, all in the task frame; ``joint_pos`` (7,)
    [rad], ``joint_vel`` (7,) [rad/s], ``time`` (1,) [s]. `gplfd_env.task.info.INFO`
    lists keys, units and meanings of the info, which has no sensor noise.

    The episode terminates in success (60° held for 0.5 s, handle grasped) or when
    the grasp is lost, and is truncated by the time limit or a diverged simulation.

    Args:
        door: A preset's name, a radius [m], a mapping of `DoorConfig` fields, or a
            `DoorConfig`.
        grasp: ``"contact"`` (friction between pads and bar) or ``"weld"``.
        randomization: What every reset draws anew: a name of
            `gplfd_env.doors.randomization.RANDOMIZATIONS`, a mapping of
            `DoorRandomization` fields, or a `DoorRandomization`.
        disturbance: External events: a name of
            `gplfd_env.doors.disturbance.DISTURBANCES`, a mapping of `Disturbance`
            fields, or a `Disturbance`.
        reward: ``"dense"`` or ``"sparse"`` (1 on success, else 0).
        robot: ``"tiago-like"``, ``"panda-like"``, ``"ur5e-like"``, the path of the
            URDF of an arm or of a .json with the arguments of
            `gplfd_env.robot.urdf.robot_of_urdf`, or a `RobotConfig`.
        base: ``"fixed"``, or ``"mobile"``: the base follows the hand
            (`gplfd_env.robot.whole_body`) and collides with door and walls. None for
            the base of the robot's configuration, ``"fixed"`` for the named robots.
        start: ``"grasped"``, or ``"approach"``: the open hand begins 10 to 20 cm in
            front of the handle. A gripper that actions do not command closes at the
            handle (`gplfd_env.robot.gripper`).
        render_mode: None, ``"human"``, ``"rgb_array"``, ``"depth_array"`` or
            ``"rgbd_tuple"``.
        width: Width of rendered images [px].
        height: Height of rendered images [px].
        camera_name: ``"overview"``, ``"top"``, ``"head"`` or ``"hand_camera"``.
        effects: Shadows, reflections and smooth edges in images; windows always have
            them. Without a graphics card an image takes ten times as long.

    Raises:
        ValueError: An unknown name, a number out of range, or choices that do not go
            together.
        RuntimeError: ``render_mode="human"`` without a display.
    """

    metadata = {  # noqa: RUF012 - Gymnasium declares it as an instance variable
        "render_modes": ["human", "rgb_array", "depth_array", "rgbd_tuple"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }
    command = COMMANDS["pose"]
    """Meaning of an action."""

    def __init__(
        self,
        door: DoorSpec = "medium",
        *,
        grasp: Grasp = "contact",
        randomization: RandomizationSpec = "none",
        disturbance: DisturbanceSpec = "none",
        reward: Reward = "dense",
        robot: RobotSpec = "tiago-like",
        base: Base | None = None,
        start: Start = "grasped",
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera_name: str = "overview",
        effects: bool = False,
    ) -> None:
        check_choice("reward", reward, REWARDS)
        modes = self.metadata["render_modes"]
        check_choice("render_mode", render_mode, (None, *modes))
        if render_mode == "human":
            require_display()
        self.render_mode, self._reward = render_mode, reward
        self._robot = commanded_robot(self.command, robot, base, grasp, start)
        specs = door, randomization, disturbance
        self._sources = Sources.of(None, self._robot.config, start, specs)
        (config,) = self._sources.doors
        self._simulation = DoorSimulation(self._robot, Variation(door=config))
        self._camera = Camera(self.model, width, height, camera_name, effects=effects)
        self._sensed = np.empty(0)
        self._episode: Episode | None = None
        self.observation_space = observation_space(self.command, self._robot.config)
        self.action_space: spaces.Space[Any] = self.command.space

    @property
    def model(self) -> mujoco.MjModel:
        """Model of the scene; a door of another structure has another object."""
        return self._simulation.model

    @property
    def data(self) -> mujoco.MjData:
        """State of the scene; the same object as long as `model` is."""
        return self._simulation.data

    @property
    def variation(self) -> Variation:
        """The door and the circumstances of this episode."""
        return self._simulation.variation

    @property
    def door(self) -> DoorConfig:
        """The door of this episode."""
        return self.variation.door

    @property
    def door_geometry(self) -> DoorGeometry:
        """Hinge and handle axis of this door in the task frame."""
        return door_geometry(self.variation, self._robot.config)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return CONTROL_PERIOD

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Close the door, place the hand at or in front of the handle, and start.

        The options ``"door"``, ``"randomization"`` and ``"disturbance"`` hold from this
        episode on. Raises a ValueError for an unknown option or value, or a drawn
        placement from which the arm cannot reach its initial posture; the next reset
        draws a new one.
        """
        sources, _ = self._sources.changed(options)
        super().reset(seed=seed)
        self._sources = sources
        drawn = sources.draw(0, self.np_random)
        self._simulation.restart(drawn.variation)
        begun = drawn, self._robot, self._reward, self._sense()
        self._episode = episode = Episode.begin(*begun)
        if self.render_mode == "human":
            self.render()
        return episode.observation(self._sensed), episode.info()

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, Info]:
        """Apply a command for one control period.

        The action is as the class states, and clamped to its space. Raises a ValueError
        if its shape is wrong or it is not finite, and gymnasium.error.ResetNeeded
        before the first reset.
        """
        episode = self._episode
        if episode is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        command = self.command.check(action, self.command.rest.shape)
        if self._robot.config.base == "mobile":
            # MuJoCo clamps commands of the servo, but the base follows them, too.
            command = self.command.clamped(command)
        inputs = episode.prepare_step(command[None])
        if self._simulation.advance(command, inputs):
            episode.mark_diverged()
        else:
            episode.advance(self._sense())
        if self.render_mode == "human":
            self.render()
        reward, ended, diverged = episode.outcome()
        outcome = float(reward), bool(ended), bool(diverged)
        return episode.observation(self._sensed), *outcome, episode.info()

    def render(self) -> Any:
        """Return a picture of the scene, or draw it in a window (``"human"``).

        ``"rgb_array"``: (height, width, 3) uint8; ``"depth_array"``: (height, width)
        float32, distance from the camera's plane [m]; ``"rgbd_tuple"``: both. Raises a
        RuntimeError if OpenGL is not available.
        """
        if self.render_mode is None:
            gym.logger.warn('render() needs gym.make(..., render_mode="rgb_array")')
            return None
        return self._camera.picture(self.render_mode, self.data)

    def close(self) -> None:
        """Free the renderer; may be called more than once."""
        self._camera.close()

    def _sense(self) -> list[float]:
        """Read the sensors; after a divergence the last good values remain."""
        self._sensed = self._simulation.sensordata.copy()
        values: list[float] = self._sensed.tolist()
        return values


class DoorOpeningImpedanceEnv(DoorOpeningEnv):
    """The same door, opened by commanding the hand's pose and its stiffness.

    Action, (12,): the pose, then its stiffness on these six axes, 20 to 2000 N/m and 1
    to 100 N m/rad. Six servos inside MuJoCo realise it; their gains are set once per
    control period: force k_i (command - pose)_i - d_i velocity_i with a constant
    damping ratio. Everything else is as in `DoorOpeningEnv`.
    """

    command = COMMANDS["impedance"]


class DoorOpeningMobileEnv(DoorOpeningEnv):
    """The same door, opened by commanding the hand's pose and the base's twist.

    Action, (9,): the pose, then the twist of the base in its own axes: forward, to the
    left [m/s] and turning to the left [rad/s], within the limits of its drive. The
    observation also contains ``base_pose`` and ``base_velocity``. Everything else is as
    in `DoorOpeningEnv` with ``base="mobile"``.
    """

    command = DRIVEN

    def __init__(self, door: DoorSpec = "medium", **arguments: Any) -> None:
        check_choice("base", arguments.setdefault("base", "mobile"), ("mobile",))
        super().__init__(door, **arguments)


class DoorOpeningGripperEnv(DoorOpeningEnv):
    """The same door, opened by commanding the hand's pose and its gripper.

    Action, (7,): the pose, then the width between the fingers, from 0 (closed with full
    force) to 0.09 m. A width larger than the handle releases it; the fingers may grasp
    it again. The observation also contains ``gripper_width`` (1,) [m] and ``grasped``
    (1,): 1 if both fingers touch the handle, else 0. Everything else is as in
    `DoorOpeningEnv`.
    """

    command = GRIPPING
