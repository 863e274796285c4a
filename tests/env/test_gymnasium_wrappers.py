"""Gymnasium's own wrappers and helpers on these environments, one and many."""

import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.wrappers import (
    FlattenObservation,
    FrameStackObservation,
    NormalizeObservation,
    RecordEpisodeStatistics,
    RecordVideo,
    TimeAwareObservation,
    vector,
)

import gplfd_env

pytestmark = pytest.mark.slow

POSE, RL = gplfd_env.ENVIRONMENT_ID, gplfd_env.RL_ENVIRONMENT_ID
IDS = (POSE, RL)
PAGE = (Path(__file__).parents[2] / "docs" / "environment.md").read_text("utf-8")
MODES = ("NextStep", "SameStep", "Disabled")

both = pytest.mark.parametrize("id", IDS)
SMALL = {"render_mode": "rgb_array", "width": 64, "height": 48}


@pytest.fixture
def opened() -> Any:
    """Return a function that keeps an environment and closes it after the test."""
    kept: list[Any] = []

    def keep(env: Any) -> Any:
        kept.append(env)
        return env

    yield keep
    for env in kept:
        env.close()


def actions(n: int, shape: tuple[int, ...]) -> np.ndarray:
    rng = np.random.default_rng(0)
    return (0.02 * rng.uniform(-1.0, 1.0, (n, *shape))).astype(np.float32)


@both
def test_the_package_s_name_in_the_id_replaces_the_import(
    id: str, tmp_path: Path
) -> None:
    program = (
        "import gymnasium\n"
        "for make in (gymnasium.make, gymnasium.make_vec):\n"
        f"    env = make('gplfd_env:{id}', door=0.4)\n"
        "    env.reset(seed=0); print(env.spec.id); env.close()"
    )
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    assert (ran.stderr, ran.stdout.split()) == ("", [id, id])


def test_without_it_gymnasium_names_the_namespace(tmp_path: Path) -> None:
    program = (
        "import gymnasium\n"
        "for make in (gymnasium.make, gymnasium.make_vec, gymnasium.spec):\n"
        "    try:\n"
        f"        make('{RL}')\n"
        "    except gymnasium.error.NamespaceNotFound as error:\n"
        "        print(type(error).__name__, error, sep=': ')"
    )
    ran = subprocess.run(
        [sys.executable, "-c", program],
        capture_output=True,
        text=True,
        check=False,
        cwd=tmp_path,
    )
    said = "NamespaceNotFound: Namespace gplfd not found"
    assert ran.stdout.count(said) == 3, ran.stderr
    assert "NamespaceNotFound: Namespace gplfd not found" in PAGE.replace("\n", " ")


@both
def test_statistics_of_an_episode_are_the_sum_of_its_rewards(
    id: str, opened: Callable
) -> None:
    env = opened(RecordEpisodeStatistics(gym.make(id, max_episode_steps=30)))
    env.reset(seed=0)
    rewards = [env.step(action) for action in actions(30, (6,))]
    *_, truncated, info = rewards[-1]
    assert truncated
    total = sum(result[1] for result in rewards)
    assert info["episode"]["r"] == pytest.approx(total, abs=1e-12)
    assert info["episode"]["l"] == 30
    if id == RL:
        assert info["return"] == pytest.approx(total, abs=1e-12)
        assert total < 0.0 < info["peak_force"]


@both
@pytest.mark.parametrize("mode", MODES)
def test_statistics_of_many_are_those_of_one(
    id: str, mode: str, opened: Callable
) -> None:
    doors, limit = ["small", "heavy"], 25
    envs = vector.RecordEpisodeStatistics(
        gym.make_vec(id, 2, door=doors, max_episode_steps=limit, autoreset_mode=mode)
    )
    opened(envs).reset(seed=0)
    for action in actions(limit, (6,)):
        *_, infos = envs.step(np.stack([action, action]))
    for row, door in enumerate(doors):
        env = RecordEpisodeStatistics(gym.make(id, door=door, max_episode_steps=limit))
        opened(env).reset(seed=row)
        for action in actions(limit, (6,)):
            *_, info = env.step(action)
        for name in ("r", "l"):
            assert infos["episode"][name][row] == info["episode"][name]


@both
def test_observations_can_be_normalised(id: str, opened: Callable) -> None:
    flat = (lambda env: env) if id == RL else FlattenObservation
    env = opened(NormalizeObservation(flat(gym.make(id, randomization="hard"))))
    flat = (lambda envs: envs) if id == RL else vector.FlattenObservation
    envs = opened(vector.NormalizeObservation(flat(gym.make_vec(id, 3))))
    for each, shape in ((env, (6,)), (envs, (3, 6))):
        observation, _ = each.reset(seed=0)
        for action in actions(50, shape):
            assert observation.shape == (*shape[:-1], 33)
            assert observation in each.observation_space
            assert np.abs(observation).max() < 50.0
            observation, *_ = each.step(action)


def test_the_step_stands_behind_a_flat_observation(opened: Callable) -> None:
    """Beside the seconds, which are entry 26."""
    env = opened(TimeAwareObservation(gym.make(RL)))
    env.reset(seed=0)
    for _ in range(3):
        observation, *_ = env.step(np.zeros(6, np.float32))
    assert observation.shape == (34,)
    assert observation[-1] == 3.0
    assert observation[26] == pytest.approx(0.03)
    assert observation in env.observation_space


@both
def test_observations_can_be_stacked(id: str, opened: Callable) -> None:
    env = opened(FrameStackObservation(gym.make(id), 3))
    env.reset(seed=0)
    observation, *_ = env.step(np.zeros(6, np.float32))
    assert observation in env.observation_space
    times = observation[:, 26] if id == RL else observation["time"][:, 0]
    assert times == pytest.approx([0.0, 0.0, 0.01])


@both
def test_wrappers_of_single_environments_need_gymnasium_s_vectorisation(
    id: str, opened: Callable
) -> None:
    with pytest.raises(gym.error.Error, match="with the wrappers argument"):
        gym.make_vec(id, 2, wrappers=[RecordEpisodeStatistics])
    sync = gym.make_vec(
        id, 2, vectorization_mode="sync", wrappers=[RecordEpisodeStatistics]
    )
    assert isinstance(opened(sync).envs[0], RecordEpisodeStatistics)


@both
def test_attributes_of_single_environments_are_asked_for_there(
    id: str, opened: Callable
) -> None:
    """The page says what stands in their place here."""
    ours = opened(gym.make_vec(id, 2, door=0.42, randomization="hard")).unwrapped
    for name in ("call", "get_attr", "set_attr"):
        assert not hasattr(ours, name)
        assert f"`{name}`" in PAGE
    sync = opened(
        gym.make_vec(id, 2, vectorization_mode="sync", door=0.42, randomization="hard")
    )
    for envs in (ours, sync):
        envs.reset(seed=3)
    assert sync.get_attr("variation") == ours.variations
    assert sync.call("get_wrapper_attr", "variation") == ours.variations
    sync.set_attr("label", ["a", "b"])
    assert sync.get_attr("label") == ("a", "b")


@pytest.mark.needs("opengl")
def test_videos_of_one_and_of_many_can_be_recorded(tmp_path: Path) -> None:
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


@pytest.mark.needs("opengl")
@both
def test_pictures_are_collected(id: str, opened: Callable) -> None:
    env = opened(gym.make(id, **{**SMALL, "render_mode": "rgb_array_list"}))
    env.reset(seed=0)
    env.step(np.zeros(6, np.float32))
    first, second = env.render()
    assert first.shape == second.shape == (48, 64, 3)
