"""Other forms of actions, observations and infos: relative, flat, numeric."""

import reprlib
from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import ArrayLike, NDArray

from gplfd_env.conventions.constants import Array, Info
from gplfd_env.task.info import INFO, TEXTS
from gplfd_env.validation.fields import real_array

LIMITS: Final = (0.03, 0.1)
"""Greatest distance of the set-point from the hand: per axis [m], per component [rad].
With the servo's stiffness they correspond to 60 N and 10 N m; its damping limits the
free hand to 0.34 m/s and 1.3 rad/s."""

Limits = tuple[float, float]
_VectorWrapper = gym.vector.VectorWrapper[Any, Any, Any, Any, Any]
_VectorEnv = gym.vector.VectorEnv[Any, Any, Any]

_SPACE: Final = spaces.Box(-1.0, 1.0, (6,), np.float32)


def command_of(action: ArrayLike, hand: Array, limits: Limits = LIMITS) -> Array:
    """Return the commanded poses for actions: hand + limits · action, each (..., 6).

    The actions are clamped to ±1; values that are not finite are kept. Position [m] and
    rotation vector [rad] are added component by component, in the task frame.
    """
    numbers = np.asarray(action, dtype=np.float64)
    clamped = np.where(np.isfinite(numbers), np.clip(numbers, -1.0, 1.0), numbers)
    return np.asarray(hand + np.repeat(limits, 3) * clamped)


def action_of(command: ArrayLike, hand: Array, limits: Limits = LIMITS) -> Array:
    """Return actions for commanded poses, not clamped: the inverse of `command_of`."""
    offset = np.asarray(command, dtype=np.float64) - hand
    return np.asarray(offset / np.repeat(limits, 3))


class _Converted:
    """Reset and step of single or vector environments, with converted results."""

    env: Any

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin an episode, or one in each environment."""
        return self._convert(*self.env.reset(seed=seed, options=options))

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Act for one control period."""
        observation, *outcome, info = self.env.step(action)
        observation, info = self._convert(observation, info)
        return (observation, *outcome, info)

    def _convert(self, observation: Any, info: Info) -> tuple[Any, Info]:
        raise NotImplementedError


