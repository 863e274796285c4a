"""Actions within ±1 that move the set-point relative to the hand."""

import reprlib
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from gplfd_env.task.observation import Observation

Array = NDArray[np.float64]
Info = dict[str, Any]

LIMITS: Final = (0.03, 0.1)
"""How far from the hand the set-point may be: per axis [m], per component [rad].

The servo's 2000 N/m and 100 N m/rad make 60 N and 10 N m of them; its damping lets a
hand that meets nothing move at no more than 0.34 m/s and 1.3 rad/s.
"""

_SPACE: Final = spaces.Box(-1.0, 1.0, (6,), np.float32)


def command_of(
    action: ArrayLike, hand: Array, limits: tuple[float, float] = LIMITS
) -> Array:
    """Return the commanded poses that actions stand for: hand + limits · action.

    Position and rotation vector are added component by component, in the task frame.

    Args:
        action: (..., 6), clamped to ±1; what is not finite stays so.
        hand: Observed poses of the hand, (..., 6) [m, rad].
        limits: As `RelativeAction` takes them.
    """
    given = np.asarray(action, dtype=np.float64)
    clamped = np.where(np.isfinite(given), np.clip(given, -1.0, 1.0), given)
    command: Array = hand + np.repeat(limits, 3) * clamped
    return command


def action_of(
    command: ArrayLike, hand: Array, limits: tuple[float, float] = LIMITS
) -> Array:
    """Return the actions that stand for commanded poses, not clamped, (..., 6).

    The inverse of `command_of`, up to rounding, wherever no entry exceeds ±1: for
    whoever imitates an agent that commands poses.
    """
    offset: Array = np.asarray(command, dtype=np.float64) - hand
    action: Array = offset / np.repeat(limits, 3)
    return action


class RelativeAction(gym.Wrapper[Observation, Any, Observation, Any]):
    """Let an action within ±1 say where the set-point is relative to the hand.

    The command is the observed pose of the hand plus the limits times the action, so
    that zero lets the hand rest where it is, and no action asks for more than the servo
    does over that distance. For ``gplfd/DoorOpening-v1`` and whatever else commands
    poses and observes ``ee_pose``.

    Args:
        env: Its observation is a dictionary, its action a pose (6,).
        limits: Distance for an action of 1 per axis [m], angle per component [rad].

    Raises:
        ValueError: The environment's action is no pose, or a limit is not above zero.
    """

    def __init__(
        self,
        env: gym.Env[Observation, Any],
        limits: tuple[float, float] = LIMITS,
    ) -> None:
        super().__init__(env)
        self.action_space = _SPACE
        self._limits = _checked_limits(limits)
        _check_pose(env.action_space)
        self._hand: Array | None = None

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[Observation, Info]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._hand = observation["ee_pose"].copy()
        return observation, info

    def step(self, action: Any) -> tuple[Observation, Any, bool, bool, Info]:
        """Move the set-point for one control period.

        Args:
            action: (6,) in units of the limits; values beyond ±1 are clamped to it.

        Raises:
            ValueError: The action's shape is wrong or it is not finite.
            gymnasium.error.ResetNeeded: There was no reset yet.
        """
        hand = _after_reset(self._hand)
        command = command_of(_numbers(action, (6,)), hand, self._limits)
        outcome = self.env.step(command)
        self._hand = outcome[0]["ee_pose"].copy()
        return outcome


class VectorRelativeAction(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """The same of a vector environment: actions (n, 6)."""

    def __init__(
        self,
        env: gym.vector.VectorEnv[Any, Any, Any],
        limits: tuple[float, float] = LIMITS,
    ) -> None:
        super().__init__(env)
        self.single_action_space = _SPACE
        self.action_space = batch_space(_SPACE, env.num_envs)
        self._limits = _checked_limits(limits)
        _check_pose(env.single_action_space)
        self._hands: Array | None = None

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin episodes."""
        observations, infos = self.env.reset(seed=seed, options=options)
        self._hands = observations["ee_pose"].copy()
        return observations, infos

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Move every set-point for one control period.

        Args:
            actions: (n, 6). Those of simulations that are being reset, or stand still,
                are ignored.

        Raises:
            ValueError: The shape is wrong or an action is not finite.
            gymnasium.error.ResetNeeded: There was no reset yet.
        """
        hands = _after_reset(self._hands)
        numbers = _numbers(actions, (self.num_envs, 6))
        outcome = self.env.step(command_of(numbers, hands, self._limits))
        self._hands = outcome[0]["ee_pose"].copy()
        return outcome


def _checked_limits(limits: Any) -> tuple[float, float]:
    metres, radians = limits
    if not (0.0 < metres < np.inf and 0.0 < radians < np.inf):
        raise ValueError(
            f"limits must be a distance [m] and an angle [rad] above zero, got {limits}"
        )
    return float(metres), float(radians)


def _check_pose(space: spaces.Space[Any]) -> None:
    if space.shape != (6,):
        raise ValueError(
            "RelativeAction needs an environment whose action is a pose (6,), such as "
            f"gplfd/DoorOpening-v1; got one with {space}"
        )


def _after_reset(hand: Array | None) -> Array:
    if hand is None:
        raise gym.error.ResetNeeded("call reset() before the first step()")
    return hand


def _numbers(action: Any, shape: tuple[int, ...]) -> Array:
    try:
        numbers = np.asarray(action, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        numbers = np.empty(0)
    if numbers.shape != shape:
        raise ValueError(
            f"the action must be numbers of shape {shape}, where the set-point is "
            f"relative to the hand in units of the limits; got {reprlib.repr(action)}"
        )
    return numbers
