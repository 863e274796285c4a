"""Doors for policies that act ten or twenty times per second, as LeRobot's do.

An action is the pose that the hand has to reach by the next one. `Waypoints` turns it
into commands of every control period; the environment `WaypointDoor` and agents outside
LeRobot share it, so that both open a door with the same commands.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from scipy.spatial.transform import Rotation

import gplfd_env
from gplfd_env.conventions.constants import (
    CONTROL_PERIOD,
    TASK,
    ActionForm,
    Array,
    Control,
    Info,
)
from gplfd_env.doors.randomization import seed_of_door
from gplfd_env.envs.camera import Camera
from gplfd_env.validation.fields import check_choice
from gplfd_env.wrappers.forms import action_of, command_of

SIZES: Final[Mapping[ActionForm, int]] = {"pose": 7, "relative": 6, "stiffness": 13}
"""Number of components of an action."""

_RATE: Final = round(1.0 / CONTROL_PERIOD)


@dataclass(frozen=True, kw_only=True, slots=True)
class Condition:
    """A door and the circumstances in which it is opened."""

    name: str
    """For example "radius/between/0.42"."""
    suites: tuple[str, ...] = ("doors",)
    """Groups that it belongs to, such as the tracks of a protocol."""
    door: str
    """Name of the door, with which its random draws differ from those of others."""
    arguments: Mapping[str, Any] = field(default_factory=dict)
    """Arguments of ``gym.make``."""

    def reset_seed(self, seed: int) -> int:
        """Return the seed of the environment's reset for a seed of the condition."""
        names = "randomization", "disturbance"
        drawn = any(self.arguments.get(name, "none") != "none" for name in names)
        return seed_of_door(seed, self.door) if drawn else seed


def state_of(pose: Array) -> Array:
    """Return a pose [m, rad], (6,), as position and quaternion (x, y, z, w), (7,)."""
    return np.concatenate([pose[:3], Rotation.from_rotvec(pose[3:]).as_quat()])


def pose_of(state: Array) -> Array:
    """Return the pose (6,) of a position and quaternion (7,): inverse of `state_of`."""
    return np.concatenate([state[:3], Rotation.from_quat(state[3:]).as_rotvec()])


def action_to(command: Array, hand: Array, form: ActionForm) -> Array:
    """Return the action that leads from the hand (6,) to a command.

    A command is a pose (6,), for the form "stiffness" with stiffness (12,): the last
    one of `Waypoints.commands`.
    """
    if form == "relative":
        return action_of(command, hand)
    return np.concatenate([state_of(command[:6]), command[6:]])


def seen(observation: Mapping[str, Array]) -> dict[str, Any]:
    """Return what LeRobot names ``agent_pos`` and ``environment_state``.

    They are the pose of the hand as position and quaternion, (7,), and the wrench on it
    [N, N m], (6,), in float32.
    """
    return {
        "agent_pos": state_of(observation["ee_pose"]).astype(np.float32),
        "environment_state": observation["wrench"].astype(np.float32),
    }


class Waypoints:
    """Commands of the control periods between the actions of a slower policy.

    They go from the last command to the pose of the action in equal steps. `per_action`
    is their number. Raises a ValueError if the rate [Hz] does not divide that of the
    control.
    """

    def __init__(self, rate: int, form: ActionForm = "pose") -> None:
        check_choice("action", form, tuple(SIZES))
        if not 0 < rate <= _RATE or _RATE % rate:
            raise ValueError(
                f"fps = {rate} must divide the {_RATE} control periods per second: "
                "100, 50, 25, 20, 10, 5, ..."
            )
        self.form, self.per_action = form, _RATE // rate
        self.control: Control = "impedance" if form == "stiffness" else "pose"
        self._last = np.zeros(6)

    def reset(self, hand: Array) -> None:
        """Begin an episode at the pose of the hand (6,)."""
        self._last = np.array(hand)

    def commands(self, action: Array, hand: Array) -> Array:
        """Return commands (`per_action`, 6 or 12) to an action, from the hand (6,).

        Raises a ValueError if the action has another size or is not finite.
        """
        numbers = np.asarray(action, dtype=np.float64)
        if numbers.shape != (SIZES[self.form],) or not np.isfinite(numbers).all():
            raise ValueError(
                f"an action of the form {self.form!r} is {SIZES[self.form]} finite "
                f"numbers; got {numbers}"
            )
        if self.form == "relative":
            goal = command_of(numbers, hand)
        else:
            goal = pose_of(numbers[:7])
        shares = np.arange(1, self.per_action + 1)[:, None] / self.per_action
        poses = self._last + shares * (goal - self._last)
        self._last = goal
        stiffness = np.tile(numbers[7:], (self.per_action, 1))
        return np.hstack([poses, stiffness]) if self.form == "stiffness" else poses


