"""``gplfd/DoorOpening-v0``: open a hinged door by commanding the hand's pose."""

from __future__ import annotations

import math
import os
import sys
from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
import mujoco
import numpy as np
from gymnasium import spaces
from gymnasium.envs.mujoco.mujoco_rendering import MujocoRenderer
from numpy.typing import NDArray

from gplfd_env.config import DoorSpec, door_config
from gplfd_env.observation import DoorReading, Observation, Reader, observation_space
from gplfd_env.robot import COMMAND_LIMITS, Grasp
from gplfd_env.scene import GRASP_KEY, build_scene
from gplfd_env.task import OpeningMonitor, reward_terms

Array = NDArray[np.float64]
Info = dict[str, Any]

CONTROL_PERIOD: Final = 0.01
"""Time between two actions [s]."""

_LARGEST_PICTURE: Final = 8192

_BAD_STATE: Final = slice(
    int(mujoco.mjtWarning.mjWARN_BADQPOS), int(mujoco.mjtWarning.mjWARN_BADQACC) + 1
)


class DoorOpeningEnv(gym.Env[Observation, Array]):
    """A TIAGo-like arm, its hand closed on the bar handle of a hinged door.

    Action, (6,): the commanded pose of the hand in the task frame, position [m] and
    rotation vector [rad] relative to the closed grasp. A stiff Cartesian servo
    (2000 N/m, 100 N m/rad) inside MuJoCo follows it; joint effort limits hold.

    Observation (dict): ``ee_pose`` (6,) [m, rad], ``ee_twist`` (6,) [m/s, rad/s],
    ``wrench`` (6,) [N, N m] on the hand, all in the task frame; ``joint_pos`` (7,)
    [rad], ``joint_vel`` (7,) [rad/s], ``time`` (1,) [s].

    Info, same keys at reset and step: ``door_angle`` [rad], ``door_velocity``
    [rad/s], ``door_radius`` [m], ``handle_pose`` (6,) [m, rad], ``success``,
    ``is_success``, ``grasped``, ``slip`` [m], ``force_tangential``,
    ``force_radial``, ``force_vertical`` [N, hand on handle], ``failure``,
    ``simulation_error``, ``reward_terms``.

    The episode terminates in success (60° held for 0.5 s, handle grasped) or when
    the grasp is lost, and is truncated by the time limit or a diverged simulation.

    Args:
        door: Preset's name, radius [m], mapping of `DoorConfig` fields, or a
            `DoorConfig`; see `gplfd_env.config.door_config`.
        grasp: ``"contact"`` (friction between pads and bar) or ``"weld"``.
        render_mode: None, ``"human"``, ``"rgb_array"`` or ``"depth_array"``.
        width: Width of rendered pictures [px].
        height: Height of rendered pictures [px].
        camera_name: ``"overview"``, ``"top"``, ``"head"`` or ``"hand_camera"``.

    Raises:
        ValueError: An unknown door, grasp, camera or render mode, a door out of range,
            or an impossible picture size.
        RuntimeError: ``render_mode="human"`` without a display.
    """

    metadata = {  # noqa: RUF012 - Gymnasium declares it as an instance variable
        "render_modes": ["human", "rgb_array", "depth_array"],
        "render_fps": round(1 / CONTROL_PERIOD),
    }

    def __init__(
        self,
        door: DoorSpec = "medium",
        *,
        grasp: Grasp = "contact",
        render_mode: str | None = None,
        width: int = 640,
        height: int = 480,
        camera_name: str = "overview",
    ) -> None:
        _check_choice("grasp", grasp, ("contact", "weld"))
        if render_mode is not None:
            _check_choice("render_mode", render_mode, self.metadata["render_modes"])
        if render_mode == "human":
            _require_display()
        _check_size(width, height)
        self.render_mode = render_mode
        self._grasp = grasp
        self._picture = (width, height, camera_name)
        self._renderer: MujocoRenderer | None = None
        self._load(door)
        cameras = [self.model.camera(i).name for i in range(self.model.ncam)]
        _check_choice("camera_name", camera_name, cameras)
        self.observation_space = observation_space()
        translation, rotation = COMMAND_LIMITS
        limits = np.repeat([translation, rotation], 3)
        self.action_space = spaces.Box(-limits, limits, dtype=np.float64)

    @property
    def dt(self) -> float:
        """Control period [s]."""
        return CONTROL_PERIOD

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Observation, Info]:
        """Close the door, put it into the hand, and begin an episode.

        Args:
            seed: Seeds ``self.np_random``.
            options: ``{"door": ...}`` changes the door from this episode on.

        Raises:
            ValueError: An unknown option or door.
        """
        super().reset(seed=seed)
        if options is not None and not isinstance(options, Mapping):
            raise ValueError(
                'options must be a mapping such as {"door": "small"}, got '
                f"{options!r}"
            )
        given = dict(options or {})
        door = given.pop("door", None)
        if given:
            raise ValueError(
                f"unknown reset option(s) {', '.join(map(repr, given))}; "
                'allowed: "door" (name, radius, mapping or DoorConfig)'
            )
        if door is not None and door_config(door) != self.door:
            self._load(door)
        mujoco.mj_resetDataKeyframe(self.model, self.data, GRASP_KEY)
        mujoco.mj_forward(self.model, self.data)
        self._steps = 0
        self._monitor = OpeningMonitor(CONTROL_PERIOD)
        self._reading = self._reader.door(self.data.sensordata)
        self._grasp_point = self._reading.hand_on_handle
        self._observation = self._reader.observation(self.data.sensordata, 0.0)
        if self.render_mode == "human":
            self.render()
        terms = reward_terms(0.0, 0.0, False)
        return _copy(self._observation), self._info(terms, simulation_error=False)

    def step(self, action: Array) -> tuple[Observation, float, bool, bool, Info]:
        """Command a hand pose for one control period.

        Args:
            action: (6,) position [m] and rotation vector [rad] in the task frame;
                values beyond the action space are clamped to it.

        Raises:
            ValueError: The action's shape is not (6,) or it is not finite.
        """
        self.data.ctrl[:6] = _checked(action)
        mujoco.mj_step(self.model, self.data, nstep=self._substeps)
        self._steps += 1
        if self._divergence_warnings.any():
            terms = reward_terms(0.0, 0.0, False)
            info = self._info(terms, simulation_error=True)
            return _copy(self._observation), 0.0, False, True, info
        sensordata = self.data.sensordata
        before, reading = self._reading.angle, self._reader.door(sensordata)
        self._reading = reading
        self._monitor.update(reading.angle, reading.grasped)
        success = self._monitor.success
        terms = reward_terms(reading.angle - before, reading.force_radial, success)
        time = self._steps * CONTROL_PERIOD
        self._observation = self._reader.observation(sensordata, time)
        if self.render_mode == "human":
            self.render()
        terminated = success or self._monitor.failure == "grasp_lost"
        info = self._info(terms, simulation_error=False)
        observation = _copy(self._observation)
        return observation, sum(terms.values()), terminated, False, info

    def render(self) -> Array | None:
        """Return a picture of the scene, or draw it in a window (``"human"``)."""
        if self.render_mode is None:
            gym.logger.warn(
                "render() was called on an environment made without a render_mode; "
                'use gym.make(..., render_mode="rgb_array")'
            )
            return None
        if self._renderer is None:
            width, height, camera = self._picture
            self._renderer = MujocoRenderer(
                self.model, self.data, None, width, height, camera_name=camera
            )
        picture: Array | None = self._renderer.render(self.render_mode)
        return picture

    def close(self) -> None:
        """Free the renderer; may be called more than once."""
        if self._renderer is not None:
            self._renderer.close()  # type: ignore[no-untyped-call]
            self._renderer = None

    def _load(self, door: DoorSpec) -> None:
        config = door_config(door)
        self.model = build_scene(config, self._grasp)
        self.door = config
        self.close()
        self.data = mujoco.MjData(self.model)
        self._reader = Reader.of(self.model)
        # A live view: MuJoCo counts here what makes it reset a diverged state.
        self._divergence_warnings = self.data.warning.number[_BAD_STATE]
        self._substeps = round(CONTROL_PERIOD / self.model.opt.timestep)

    def _info(self, terms: dict[str, float], *, simulation_error: bool) -> Info:
        reading: DoorReading = self._reading
        success = self._monitor.success
        failure = "simulation_error" if simulation_error else self._monitor.failure
        x, y, z = reading.hand_on_handle
        x0, y0, z0 = self._grasp_point
        return {
            "door_angle": reading.angle,
            "door_velocity": reading.velocity,
            "door_radius": self.door.radius,
            "handle_pose": np.array(reading.handle_pose),
            "success": success,
            "is_success": success,
            "grasped": reading.grasped,
            "slip": ((x - x0) ** 2 + (y - y0) ** 2 + (z - z0) ** 2) ** 0.5,
            "force_tangential": reading.force_tangential,
            "force_radial": reading.force_radial,
            "force_vertical": reading.force_vertical,
            "failure": failure,
            "simulation_error": simulation_error,
            "reward_terms": terms,
        }


