"""A reward for gentle opening.

The reward of a step is the increase of a score in that step, so that an episode's
return is the score at its end:

    min(φ, 60°)/60° - max |F|/20 N - max s/20 mm + 1 if held

with the opening angle φ, and the greatest force F and slip s so far. The score does not
grow with time; docs/environment.md explains its derivation.
"""

from collections.abc import Mapping
from typing import Any, Final, cast

import gymnasium as gym
import numpy as np
from gymnasium.vector import AutoresetMode

from gplfd_env.conventions.constants import SUCCESS_ANGLE, Array, Info, Mask
from gplfd_env.conventions.one_and_many import mapped, where
from gplfd_env.conventions.resets import masked

FORCE_SCALE: Final = 20.0
"""Force whose cost equals the reward of the whole progress [N]: the grasp holds it."""
SLIP_SCALE: Final = 0.02
"""Slip with the same cost [m]: here the handle leaves the fingers."""

# Forces that are not needed to open: across the handle's path, on people, on stops [N].
_HARMFUL: Final = ("force_radial", "person_force", "stop_force")


class GentleReward(gym.Wrapper[Any, Any, Any, Any]):
    """Reward the opening, with costs for the greatest force and the greatest slip.

    Adds to ``info``: ``peak_force`` [N], ``peak_slip`` [m] and ``return`` so far, and
    this reward's ``reward_terms``: ``progress``, ``force``, ``slip``, ``success``.
    """

    _score: "Score"

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin an episode."""
        observation, info = self.env.reset(seed=seed, options=options)
        self._score = Score(info)
        return observation, {**info, **_floats(self._score.info)}

    def step(self, action: Any) -> tuple[Any, float, bool, bool, Info]:
        """Act for one control period."""
        observation, _, terminated, truncated, info = self.env.step(action)
        score = self._score
        score.advance(info)
        with_score = {**info, **_floats(score.info)}
        return observation, float(score.reward), terminated, truncated, with_score


class VectorGentleReward(gym.vector.VectorWrapper[Any, Any, Any, Any, Any]):
    """`GentleReward` for vector environments, in every autoreset mode."""

    def __init__(self, env: gym.vector.VectorEnv[Any, Any, Any]) -> None:
        super().__init__(env)
        self._mode = env.metadata["autoreset_mode"]
        self._score: Score | None = None
        self._ended = np.zeros(env.num_envs, dtype=bool)

    def reset(self, *, seed: Any = None, options: Any = None) -> tuple[Any, Info]:
        """Begin episodes."""
        observations, infos = self.env.reset(seed=seed, options=options)
        rows = infos["_door_angle"]
        if self._score is None:
            self._score = Score(infos)
        self._score.restart(infos, rows)
        self._ended = self._ended & ~rows
        return observations, infos | masked(self._score.info, rows)

    def step(self, actions: Any) -> tuple[Any, Array, Mask, Mask, Info]:
        """Act for one control period."""
        observations, _, terminations, truncations, infos = self.env.step(actions)
        # Before the first reset, the environment's step has raised an error.
        score, everyone = cast("Score", self._score), np.ones(self.num_envs, bool)
        if self._mode is AutoresetMode.NEXT_STEP:
            score.restart(infos, self._ended)
        self._ended = terminations | truncations
        at_once = self._mode is AutoresetMode.SAME_STEP and bool(self._ended.any())
        score.advance(_ended_as(infos, self._ended) if at_once else infos)
        rewards = score.reward
        if at_once:
            final = infos["final_info"] | masked(score.info, self._ended)
            score.restart(infos, self._ended)
            infos = {**infos, "final_info": final}
        infos = infos | masked(score.info, everyone)
        return observations, rewards, terminations, truncations, infos


class Score:
    """Score of one episode, or of each of many, given the info of its reset."""

    def __init__(self, info: Mapping[str, Any]) -> None:
        self.peak_force, self.peak_slip = _harm(info), np.abs(info["slip"])
        self._values = self._now(info)
        self.terms = {name: value - value for name, value in self._values.items()}
        self.earned = self.reward

    @property
    def reward(self) -> Any:
        """Reward of the last step."""
        progress, force, slip, success = self.terms.values()
        return progress + force + slip + success

    @property
    def info(self) -> Info:
        """Entries added to the info; arrays are new."""
        so_far = {"peak_force": self.peak_force, "peak_slip": self.peak_slip}
        sums = {name: x + 0.0 for name, x in (so_far | {"return": self.earned}).items()}
        return {"reward_terms": dict(self.terms)} | sums

    def advance(self, info: Mapping[str, Any]) -> None:
        """Update from the info of the next step."""
        self.peak_force = np.maximum(self.peak_force, _harm(info))
        self.peak_slip = np.maximum(self.peak_slip, info["slip"])
        before, self._values = self._values, self._now(info)
        self.terms = {name: self._values[name] - before[name] for name in before}
        self.earned = self.earned + self.reward

    def restart(self, info: Mapping[str, Any], rows: Mask) -> None:
        """Restart the score in some of many environments."""
        if rows.any():
            states = vars(Score(info)), vars(self)
            vars(self).update(mapped(lambda new, old: where(rows, new, old), *states))

    def _now(self, info: Mapping[str, Any]) -> dict[str, Any]:
        """Return the terms of the score."""
        return {
            "progress": np.minimum(info["door_angle"], SUCCESS_ANGLE) / SUCCESS_ANGLE,
            "force": -self.peak_force / FORCE_SCALE,
            "slip": -self.peak_slip / SLIP_SCALE,
            "success": np.multiply(info["success"], 1.0),
        }


def _harm(info: Mapping[str, Any]) -> Any:
    """Return the greatest of the forces that are not needed to open [N]."""
    return np.max(np.abs([info[name] for name in _HARMFUL]), axis=0)


def _floats(values: Info) -> Info:
    """Return the numbers of one episode as Python floats."""
    items = values.items()
    return {x: _floats(y) if isinstance(y, dict) else float(y) for x, y in items}


def _ended_as(infos: Info, ended: Mask) -> Info:
    """Return infos in which ended episodes have the values of their last step."""
    final = infos["final_info"]
    read = (*_HARMFUL, "slip", "door_angle", "success")
    return {name: np.where(ended, final[name], infos[name]) for name in read}
