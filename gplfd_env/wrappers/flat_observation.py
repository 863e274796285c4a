"""Observations as one vector of float32, as most libraries for learning want them."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

Flat = NDArray[np.float32]
Info = dict[str, Any]


def flat_of(observation: Mapping[str, Any]) -> Flat:
    """Return a dictionary's vectors side by side, (..., m), in order of names.

    For whoever learned from vectors and is asked with a dictionary.
    """
    vectors = [observation[name] for name in sorted(observation)]
    return np.concatenate(vectors, axis=-1, dtype=np.float32)


class FlatObservation(gym.Wrapper[Any, Any, Any, Any]):
    """Put the dictionary's entries one after another, in the order of their names.

    The same order as of Gymnasium's `FlattenObservation`; docs/environment.md has the
    indices.

    Args:
        env: Its observation space is a dictionary of vectors.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observation_space = _flat_space(env.observation_space)

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[Flat, Info]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return flat_of(observation), info

    def step(self, action: Any) -> tuple[Flat, Any, bool, bool, Info]:
        """Act for one control period."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        return flat_of(observation), reward, terminated, truncated, info


class VectorFlatObservation(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """The same of a vector environment: (n, m), ``final_obs`` included."""

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self.single_observation_space = _flat_space(env.single_observation_space)
        self.observation_space = batch_space(
            self.single_observation_space, env.num_envs
        )

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Flat, Info]:
        """Begin episodes."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return flat_of(observations), infos

    def step(self, actions: Any) -> tuple[Flat, Any, Any, Any, Info]:
        """Act for one control period."""
        observations, rewards, terminations, truncations, infos = self.env.step(actions)
        if "final_obs" in infos:
            last = np.full(self.num_envs, None, dtype=object)
            for row in np.flatnonzero(infos["_final_obs"]):
                last[row] = flat_of(infos["final_obs"][row])
            infos = {**infos, "final_obs": last}
        flat = flat_of(observations)
        return flat, rewards, terminations, truncations, infos


def _entries(space: spaces.Space[Any]) -> dict[str, spaces.Space[Any]]:
    entries = dict(space.spaces) if isinstance(space, spaces.Dict) else {}
    vectors = [
        isinstance(one, spaces.Box) and len(one.shape) == 1 for one in entries.values()
    ]
    if not (vectors and all(vectors)):
        raise ValueError(
            f"the observation must be a dictionary of vectors to be put one after "
            f"another, got {space}"
        )
    return entries


def _flat_space(space: spaces.Space[Any]) -> spaces.Box:
    entries = _entries(space)
    boxes = [entries[name] for name in sorted(entries)]
    low, high = (
        np.concatenate([getattr(box, end) for box in boxes]).astype(np.float32)
        for end in ("low", "high")
    )
    return spaces.Box(low, high, dtype=np.float32)