def _checked(action: Array) -> Array:
    command = np.asarray(action, dtype=np.float64)
    if command.shape != (6,):
        raise ValueError(
            f"the action must have shape (6,), commanded position [m] and rotation "
            f"vector [rad] in the task frame; got shape {command.shape}"
        )
    if not all(map(math.isfinite, command.tolist())):
        raise ValueError(
            f"the action must be finite, got {command.tolist()}; check the policy "
            "for divisions by zero or an unstable integrator"
        )
    return command


def _check_size(width: int, height: int) -> None:
    for name, value in (("width", width), ("height", height)):
        if not isinstance(value, int) or not 1 <= value <= _LARGEST_PICTURE:
            raise ValueError(
                f"{name} = {value!r} must be a whole number of pixels from 1 to "
                f"{_LARGEST_PICTURE}"
            )


def _require_display() -> None:
    # GLFW aborts the whole process when it finds no monitor.
    variables = ("DISPLAY", "WAYLAND_DISPLAY")
    if sys.platform == "linux" and not any(map(os.environ.get, variables)):
        raise RuntimeError(
            'render_mode="human" opens a window and needs a display; without one use '
            '"rgb_array" with MUJOCO_GL=egl set before Python starts, or run under '
            "xvfb-run"
        )


def _check_choice(name: str, value: object, allowed: Any) -> None:
    if value not in allowed:
        raise ValueError(
            f"{name} = {value!r} is not one of {', '.join(map(repr, allowed))}"
        )


def _copy(observation: Observation) -> Observation:
    return {key: value.copy() for key, value in observation.items()}
