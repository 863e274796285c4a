"""Vector environment for Stable-Baselines3: its `VecEnv` interface around ours.

Only this module needs the extra ``sb3``.
"""

from collections.abc import Sequence
from typing import Any, Final

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from numpy.typing import NDArray

from gplfd_env import RL_ENVIRONMENT_ID
from gplfd_env.conventions.constants import Info
from gplfd_env.conventions.resets import unmasked

try:
    from stable_baselines3.common.vec_env import VecEnv
except ImportError as error:
    raise ImportError(
        f"gplfd_env.wrappers.sb3 needs Stable-Baselines3 ({error}); in a checkout of "
        "gplfd: pip install '.[sb3]', elsewhere: pip install 'gplfd[sb3]'"
    ) from error

__all__ = ["SB3VecEnv", "make_sb3"]

# Attributes of single environments, and the matching attributes of the vector one.
_OF_EACH: Final = {"variation": "variations", "model": "models"}
_OF_EACH["door_geometry"] = "door_geometries"
_NONE_ALONE: Final = (
    "the simulations are one environment without attributes or methods of their own: "
    "give differing values to gym.make_vec, or use Stable-Baselines3's DummyVecEnv"
)


def make_sb3(num_envs: int = 1, id: str = RL_ENVIRONMENT_ID, **more: Any) -> VecEnv:
    """Return n doors on threads of an environment id, for Stable-Baselines3."""
    more["autoreset_mode"] = AutoresetMode.SAME_STEP
    return SB3VecEnv(gym.make_vec(id, num_envs, **more))


class SB3VecEnv(VecEnv):
    """A Gymnasium vector environment with the interface of Stable-Baselines3.

    The results equal those of Stable-Baselines3's `DummyVecEnv` of single environments
    bit for bit: rewards in float32; one info per simulation, with
    ``TimeLimit.truncated`` and, after the end of an episode, ``terminal_observation``;
    `reset_infos` from the resets. Raises a ValueError if the autoreset mode of the
    vector environment is not ``"SameStep"``.
    """

    def __init__(self, envs: VectorEnv[Any, Any, Any]) -> None:
        mode = envs.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                "Stable-Baselines3 expects ended episodes to be reset at once: make "
                f'the vector environment with autoreset_mode="SameStep", not {mode}'
            )
        self.env = envs
        self._actions: Any = None
        spaces = envs.single_observation_space, envs.single_action_space
        super().__init__(envs.num_envs, *spaces)

    def reset(self) -> Any:
        """Begin episodes; values of `seed` and `set_options` are used once."""
        if any(options != self._options[0] for options in self._options):
            raise ValueError(
                f"give one set of options, with a list of {self.num_envs} doors where "
                f"they differ; got {self._options}"
            )
        seeds: Any = None if None in self._seeds else list(self._seeds)
        options = self._options[0] or None
        observations, infos = self.env.reset(seed=seeds, options=options)
        self._reset_seeds()
        self._reset_options()
        self.reset_infos = _each(infos, self.num_envs)
        return observations

    def step_async(self, actions: NDArray[Any]) -> None:
        """Store the actions (n, ...) for the next step."""
        self._actions = actions

    def step_wait(self) -> Any:
        """Step; return observations, rewards, dones (n,) and n infos."""
        step = self.env.step(self._actions)
        observations, rewards, terminations, truncations, infos = step
        split = _each(infos, self.num_envs)
        dones = terminations | truncations
        last = _each(infos["final_info"], self.num_envs) if dones.any() else []
        for row in np.flatnonzero(dones).tolist():
            self.reset_infos[row], split[row] = split[row], last[row]
            split[row]["terminal_observation"] = infos["final_obs"][row]
        for row, info in enumerate(split):
            info["TimeLimit.truncated"] = bool(truncations[row] & ~terminations[row])
        return observations, rewards.astype(np.float32), dones, split

    def close(self) -> None:
        """Free the renderer."""
        self.env.close()

    def get_images(self) -> Sequence[Any]:
        """Return an image of every simulation; ``render_mode="rgb_array"``."""
        return tuple(self.env.render() or self.num_envs * (None,))

    def get_attr(self, attr_name: str, indices: Any = None) -> list[Any]:
        """Return an attribute of some simulations, by default all; see `_OF_EACH`."""
        rows = list(self._get_indices(indices))
        if attr_name in _OF_EACH:
            values = getattr(self.env.unwrapped, _OF_EACH[attr_name])
            return [values[row] for row in rows]
        owner = self.env if hasattr(self.env, attr_name) else self.env.unwrapped
        return [getattr(owner, attr_name)] * len(rows)

    def set_attr(self, attr_name: str, value: Any, indices: Any = None) -> None:
        """Refuse: no single environments stand behind the simulations."""
        raise AttributeError(_NONE_ALONE)

    def env_method(
        self, method_name: str, *args: Any, indices: Any = None, **kwargs: Any
    ) -> list[Any]:
        """Refuse: no single environments stand behind the simulations."""
        raise AttributeError(_NONE_ALONE)

    def env_is_wrapped(self, wrapper_class: Any, indices: Any = None) -> list[bool]:
        """Return False for each: wrap this in `VecMonitor` and the like instead."""
        return [False for _ in self._get_indices(indices)]


def _each(infos: Info, n: int) -> list[Info]:
    """Split an info of arrays into n infos, without masks."""
    split: list[Info] = [{} for _ in range(n)]
    for name, values in unmasked(infos).items():
        if name in ("final_obs", "final_info"):
            continue
        rows: Any = _each(values, n) if isinstance(values, dict) else values.copy()
        if isinstance(values, np.ndarray) and values.ndim == 1:
            rows = values.tolist()
        for info, value in zip(split, rows, strict=True):
            info[name] = value
    return split
