"""Wrappers, Gymnasium's and ours, around these environments, one and many."""

import re
import warnings
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env, data_equivalence
from gymnasium.wrappers import (
    FlattenObservation,
    FrameStackObservation,
    NormalizeObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    RescaleAction,
    TimeAwareObservation,
    vector,
)

import gplfd_env
from gplfd_env.wrappers import FAILURES, REASONS, NumericInfo, VectorNumericInfo

pytestmark = pytest.mark.slow

POSE, RL = gplfd_env.ENVIRONMENT_ID, gplfd_env.RL_ENVIRONMENT_ID
PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")
SMALL = {"render_mode": "rgb_array", "width": 64, "height": 48}
REST = np.zeros(6, np.float32)
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


@both
def test_observations_can_be_normalised(id, opened):
    flat = (lambda env: env) if id == RL else FlattenObservation
    one = NormalizeObservation(flat(gym.make(id, randomization="hard")))
    flat = (lambda envs: envs) if id == RL else vector.FlattenObservation
    many = vector.NormalizeObservation(flat(gym.make_vec(id, 3)))
    for env, shape in ((opened(one), (6,)), (opened(many), (3, 6))):
        observation, _ = env.reset(seed=0)
        for action in actions(50, shape):
            assert observation.shape == (*shape[:-1], 33)
            assert observation in env.observation_space
            assert np.abs(observation).max() < 50.0
            observation, *_ = env.step(action)


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


def test_the_number_of_steps_stands_beside_the_time(opened):
    """Gymnasium's own name for it is that of the environment's seconds."""
    env = opened(TimeAwareObservation(gym.make(RL)))
    env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(REST)
    assert observation.shape == (34,)
    assert observation[[26, -1]] == pytest.approx([0.03, 3.0])
    assert observation in env.observation_space
    env = opened(gym.make(POSE))
    with pytest.raises(ValueError, match=r"dict_time_key.*already exists"):
        TimeAwareObservation(env, flatten=False)
    timed = TimeAwareObservation(env, flatten=False, dict_time_key="step")
    timed.reset(seed=0)
    observation, *_ = timed.step(REST)
    assert (observation["step"], observation["time"]) == (1, pytest.approx(0.01))
    assert observation in timed.observation_space


@both
def test_observations_can_be_stacked(id, opened):
    env = opened(FrameStackObservation(gym.make(id), 3))
    env.reset(seed=0)
    observation, *_ = env.step(REST)
    assert observation in env.observation_space
    times = observation[:, 26] if id == RL else observation["time"][:, 0]
    assert times == pytest.approx([0.0, 0.0, 0.01])


@both
def test_single_environments_and_theirs_need_gymnasium_s_vectorisation(id, opened):
    """The page says what stands in their place here."""
    with pytest.raises(gym.error.Error, match="with the wrappers argument"):
        gym.make_vec(id, 2, wrappers=[RecordEpisodeStatistics])
    given = {"door": 0.42, "randomization": "hard"}
    ours = opened(gym.make_vec(id, 2, **given)).unwrapped
    sync = gym.make_vec(
        id,
        2,
        vectorization_mode="sync",
        wrappers=[RecordEpisodeStatistics],
        **given,
    )
    assert isinstance(opened(sync).envs[0], RecordEpisodeStatistics)
    for name in ("call", "get_attr", "set_attr"):
        assert not hasattr(ours, name)
        assert f"`{name}`" in PAGE
    for envs in (ours, sync):
        envs.reset(seed=3)
    assert sync.get_attr("variation") == ours.variations
    assert sync.call("get_wrapper_attr", "variation") == ours.variations
    sync.set_attr("label", ["a", "b"])
    assert sync.get_attr("label") == ("a", "b")


@pytest.mark.needs("opengl")
def test_videos_of_one_and_of_many_can_be_recorded(tmp_path):
    one = gym.make(POSE, max_episode_steps=5, **SMALL)
    many = gym.make_vec(RL, 2, max_episode_steps=5, **SMALL)
    for env, wrap, shape in (
        (one, RecordVideo, (6,)),
        (many, vector.RecordVideo, (2, 6)),
    ):
        folder = tmp_path / wrap.__module__
        wrapped = wrap(env, str(folder))
        wrapped.reset(seed=0)
        for _ in range(5):
            wrapped.step(np.zeros(shape, np.float32))
        wrapped.close()
        films = list(folder.glob("*.mp4"))
        assert films
        assert all(film.stat().st_size > 500 for film in films)


# --- Infos of numbers alone ----------------------------------------------------------


def leaves(value: Any) -> Iterator[Any]:
    if isinstance(value, Mapping):
        for inner in value.values():
            yield from leaves(inner)
    else:
        yield value


def test_codes_are_those_of_the_page():
    (row,) = re.findall(r"^\| `failure` \| str .*$", PAGE, re.MULTILINE)
    assert re.findall(r'`"(\w*)"`', row) == list(FAILURES)


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


@pytest.mark.parametrize("mode", ["NextStep", "SameStep", "Disabled"])
def test_vectorised_infos_can_become_tensors(make_vec, mode):
    """Other libraries take arrays over by DLPack, as Gymnasium's NumpyToTorch does."""
    plain = make_vec(2, autoreset_mode=mode)
    coded = VectorNumericInfo(make_vec(2, autoreset_mode=mode))
    _, infos = plain.reset(seed=0)
    with pytest.raises(BufferError):
        np.from_dlpack(infos["failure"])
    _, infos = coded.reset(seed=0)
    actions = np.stack([AWAY, 0.0 * AWAY])
    said = []
    for _ in range(60):
        *_, expected = plain.step(actions)
        *_, infos = coded.step(actions)
        ends = [(infos, expected)]
        if "final_info" in expected:
            ends.append((infos["final_info"], expected["final_info"]))
        for ours, theirs in ends:
            codes = ours["failure_code"]
            assert [FAILURES[code] for code in codes] == theirs["failure"].tolist()
            assert ours["_failure_code"].tolist() == theirs["_failure"].tolist()
            said.append(codes.tolist())
            if ours is infos and "final_info" not in infos:
                for leaf in leaves(infos):
                    np.from_dlpack(leaf)
    assert [1, 0] in said


def test_a_failure_without_a_code_is_named(make_env):
    class Odd(gym.Wrapper[Any, Any, Any, Any]):
        def reset(self, **_: Any) -> Any:
            return None, {"failure": "melted"}

    with pytest.raises(ValueError, match="failure 'melted' has no code; known are"):
        NumericInfo(Odd(make_env())).reset()
