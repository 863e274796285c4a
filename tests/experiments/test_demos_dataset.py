"""A recorded data set: readable by Minari itself, complete, whole or absent."""

import json
import os
import resource
import shutil
import subprocess
import sys
from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import gymnasium as gym
import h5py
import minari
import mujoco
import numpy as np
import pytest
from numpy.testing import assert_array_equal

from gplfd_env import ENVIRONMENT_ID
from gplfd_env.doors.config import DoorConfig, door_config
from gplfd_env.doors.randomization import DoorRandomization
from gplfd_env.spatial.arc import handle_pose_on_arc
from gplfd_env.task.info import TEXTS
from gplfd_experiments.data.minari import (
    RecordedEpisode,
    Recorder,
    open_dataset,
    write_dataset,
)
from gplfd_experiments.data.minari.episode import (
    flat,
    model_digests,
    model_hash,
    physics_state,
    state_layout,
)
from gplfd_experiments.data.replay import compare, replay

pytestmark = pytest.mark.slow

N_STEPS = 12
OPTIONS: dict[str, Any] = {"door": {"radius": 0.4, "hinge_friction": 1.5}}
Env = gym.Env[Any, Any]
Episodes = list[RecordedEpisode]


@pytest.fixture(scope="module")
def env() -> Iterator[Env]:
    made = gym.make(ENVIRONMENT_ID, max_episode_steps=N_STEPS)
    yield made
    made.close()


def record(env: Env, seed: int, options: Any = None) -> RecordedEpisode:
    """Pull the door as far as the time limit allows."""
    recorder = Recorder(env)
    recorder.reset(seed=seed, options=options)
    truncated, angle = False, 0.0
    while not truncated:
        angle += 0.01
        _, _, _, truncated, _ = recorder.step(handle_pose_on_arc(0.4, angle))
    return recorder.episode


def stepped(env: Env, seed: int, options: Any = None) -> RecordedEpisode:
    recorder = Recorder(env)
    recorder.reset(seed=seed, options=options)
    recorder.step(np.zeros(6))
    return recorder.episode


@pytest.fixture(scope="module")
def episodes(env: Env) -> Episodes:
    return [record(env, 3), record(env, 4, OPTIONS)]


def write(
    path: Path, episodes: Any, env: Env, policy: str = "by hand", **more: Any
) -> None:
    write_dataset(path, episodes, env=env, policy=policy, config={"a": 1}, **more)


@pytest.fixture(scope="module")
def folder(env: Env, episodes: Episodes, tmp_path_factory: Any) -> Path:
    path = Path(tmp_path_factory.mktemp("root") / "pulled-v2")
    write(path, episodes, env)
    return path


def assert_same(found: Any, expected: Any) -> None:
    """Bit for bit, through nested mappings."""
    if isinstance(expected, Mapping):
        assert set(found) == set(expected)
        for name in expected:
            assert_same(found[name], expected[name])
    elif np.asarray(expected).dtype.kind == "U":
        assert [str(text) for text in found] == list(expected)
    else:
        assert (found.dtype, found.shape) == (expected.dtype, expected.shape)
        assert found.tobytes() == expected.tobytes()


def test_minari_reads_every_bit_seed_and_option(folder, episodes):
    dataset = minari.MinariDataset(folder / "data")
    assert (dataset.id, dataset.total_steps) == ("pulled-v2", 2 * N_STEPS)
    metadata = json.loads((folder / "data/metadata.json").read_text())
    assert f"mujoco=={mujoco.__version__}" in metadata["requirements"]
    assert metadata["algorithm_name"] == "by hand"
    for stored, episode in zip(dataset, episodes, strict=True):
        texts = {name: [t.decode() for t in stored.infos[name]] for name in TEXTS}
        assert_same(stored.observations, episode.observations)
        assert_same(flat({**stored.infos, **texts}), episode.infos)
        for name in ("actions", "rewards", "terminations", "truncations"):
            assert_same(getattr(stored, name), getattr(episode, name))
        last = {name: rows[-1] for name, rows in stored.observations.items()}
        assert dataset.observation_space.contains(last)
    first, second = dataset.storage.get_episode_metadata([0, 1])
    assert (first["seed"], second["seed"]) == (3, 4)
    assert "options" not in first
    assert second["options"] == OPTIONS
    hashes = [one["gplfd"]["model_hash"] for one in (first, second)]
    assert hashes == [model_hash(one.model_digests) for one in episodes]
    assert hashes[0] != hashes[1]
    # The states are packed, and nothing else stands in the folder.
    with h5py.File(folder / "data/main_data.hdf5") as file:
        states = file["episode_0/infos/physics_state"]
        assert states.id.get_storage_size() < 0.4 * episodes[0].states.nbytes
    assert listed(folder / "data") == {"main_data.hdf5", "metadata.json"}


