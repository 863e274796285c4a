"""Integer codes instead of strings in an info."""

from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
import numpy as np

from gplfd_env.conventions.constants import Info
from gplfd_env.task.info import INFO, TEXTS

_CODES: Final = {
    # A simulation without a value in this info has None, or 0 from Gymnasium.
    name: {None: 0, 0: 0} | {text: n for n, text in enumerate(INFO[name].texts)}
    for name in TEXTS
}


class _Coded:
    """Reset and step of single or vector environments with codes in their infos."""

    env: Any

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin an episode, or one in each environment."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, _coded(info)

    def step(self, action: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Command every hand for one control period."""
        *outcome, info = self.env.step(action)
        return (*outcome, _coded(info))


class NumericInfo(_Coded, gym.Wrapper[Any, Any, Any, Any]):
    """Replace the strings of ``info`` by integers.

    ``failure_code``, ``reason_code`` and ``stage_code`` are indices into `FAILURES`,
    `REASONS` and `gplfd_env.task.stages.STAGES`. For code that accepts only numbers,
    such as `gymnasium.wrappers.NumpyToTorch`.
    """


class VectorNumericInfo(_Coded, gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """`NumericInfo` for vector environments: (n,) int64, with its mask."""


def _coded(info: Mapping[str, Any]) -> Info:
    """Return an info with codes, also in its masks and in ``final_info``."""
    coded = dict(info)
    for name, codes in _CODES.items():
        if name in info:
            of_each = np.vectorize(codes.__getitem__, otypes=[np.int64])(
                coded.pop(name)
            )
            coded[f"{name}_code"] = of_each if of_each.ndim else int(of_each)
        if f"_{name}" in info:
            coded[f"_{name}_code"] = coded.pop(f"_{name}")
    if "final_info" in info:
        coded["final_info"] = _coded(info["final_info"])
    return coded
