"""Integer codes instead of strings in an info."""

from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
import numpy as np

from gplfd_env.conventions.constants import Info
from gplfd_env.task.info import INFO, TEXTS

_CODES: Final = {name: INFO[name].texts for name in TEXTS}


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
    """`NumericInfo` for vector environments: (n,) int64, with its mask.

    With ``autoreset_mode="SameStep"`` ``infos["final_obs"]`` remains an array of
    objects, as in every vector environment of Gymnasium.
    """


def _coded(info: Mapping[str, Any]) -> Info:
    """Return an info with codes, also in its masks and in ``final_info``."""
    coded = dict(info)
    for name, texts in _CODES.items():
        if name in info:
            # A simulation without a value in this info has None, or 0 from Gymnasium.
            code = {None: 0, 0: 0, "": 0} | {text: n for n, text in enumerate(texts)}
            codes = np.vectorize(code.__getitem__, otypes=[np.int64])(coded.pop(name))
            coded[f"{name}_code"] = codes if codes.ndim else int(codes)
        if f"_{name}" in info:
            coded[f"_{name}_code"] = coded.pop(f"_{name}")
    if "final_info" in info:
        coded["final_info"] = _coded(info["final_info"])
    return coded