def test_minari_finds_it_by_id_and_recovers_the_environment(folder):
    """In a process that knows nothing of this package."""
    code = (
        "import minari\n"
        "env = minari.load_dataset('pulled-v2').recover_environment()\n"
        "print(env.spec.id, env.spec.max_episode_steps)\n"
        "print(sorted(env.reset(seed=0)[0]))\n"
    )
    ran = subprocess.run(
        [sys.executable, "-W", "error::UserWarning", "-c", code],
        env=os.environ | {"MINARI_DATASETS_PATH": str(folder.parent)},
        capture_output=True,
        text=True,
        check=True,
    )
    assert f"{ENVIRONMENT_ID} {N_STEPS}" in ran.stdout
    assert "'ee_pose'" in ran.stdout


def test_it_says_how_it_was_recorded(folder, episodes):
    for path in (folder, folder / "data"):
        dataset = open_dataset(path)
        assert dataset.path == folder
        # Episodes are the recorded ones, with their models and seeds.
        for number, expected in enumerate(episodes):
            assert compare(expected, dataset.episode(number)).exact
            assert dataset.episode(number).options == expected.options
            assert dataset.episode(number).seed == expected.seed
    assert (dataset.n_episodes, dataset.policy) == (2, "by hand")
    assert dataset.environment == ENVIRONMENT_ID
    assert dataset.arguments["max_episode_steps"] == N_STEPS
    assert dataset.origin["config"] == {"a": 1}
    assert dataset.origin["versions"]["mujoco"] == mujoco.__version__


@pytest.fixture
def copied(folder: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(folder, tmp_path / folder.name))


def test_minari_can_append(copied, episodes):
    """Packing must not freeze the file: a new episode, and more of an old one."""
    from minari.data_collector.episode_buffer import EpisodeBuffer

    grown = minari.MinariDataset(copied / "data")
    stored = grown[0]
    names = ("observations", "actions", "rewards", "terminations", "truncations")
    more = {name: getattr(stored, name) for name in names}
    for number in (2, 0):
        buffer = EpisodeBuffer(id=number, infos={}, **more)
        grown.storage.update_episodes([buffer])
    longer, _, new = minari.MinariDataset(copied / "data")
    assert_same(new.observations, episodes[0].observations)
    assert len(longer.actions) == 2 * N_STEPS


def test_a_recording_is_of_one_episode_as_it_was_seen(env):
    """What becomes of the arrays later, and another reset, leave it alone."""
    recorder = Recorder(env)
    with pytest.raises(ValueError, match=r"needs a seed.*reset\(seed=\.\.\.\)"):
        recorder.reset()
    recorder.reset(seed=2)
    with pytest.raises(ValueError, match="nothing is recorded yet"):
        _ = recorder.episode
    recorder.step(np.zeros(6))
    observation, info = recorder.reset(seed=0)
    action = np.full(6, 0.01)
    for name in observation:
        observation[name][:] = 99.0
    info["handle_pose"][:] = 99.0
    for _ in range(3):
        recorder.step(action)
    action[:] = 99.0
    episode = recorder.episode
    assert (episode.seed, len(episode), len(episode.states)) == (0, 3, 4)
    assert np.abs(episode.observations["ee_pose"]).max() < 1.0
    assert np.abs(episode.infos["handle_pose"]).max() < 1.0
    assert np.all(episode.actions == 0.01)


def test_a_state_is_all_that_the_next_step_needs(episodes):
    episode, start = episodes[0], 5
    env = gym.make(ENVIRONMENT_ID)
    env.reset(seed=99)
    model, data = (getattr(env.unwrapped, name) for name in ("model", "data"))
    every = int(mujoco.mjtState.mjSTATE_INTEGRATION)
    mujoco.mj_setState(model, data, episode.states[start], every)
    for step in range(start, N_STEPS):
        env.step(episode.actions[step])
        state = physics_state(model, data)
        assert state.tobytes() == episode.states[step + 1].tobytes()
    # The layout names its parts.
    layout = state_layout(model)
    ends = np.cumsum(list(layout.values()))
    parts = dict(zip(layout, np.split(state, ends[:-1]), strict=True))
    for name in ("qpos", "qvel", "ctrl"):
        assert_array_equal(parts[name], getattr(data, name))
    assert_array_equal(parts["warmstart"], data.qacc_warmstart)
    assert parts["time"] == data.time


MODEL = (
    "<mujoco><worldbody><body><joint/><geom size='0.1' {geom}/></body></worldbody>"
    "<option {option}/></mujoco>"
)


@pytest.mark.parametrize(
    ("geom", "option", "differing"),
    [
        ("", "", set()),
        ("friction='0.9'", "", {"geom"}),
        ("", "gravity='0 0 -9.8'", {"opt"}),
        ("", "timestep='0.0020000000000000005'", {"opt"}),
    ],
)
def test_digests_tell_which_part_of_the_model_differs(geom, option, differing):
    texts = MODEL.format(geom="", option=""), MODEL.format(geom=geom, option=option)
    first, second = (
        model_digests(mujoco.MjModel.from_xml_string(text)) for text in texts
    )
    assert {part for part in first if first[part] != second[part]} == differing
    assert (model_hash(first) == model_hash(second)) == (not differing)


