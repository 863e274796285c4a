"""Wrappers for those who learn: what the environments say, in other forms."""

from collections.abc import Mapping
from typing import Any, Final

import gymnasium as gym
import numpy as np

Info = dict[str, Any]

FAILURES: Final = ("", "grasp_lost", "stalled", "simulation_error")
"""What ``info["failure"]`` may say; its code is the place in this list."""


class FailureCode(gym.Wrapper[Any, Any, Any, Any]):
    """Put ``info["failure_code"]``, an integer, in the place of the string ``failure``.

    The code is the place in `FAILURES`. For whatever takes numbers only, such as
    `gymnasium.wrappers.NumpyToTorch`.
    """

    def reset(
        self, *, seed: int | None = None, options: Info | None = None
    ) -> tuple[Any, Info]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        return observation, _coded(info)

    def step(self, action: Any) -> tuple[Any, Any, bool, bool, Info]:
        """Command the hand for one control period."""
        *outcome, info = self.env.step(action)
        return (*outcome, _coded(info))


class VectorFailureCode(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """The same of a vector environment: (n,) int64, with its mask.

    With ``autoreset_mode="SameStep"`` ``infos["final_obs"]`` remains an array of
    objects, as of every vector environment of Gymnasium.
    """

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin episodes."""
        observations, infos = self.env.reset(seed=seed, options=options)
        return observations, _coded(infos)

    def step(self, actions: Any) -> tuple[Any, Any, Any, Any, Info]:
        """Command every hand for one control period."""
        *outcome, infos = self.env.step(actions)
        return (*outcome, _coded(infos))


def _coded(info: Mapping[str, Any]) -> Info:
    """Return an info with codes; its mask and that of ended episodes, too."""
    coded = {
        name.replace("failure", "failure_code"): value for name, value in info.items()
    }
    if "failure" in info:
        codes = np.vectorize(_code, otypes=[np.int64])(info["failure"])
        coded["failure_code"] = codes if codes.ndim else int(codes)
    if "final_info" in info:
        coded["final_info"] = _coded(info["final_info"])
    return coded


def _code(failure: Any) -> int:
    # A simulation that an info is not about has None, or 0 in Gymnasium's own.
    if not failure:
        return 0
    if failure not in FAILURES:
        raise ValueError(f"failure {failure!r} has no code; known are {FAILURES}")
    return FAILURES.index(failure)
