"""Observations as one vector of float32, as most learning libraries expect them."""

from collections.abc import Mapping
from typing import Any

import gymnasium as gym
import numpy as np
from gymnasium import spaces
from gymnasium.vector.utils import batch_space
from numpy.typing import NDArray

from gplfd_env.conventions.constants import Info

Flat = NDArray[np.float32]


def flat_of(observation: Mapping[str, Any]) -> Flat:
    """Concatenate the vectors of a dictionary in order of names, (..., m).

    For a policy that was trained on vectors and receives a dictionary.
    """
    vectors = [observation[name] for name in sorted(observation)]
    return np.concatenate(vectors, axis=-1, dtype=np.float32)


class _Flat:
    """Reset and step of single or vector environments with flat observations."""

    env: Any

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Flat, Info]:
        """Begin an episode, or one in each environment."""
        observation, info = self.env.reset(seed=seed, options=options)
        return flat_of(observation), info

    def step(self, action: Any) -> tuple[Flat, Any, Any, Any, Info]:
        """Act for one control period."""
        observation, reward, terminated, truncated, info = self.env.step(action)
        if "final_obs" in info:
            last = np.full(len(info["final_obs"]), None, dtype=object)
            for row in np.flatnonzero(info["_final_obs"]):
                last[row] = flat_of(info["final_obs"][row])
            info = {**info, "final_obs": last}
        return flat_of(observation), reward, terminated, truncated, info


class FlatObservation(_Flat, gym.Wrapper[Any, Any, Any, Any]):
    """Concatenate the entries of the observation in the order of their names.

    The order is the same as in Gymnasium's `FlattenObservation`; docs/environment.md
    lists the indices.

    Args:
        env: Its observation space is a dictionary of vectors.
    """

    def __init__(self, env: gym.Env[Any, Any]) -> None:
        super().__init__(env)
        self.observation_space = _flat_space(env.observation_space)


class VectorFlatObservation(_Flat, gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """`FlatObservation` for vector environments: (n, m), ``final_obs`` included."""

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        space = self.single_observation_space = _flat_space(
            env.single_observation_space
        )
        self.observation_space = batch_space(space, env.num_envs)


def _flat_space(space: spaces.Space[Any]) -> spaces.Box:
    entries = dict(space.spaces) if isinstance(space, spaces.Dict) else {}
    boxes = [entries[name] for name in sorted(entries)]
    if not boxes or any(
        not isinstance(box, spaces.Box) or len(box.shape) != 1 for box in boxes
    ):
        raise ValueError(
            f"the observation must be a dictionary of vectors to be concatenated, got "
            f"{space}"
        )
    low, high = (
        np.concatenate([getattr(box, end) for box in boxes]).astype(np.float32)
        for end in ("low", "high")
    )
    return spaces.Box(low, high, dtype=np.float32)