class _Relative(_Converted):
    """Set-points relative to the hand, for one or many."""

    def _begin(self, space: spaces.Space[Any], limits: Any, *n: int) -> None:
        """Check action space and limits; actions are (n, 6) or (6,) numbers."""
        metres, radians = limits
        if not (0.0 < metres < np.inf and 0.0 < radians < np.inf):
            raise ValueError(f"limits must be above zero [m], [rad], got {limits}")
        if space.shape != (6,):
            raise ValueError(f"RelativeAction needs a pose (6,) as action; got {space}")
        self._limits, self._shape = (float(metres), float(radians)), (*n, 6)
        self._hand: Array | None = None

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Move the set-points, (6,) or (n, 6), clamped to ±1; refuse others."""
        if self._hand is None:
            raise gym.error.ResetNeeded("call reset() before the first step()")
        try:
            numbers = real_array(action)
        except (TypeError, ValueError, OverflowError):
            numbers = np.empty(0)
        if numbers.shape != self._shape:
            raise ValueError(
                f"the action must be numbers of shape {self._shape}, relative to the "
                f"hand; got {reprlib.repr(action)}"
            )
        return super().step(command_of(numbers, self._hand, self._limits))

    def _convert(self, observation: Any, info: Info) -> tuple[Any, Info]:
        self._hand = observation["ee_pose"].copy()
        return observation, info


class RelativeAction(_Relative, gym.Wrapper[Any, Any, Any, Any]):
    """Define the set-point relative to the hand by an action within ±1.

    The command is the observed pose of the hand plus the limits (distance per axis [m],
    angle per component [rad]) times the action. A zero action keeps the hand where it
    is, and the limits bound the force of the servo. Raises a ValueError if the
    environment's action is not a pose, or a limit is not positive.
    """

    def __init__(self, env: gym.Env[Any, Any], limits: Limits = LIMITS) -> None:
        super().__init__(env)
        self.action_space = _SPACE
        self._begin(env.action_space, limits)


class VectorRelativeAction(_Relative, _VectorWrapper):
    """`RelativeAction` for vector environments: actions (n, 6)."""

    def __init__(self, env: _VectorEnv, limits: Limits = LIMITS) -> None:
        super().__init__(env)
        self.single_action_space = _SPACE
        self.action_space = batch_space(_SPACE, env.num_envs)
        self._begin(env.single_action_space, limits, env.num_envs)


Flat = NDArray[np.float32]


def flat_of(observation: Mapping[str, Any]) -> Flat:
    """Concatenate the vectors of a dictionary in order of names, (..., m)."""
    vectors = [observation[name] for name in sorted(observation)]
    return np.concatenate(vectors, axis=-1, dtype=np.float32)


class _Flat(_Converted):
    """Flat observations, also those at the ends of episodes."""

    def _convert(self, observation: Any, info: Info) -> tuple[Flat, Info]:
        if "final_obs" in info:
            last = np.full(len(info["final_obs"]), None, dtype=object)
            for row in np.flatnonzero(info["_final_obs"]):
                last[row] = flat_of(info["final_obs"][row])
            info = {**info, "final_obs": last}
        return flat_of(observation), info


class FlatObservation(_Flat, gym.Wrapper[Any, Any, Any, Any]):
    """Concatenate the entries of the observation in the order of their names, (m,)."""

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observation_space = _flat_space(env.observation_space)


class VectorFlatObservation(_Flat, _VectorWrapper):
    """`FlatObservation` for vector environments: (n, m), ``final_obs`` included."""

    def __init__(self, env: _VectorEnv) -> None:
        super().__init__(env)
        space = _flat_space(env.single_observation_space)
        self.single_observation_space = space
        self.observation_space = batch_space(space, env.num_envs)


def _flat_space(space: spaces.Space[Any]) -> spaces.Box:
    entries = dict(space.spaces) if isinstance(space, spaces.Dict) else {}
    boxes = [entries[name] for name in sorted(entries)]
    vectors = [isinstance(box, spaces.Box) and len(box.shape) == 1 for box in boxes]
    if not boxes or not all(vectors):
        raise ValueError(f"observations must be dictionaries of vectors, got {space}")
    ends = [[getattr(box, end) for box in boxes] for end in ("low", "high")]
    low, high = (np.concatenate(end).astype(np.float32) for end in ends)
    return spaces.Box(low, high, dtype=np.float32)


_CODES: Final = {
    # A simulation without a value in this info has None, or 0 from Gymnasium.
    name: {None: 0, 0: 0} | {text: n for n, text in enumerate(INFO[name].texts)}
    for name in TEXTS
}


class _Numeric(_Converted):
    """Codes in the infos."""

    def _convert(self, observation: Any, info: Info) -> tuple[Any, Info]:
        return observation, _coded(info)


class NumericInfo(_Numeric, gym.Wrapper[Any, Any, Any, Any]):
    """Replace the strings of ``info`` by integers, for wrappers such as `NumpyToTorch`.

    ``failure_code``, ``reason_code`` and ``stage_code`` are indices into `FAILURES`,
    `REASONS` and `gplfd_env.task.opening.STAGES`.
    """


class VectorNumericInfo(_Numeric, _VectorWrapper):
    """`NumericInfo` for vector environments: (n,) int64, with its mask."""


def _coded(info: Mapping[str, Any]) -> Info:
    coded = dict(info)
    for name, codes in _CODES.items():
        if name in info:
            numbers = np.vectorize(codes.__getitem__, otypes=[np.int64])(info[name])
            coded[f"{name}_code"] = numbers if numbers.ndim else int(numbers)
            del coded[name]
        if f"_{name}" in info:
            coded[f"_{name}_code"] = coded.pop(f"_{name}")
    if "final_info" in info:
        coded["final_info"] = _coded(info["final_info"])
    return coded