class WaypointDoor(gym.Env[dict[str, Any], Array]):
    """A door under a condition, opened by `Waypoints` as LeRobot expects it.

    An observation is as in `seen`, with ``pixels`` (height, width, 3) uint8 by camera.
    The model is compiled, and rendering begins, at the first reset: workers are copies.
    """

    def __init__(
        self,
        condition: Condition,
        rate: int = 20,
        form: ActionForm = "pose",
        cameras: Sequence[str] = (),
        size: tuple[int, int] = (320, 240),
    ) -> None:
        self.condition, self.task = condition, condition.name
        self.task_description = TASK
        self._waypoints = Waypoints(rate, form)
        self._max_episode_steps = gplfd_env.TIME_LIMIT // self._waypoints.per_action
        self.metadata = {"render_modes": ["rgb_array"], "render_fps": rate}
        self.render_mode = "rgb_array"
        self._names, self._size = tuple(cameras), size
        self._cameras: dict[str, Camera] = {}
        self._env: Any = None
        self._hand = np.zeros(6)

        def numbers(n: int) -> Any:
            return spaces.Box(-np.inf, np.inf, (n,), np.float32)

        image = spaces.Box(0, 255, (size[1], size[0], 3), np.uint8)
        entries: dict[str, spaces.Space[Any]] = {
            "agent_pos": numbers(7),
            "environment_state": numbers(6),
        }
        if cameras:
            entries["pixels"] = spaces.Dict(dict.fromkeys(cameras, image))
        self.observation_space = spaces.Dict(entries)
        self.action_space = numbers(SIZES[form])

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[dict[str, Any], Info]:
        """Begin an episode; a seed is one of the condition, and options are ignored."""
        super().reset(seed=seed)
        if self._env is None:
            name = gplfd_env.ENVIRONMENT_IDS[self._waypoints.control]
            self._env = gym.make(name, **self.condition.arguments)
        drawn = None if seed is None else self.condition.reset_seed(seed)
        observation, info = self._env.reset(seed=drawn)
        self._hand = observation["ee_pose"]
        self._waypoints.reset(self._hand)
        return self._seen(observation), info

    def step(self, action: Array) -> tuple[dict[str, Any], float, bool, bool, Info]:
        """Move to a waypoint, or to where the episode ends; rewards are added."""
        if self._env is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        total = 0.0
        for command in self._waypoints.commands(action, self._hand):
            observation, reward, ended, truncated, info = self._env.step(command)
            total += float(reward)
            if ended or truncated:
                break
        self._hand = observation["ee_pose"]
        return self._seen(observation), total, ended, truncated, info

    def render(self) -> Any:
        """Return a picture by the first camera, or an overview."""
        return self._picture((*self._names, "overview")[0])

    def close(self) -> None:
        """Free the renderers."""
        for camera in self._cameras.values():
            camera.close()
        if self._env is not None:
            self._env.close()

    def _seen(self, observation: Mapping[str, Array]) -> dict[str, Any]:
        observed = seen(observation)
        if self._names:
            observed["pixels"] = {name: self._picture(name) for name in self._names}
        return observed

    def _picture(self, name: str) -> Any:
        if self._env is None:
            raise gym.error.ResetNeeded("call reset() before the first render()")
        inner = self._env.unwrapped
        if name not in self._cameras:
            self._cameras[name] = Camera(inner.model, *self._size, name, effects=False)
        return self._cameras[name].picture("rgb_array", inner.data)
