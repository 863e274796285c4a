"""Wrappers, Gymnasium's and ours, around these environments, one and many."""

import warnings
from collections.abc import Iterator, Mapping
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers import (
    FlattenObservation,
    RecordEpisodeStatistics,
    RescaleAction,
    vector,
)

import gplfd_env
from gplfd_env.wrappers import FAILURES, REASONS, NumericInfo

pytestmark = pytest.mark.slow

POSE, RL = gplfd_env.ENVIRONMENT_ID, gplfd_env.RL_ENVIRONMENT_ID
AWAY = np.array([0.6, 0.0, 0.0, 0.0, 0.0, 0.0])
"""So fast that the hand loses the handle."""

both = pytest.mark.parametrize("id", [POSE, RL])


def actions(n: int, shape: tuple[int, ...]) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (0.02 * rng.uniform(-1.0, 1.0, (n, *shape))).astype(np.float32)


# --- Gymnasium's ---------------------------------------------------------------------


@both
@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_statistics_are_the_sums_of_rewards_of_one_and_of_many(id, mode, opened):
    doors, limit = ["small", "heavy"], 25
    envs = opened(
        vector.RecordEpisodeStatistics(
            gym.make_vec(
                id, 2, door=doors, max_episode_steps=limit, autoreset_mode=mode
            )
        )
    )
    envs.reset(seed=0)
    for action in actions(limit, (6,)):
        *_, infos = envs.step(np.stack([action, action]))
    for row, door in enumerate(doors):
        env = opened(
            RecordEpisodeStatistics(gym.make(id, door=door, max_episode_steps=limit))
        )
        env.reset(seed=row)
        results = [env.step(action) for action in actions(limit, (6,))]
        *_, truncated, info = results[-1]
        assert truncated
        total = sum(result[1] for result in results)
        assert info["episode"]["r"] == pytest.approx(total, abs=1e-12)
        assert info["episode"]["l"] == limit
        for name in ("r", "l"):
            assert infos["episode"][name][row] == info["episode"][name]
        if id == RL:
            assert info["return"] == pytest.approx(total, abs=1e-12)
            assert total < 0.0 < info["peak_force"]


@pytest.mark.parametrize(
    ("id", "numbers"), [(POSE, 33), (gplfd_env.MOBILE_ENVIRONMENT_ID, 39)]
)
def test_flat_and_with_rescaled_actions_it_passes_without_a_remark(
    id, numbers, make_env, make_vec
):
    """Two wrappers of Gymnasium give learners a Box in and a Box of ±1 out."""
    flat = FlattenObservation(make_env(id=id, randomization="mild"))
    env = RescaleAction(flat, -1.0, 1.0)
    assert env.observation_space.shape == (numbers,)
    assert np.all(env.action_space.high == 1.0)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        # It is wrapped, and that is the point.
        warnings.filterwarnings("ignore", message=".*different from the unwrapped")
        check_env(env, skip_render_check=True)
    envs = vector.RescaleAction(make_vec(2, id=id), -1.0, 1.0)
    assert np.all(envs.single_action_space.high == 1.0)


# --- Infos of numbers alone ----------------------------------------------------------


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        for inner in value.values():
            yield from leaves(inner)
    else:
        yield value


def test_an_info_holds_numbers_only(make_env):
    plain, coded = make_env("small"), NumericInfo(make_env("small"))
    plain.reset(seed=0)
    _, after = coded.reset(seed=0)
    assert after["failure_code"] == 0
    terminated = False
    while not terminated:
        _, _, terminated, _, before = plain.step(AWAY)
        *_, after = coded.step(AWAY)
        assert all(not isinstance(leaf, str) for leaf in leaves(after))
    assert FAILURES[after["failure_code"]] == before["failure"] == "grasp_lost"
    assert REASONS[after["reason_code"]] == before["reason"]
    assert after["stage_code"] == before["capability"]
    for name in ("failure", "reason", "stage"):
        del before[name], after[f"{name}_code"]
    assert data_equivalence(before, after, exact=True)
