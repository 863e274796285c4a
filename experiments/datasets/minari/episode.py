"""One episode with everything that is needed to run it again."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np
from numpy.typing import NDArray

from experiments.datasets.minari.physics import (
    model_digests,
    physics_state,
    state_layout,
)

Array = NDArray[Any]
Observation = Mapping[str, Array]

PHYSICS_STATE = "physics_state"
"""Name of the physics state among the infos."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Episode:
    """What went into an environment in one episode, and what came out.

    T is the number of steps. Observations and infos have T + 1 rows, the first one from
    the reset; the others T.
    """

    seed: int
    """Seed of the reset."""
    options: Mapping[str, Any]
    """Options in force: of the reset, and of earlier ones in the same environment."""
    observations: Mapping[str, Array]
    """Observations by name, (T + 1, ...)."""
    actions: Array
    """Actions, (T, A)."""
    rewards: Array
    """Rewards, (T,)."""
    terminations: Array
    """Whether the task ended at this step, (T,)."""
    truncations: Array
    """Whether the episode was cut at this step, (T,)."""
    infos: Mapping[str, Any]
    """The environment's infos by name, (T + 1, ...), and `PHYSICS_STATE`, (T + 1, S):
    MuJoCo's state [SI] after the reset and after every step."""
    state_layout: Mapping[str, int]
    """Parts of the physics state and their lengths, in order; they add up to S."""
    model_digests: Mapping[str, str]
    """Hashes of the model after the reset; see `physics.model_digests`."""

    def __len__(self) -> int:
        """Number of steps."""
        return len(self.rewards)

    @property
    def states(self) -> Array:
        """Physics states, (T + 1, S)."""
        states: Array = self.infos[PHYSICS_STATE]
        return states


class Recorder(gym.Wrapper[Any, Any, Any, Any], gym.utils.RecordConstructorArgs):
    """Keeps what passes between an agent and an environment of this package.

    Whatever drives the environment can be recorded: wrap it, drive it, and take
    `episode` before the next reset.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        gym.utils.RecordConstructorArgs.__init__(self)
        super().__init__(env)
        self._start: dict[str, Any] = {}
        self._in_force: dict[str, Any] = {}
        self._observations: list[Observation] = []
        self._infos: list[Mapping[str, Any]] = []
        self._actions: list[Array] = []
        self._results: list[tuple[float, bool, bool]] = []

    def reset(
        self, *, seed: int | None = None, options: Mapping[str, Any] | None = None
    ) -> tuple[Any, dict[str, Any]]:
        """Reset the environment and begin a new recording.

        Raises:
            ValueError: No seed is given: the episode could not be run again.
        """
        if seed is None:
            raise ValueError(
                "a recorded episode needs a seed, or it cannot be run again; call "
                "reset(seed=...)"
            )
        given = dict(options or {})
        observation, info = self.env.reset(seed=seed, options=given or None)
        # Options hold from their episode on: what an earlier reset set still counts.
        self._in_force |= _storable(given)
        model = self._unwrapped.model
        self._start = {
            "seed": seed,
            "options": dict(self._in_force),
            "state_layout": state_layout(model),
            "model_digests": model_digests(model),
        }
        for rows in (self._observations, self._infos, self._actions, self._results):
            rows.clear()
        self._keep(observation, info)
        return observation, info

    def step(self, action: Array) -> tuple[Any, Any, bool, bool, dict[str, Any]]:
        """Step the environment and keep a row."""
        given = np.array(action, dtype=np.float64)
        observation, reward, terminated, truncated, info = self.env.step(action)
        self._actions.append(given)
        self._results.append((float(reward), terminated, truncated))
        self._keep(observation, info)
        return observation, reward, terminated, truncated, info

    @property
    def episode(self) -> Episode:
        """Everything since the last reset.

        Raises:
            ValueError: There was no step yet, or an info cannot be kept as an array.
        """
        if not self._results:
            raise ValueError("nothing is recorded yet; reset, then step at least once")
        rewards, terminations, truncations = zip(*self._results, strict=True)
        return Episode(
            **self._start,
            observations=_stack("observation", self._observations),
            actions=np.array(self._actions),
            rewards=np.array(rewards),
            terminations=np.array(terminations),
            truncations=np.array(truncations),
            infos=_stack("info", self._infos),
        )

    @property
    def _unwrapped(self) -> Any:
        return self.env.unwrapped

    def _keep(self, observation: Observation, info: Mapping[str, Any]) -> None:
        state = physics_state(self._unwrapped.model, self._unwrapped.data)
        self._observations.append(_copied(observation))
        self._infos.append({**_copied(info), PHYSICS_STATE: state})


def _storable(options: Mapping[str, Any]) -> dict[str, Any]:
    """Options with records as mappings of what they set, which resets also take."""
    return {
        name: _storable(
            {key: part for key, part in _mapping(value).items() if part is not None}
        )
        if isinstance(value, Mapping) or dataclasses.is_dataclass(value)
        else value
        for name, value in options.items()
    }


def _mapping(value: Any) -> Mapping[str, Any]:
    return value if isinstance(value, Mapping) else dataclasses.asdict(value)


def _copied(row: Mapping[str, Any]) -> dict[str, Any]:
    return {
        name: _copied(value) if isinstance(value, Mapping) else np.copy(value)[()]
        for name, value in row.items()
    }


def _stack(what: str, rows: Sequence[Mapping[str, Any]]) -> dict[str, Any]:
    """One array, or one mapping of arrays, per name.

    Raises:
        ValueError: A name is missing in a row, or its values make no array.
    """
    stacked: dict[str, Any] = {}
    for name in rows[0]:
        try:
            values = [row[name] for row in rows]
            nested = isinstance(values[0], Mapping)
            array = None if nested else np.array(values)
        except (KeyError, ValueError) as error:
            raise ValueError(
                f"{what} {name!r} must be in every step and keep its shape: {error}"
            ) from error
        if array is not None and array.dtype == object:
            raise ValueError(f"{what} {name!r} is no number, text or array of numbers")
        stacked[name] = _stack(f"{what} {name}", values) if array is None else array
    return stacked