def test_options_stay_in_force_and_records_are_kept_as_mappings():
    """An episode is the same whatever was run before it in the same environment."""
    recorder = Recorder(gym.make(ENVIRONMENT_ID))
    recorder.reset(seed=1, options={"door": DoorConfig(radius=0.4)})
    recorder.step(np.zeros(6))
    first = recorder.episode
    assert list(first.options) == ["door"]
    assert door_config(first.options["door"]) == DoorConfig(radius=0.4)
    recorder.reset(seed=2)
    recorder.step(np.zeros(6))
    assert recorder.episode.options == first.options
    again = replay(recorder.episode, gym.make(ENVIRONMENT_ID))
    assert compare(recorder.episode, again).exact


def test_a_randomization_record_survives_the_file(tmp_path):
    drawn = DoorRandomization(radius=(0.4, 0.5), wrench_noise=(0.5, 0.05))
    fresh = gym.make(ENVIRONMENT_ID)
    write(tmp_path / "a-v0", [stepped(fresh, 1, {"randomization": drawn})], fresh)
    stored = open_dataset(tmp_path / "a-v0")
    episode = stored.episode(0)
    assert compare(episode, replay(episode, stored.make_environment())).exact
    assert 0.4 < episode.infos["door_radius"][0] < 0.5


class OddInfo(gym.Wrapper[Any, Any, Any, Any]):
    """An environment with one more info, after the first step only if so wanted."""

    def __init__(self, env: Env, rows: list[dict[str, Any]]) -> None:
        super().__init__(env)
        self.rows = list(rows)

    def reset(self, **arguments: Any) -> Any:
        observation, info = self.env.reset(**arguments)
        return observation, info | self.rows.pop(0)

    def step(self, action: Any) -> Any:
        *results, info = self.env.step(action)
        return *results, info | self.rows.pop(0)


@pytest.mark.parametrize(
    ("rows", "message"),
    [
        ([{"odd": None}, {"odd": None}], "info odd is object, no array of numbers"),
        ([{"odd": 1}, {}], "info 'odd' must be in every step"),
        ([{"odd": [1]}, {"odd": [1, 2]}], "info 'odd' must be in every step and keep"),
        ([{"odd": {"in": 1}}, {"odd": {}}], "info 'odd/in' must be in every step"),
    ],
)
def test_an_info_that_makes_no_array_is_named(env, rows, message):
    with pytest.raises(ValueError, match=message):
        stepped(OddInfo(env, rows), 0)


def listed(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_a_recording_that_fails_leaves_nothing(env, episodes, tmp_path):
    def interrupted() -> Iterator[RecordedEpisode]:
        yield episodes[0]
        raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        write(tmp_path / "a-v0", interrupted(), env)
    assert listed(tmp_path) == set()
    # HDF5 itself would end the process on a full disk, with its remains there.
    before = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (20_000, before[1]))
    reason = r"too large; the data set takes 0\.\d MB"
    try:
        with pytest.raises(OSError, match=reason) as caught:
            write(tmp_path / "a-v0", episodes, env)
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, before)
    assert caught.value.filename == str(tmp_path / "a-v0")
    assert listed(tmp_path) == set()


def test_a_data_set_is_replaced_only_when_told_and_only_by_a_whole_one(
    env, episodes, tmp_path
):
    target = tmp_path / "a-v0"
    write(target, episodes[:1], env, "first")
    with pytest.raises(ValueError, match=r"exists; give another folder, or --overwr"):
        write(target, episodes, env, "second")
    with pytest.raises(ValueError, match="at least one episode"):
        write(target, [], env, "third", overwrite=True)
    assert open_dataset(target).policy == "first"
    write(target, episodes, env, "fourth", overwrite=True)
    found = open_dataset(target)
    assert (found.policy, found.n_episodes) == ("fourth", 2)
    assert listed(tmp_path) == {"a-v0"}


@pytest.mark.parametrize(
    ("name", "door", "message"),
    [
        ("demos", "small", "for example door-opening-v0"),
        ("demos-v", "small", "for example door-opening-v0"),
        ("a b-v0", "small", "for example door-opening-v0"),
        ("-v0", "small", "for example door-opening-v0"),
        ("taken-v0", "small", "is no data set; give another folder"),
        ("a-v0", np.float32(0.5), "give names, numbers or mappings instead"),
    ],
)
def test_what_cannot_be_written_is_refused(tmp_path, name, door, message):
    (tmp_path / "taken-v0").mkdir()
    (tmp_path / "taken-v0/thesis.tex").write_text("precious")
    env = gym.make(ENVIRONMENT_ID, door=door)
    with pytest.raises(ValueError, match=message):
        write(tmp_path / name, [], env, overwrite=True)
    assert listed(tmp_path) == {"taken-v0"}
    assert listed(tmp_path / "taken-v0") == {"thesis.tex"}
