"""A recorded data set: readable by Minari itself, complete, whole or absent."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import minari
import mujoco
import numpy as np
import pytest

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.spatial.se3 import handle_pose_on_arc
from gplfd_env.task.info import TEXTS
from gplfd_experiments.data.minari import Recorder, open_dataset, outcome, write_dataset

pytestmark = pytest.mark.slow

N_STEPS = 12
OPTIONS: dict[str, Any] = {"door": {"radius": 0.4, "hinge_friction": 1.5}}
PARTS = ("observations", "actions", "rewards", "terminations", "truncations")
Env = gym.Env[Any, Any]


@pytest.fixture(scope="module")
def env() -> Iterator[Env]:
    made = gym.make(ENVIRONMENT_ID, max_episode_steps=N_STEPS)
    yield made
    made.close()


def record(env: Env, seed: int, options: Any = None) -> Any:
    """Pull the door as far as the time limit allows."""
    recorder = Recorder(env)
    recorder.reset(seed=seed, options=options)
    truncated, angle = False, 0.0
    while not truncated:
        angle += 0.01
        _, _, _, truncated, _ = recorder.step(handle_pose_on_arc(0.4, angle))
    return recorder.episode


@pytest.fixture(scope="module")
def episodes(env: Env) -> list[Any]:
    return [record(env, 3), record(env, 4, OPTIONS)]


def write(path: Path, episodes: Any, env: Env, policy: str = "a", **more: Any) -> None:
    write_dataset(path, episodes, env=env, policy=policy, config={"a": 1}, **more)


@pytest.fixture(scope="module")
def folder(env: Env, episodes: Any, tmp_path_factory: Any) -> Path:
    path = Path(tmp_path_factory.mktemp("root") / "pulled-v2")
    write(path, episodes, env, "by hand")
    return path


def assert_same(found: Any, expected: Any) -> None:
    """Bit for bit, through nested mappings."""
    if isinstance(expected, Mapping):
        assert set(found) == set(expected)
        for name in expected:
            assert_same(found[name], expected[name])
    elif np.asarray(expected).dtype.kind == "U":
        assert [text.decode() for text in found] == list(expected)
    else:
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
        assert found.tobytes() == expected.tobytes()


def test_minari_reads_every_bit_seed_and_option(folder, episodes):
    dataset = minari.MinariDataset(folder / "data")
    assert (dataset.id, dataset.total_steps) == ("pulled-v2", 2 * N_STEPS)
    for stored, episode in zip(dataset, episodes, strict=True):
        for name in (*PARTS, "infos"):
            assert_same(getattr(stored, name), getattr(episode, name))
        assert set(TEXTS) <= set(stored.infos)
    first, second = dataset.storage.get_episode_metadata([0, 1])
    assert (first["seed"], second["seed"]) == (3, 4)
    assert "options" not in first
    assert second["options"] == OPTIONS


def test_it_says_how_it_was_recorded(folder, episodes):
    dataset = open_dataset(folder)
    assert dataset.path == folder
    for number, expected in enumerate(episodes):
        episode = dataset.episode(number)
        for name in PARTS:
            assert_same(getattr(episode, name), getattr(expected, name))
        assert (episode.seed, episode.options) == (expected.seed, expected.options)
        assert outcome(episode) == outcome(expected) == "time limit"
    assert (dataset.n_episodes, dataset.policy) == (2, "by hand")
    assert dataset.environment == ENVIRONMENT_ID
    assert dataset.arguments["max_episode_steps"] == N_STEPS
    assert dataset.origin["config"] == {"a": 1}
    assert dataset.origin["versions"]["mujoco"] == mujoco.__version__


def test_a_data_set_is_whole_or_absent_and_replaced_when_told(env, episodes, tmp_path):
    def interrupted() -> Iterator[Any]:
        yield episodes[0]
        raise KeyboardInterrupt

    with pytest.raises(ValueError, match="for example door-opening-v0"):
        write(tmp_path / "a b-v0", [], env)
    target = tmp_path / "a-v0"
    with pytest.raises(KeyboardInterrupt):
        write(target, interrupted(), env)
    assert not any(tmp_path.iterdir())
    write(target, episodes[:1], env, "first")
    with pytest.raises(ValueError, match=r"exists; give another folder, or --overwr"):
        write(target, episodes, env, "second")
    assert open_dataset(target).policy == "first"
    write(target, episodes, env, "fourth", overwrite=True)
    dataset = open_dataset(target)
    assert (dataset.policy, dataset.n_episodes) == ("fourth", 2)
    assert [path.name for path in tmp_path.iterdir()] == ["a-v0"]
