"""``gplfd demos export``: what is written for others is read back as it was."""

import contextlib
import io
import json
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pyarrow.parquet
import pytest
from numpy.testing import assert_allclose
from PIL import Image
from scipy.spatial.transform import Rotation

from gplfd_env.spatial.se3 import rotation_distance
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.minari import open_dataset
from gplfd_experiments.data.preparation import ImportSettings, prepare
from gplfd_experiments.data.preparation.samples import Notes, usable
from gplfd_experiments.data.readers import read_here
from gplfd_experiments.data.teacher import Teacher
from gplfd_policies.demonstrations.demonstration import Demonstration
from gplfd_policies.demonstrations.npz import save_demonstrations

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("coarse_cuts")]


@pytest.fixture(autouse=True)
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Demonstration, ...]:
    """Two demonstrations with two signals in a file of the working folder."""
    monkeypatch.chdir(tmp_path)
    rng = np.random.default_rng(0)
    both = tuple(
        replace(one, wrenches=rng.normal(size=one.poses.shape))
        for one in Teacher().demonstrate_doors([0.35, 0.5], 1, rng=rng)
    )
    signals = [
        {"gripper": np.full((len(one.times), 2), 0.04), "grasped": one.times[:, None]}
        for one in both
    ]
    save_demonstrations("demonstrations.npz", both, signals=signals)
    return both


AS_RECORDED = ImportSettings(frame="recorded", keep_rests=True, cutoff=0.0, rate=0.0)


def exported(out: str) -> int:
    return cli.main(["demos", "export", ".", "--out", out])


def test_what_was_written_is_read_back(shown):
    apart = 1e-6  # Of float32.
    assert exported("b") == 0
    again = read_here(Path("b"), ImportSettings())
    assert len(again) == len(shown)
    for one, recorded in zip(shown, again, strict=True):
        notes = Notes()
        samples = usable(recorded, AS_RECORDED, notes)
        assert len(notes) <= 1
        assert_allclose(samples.times, one.times - one.times[0], atol=1e-9)
        assert_allclose(samples.poses[:, :3], one.poses[:, :3], rtol=0, atol=apart)
        found = Demonstration.from_quaternions(
            samples.times, samples.poses[:, :3], samples.poses[:, 3:]
        )
        turned = rotation_distance(found.poses[:, 3:], one.poses[:, 3:])
        assert turned.max() < apart
        # As the environment observes them, and as the hand applies them.
        assert_allclose(recorded.wrenches, -np.asarray(one.wrenches), atol=apart)
        (motion,) = prepare([recorded], AS_RECORDED)
        assert_allclose(motion.demonstration.wrenches, one.wrenches, atol=apart)


def test_lerobot_finds_what_it_looks_for(shown):
    assert exported("b") == 0
    info = json.loads(Path("b/meta/info.json").read_text())
    lengths = [len(one.times) for one in shown]
    assert (info["total_episodes"], info["total_frames"]) == (2, sum(lengths))
    tasks = pyarrow.parquet.read_table("b/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["open the door"]}
    assert tasks.schema.pandas_metadata["index_columns"] == ["task"]
    path = info["data_path"].format(chunk_index=0, file_index=0)
    table = pyarrow.parquet.read_table(Path("b") / path)
    # As LeRobot asks for: every feature a column, of its type and shape.
    assert set(table.column_names) == set(info["features"])
    for name, feature in info["features"].items():
        column = table[name].to_pylist()
        assert np.asarray(column[0]).size == feature["shape"][0]
    episodes = pyarrow.parquet.read_table("b/meta/episodes/chunk-000/file-000.parquet")
    assert episodes["dataset_from_index"].to_pylist() == [0, lengths[0]]
    assert episodes["dataset_to_index"].to_pylist() == [lengths[0], sum(lengths)]
    stats = json.loads(Path("b/meta/stats.json").read_text())
    states = np.array(table["observation.state"].to_pylist())
    assert_allclose(stats["observation.state"]["mean"], states.mean(axis=0), atol=1e-6)


def test_uneven_steps_and_what_is_there_are_refused(shown, caplog):
    assert exported("demonstrations.npz") == 2
    assert "--out demonstrations.npz exists" in caplog.text
    one = shown[0]
    uneven = Demonstration(times=one.times**1.2, poses=one.poses)
    save_demonstrations("demonstrations.npz", [uneven])
    assert exported("b") == 2
    assert "not sampled at equal steps of" in caplog.text
    assert not Path("b").exists()


# ------------------------------------------------------------------ episodes
@pytest.fixture(scope="module")
def episodes(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Two short episodes as `gplfd demos record` writes them."""
    folder = tmp_path_factory.mktemp("recorded") / "oracle-v0"
    record = ["demos", "record", "--policy", "oracle", "--doors", "small", "0.5"]
    cut = ["--max-steps", "45", "--out", str(folder), "--quiet"]
    assert cli.main([*record, *cut]) == 0
    return folder


def test_episodes_are_read_back_with_what_was_commanded(episodes):
    out = ["--form", "lerobot", "--out", "b", "--rate", "20"]
    assert cli.main(["demos", "export", str(episodes), *out]) == 0
    dataset = open_dataset(episodes)
    again = read_here(Path("b"), ImportSettings())
    assert len(again) == 2
    rows = pyarrow.parquet.read_table("b/data/chunk-000/file-000.parquet").to_pydict()
    for number, one in enumerate(again):
        episode = dataset.episode(number)
        assert one.times is not None
        assert_allclose(one.times, episode.observations["time"][:-1:5, 0], atol=1e-9)
        seen = episode.observations["ee_pose"][:-1:5]
        assert_allclose(one.positions, seen[:, :3], rtol=0, atol=1e-6)
        own = np.array(rows["episode_index"]) == number
        commanded = np.array(rows["action"])[own]
        # What is to be reached by the next row is the last command before it.
        last = episode.actions[4::5]
        assert_allclose(commanded[:, :3], last[:, :3], rtol=0, atol=1e-6)
        turned = Rotation.from_quat(commanded[:, 3:]).as_rotvec()
        assert rotation_distance(turned, last[:, 3:6]).max() < 1e-6
        force = np.array(rows["observation.environment_state"])[own]
        wrenches = episode.observations["wrench"][:-1:5]
        assert_allclose(force, wrenches, rtol=1e-6)
        (motion,) = prepare([one], AS_RECORDED)
        assert_allclose(motion.demonstration.wrenches, -wrenches, rtol=1e-6)


@pytest.mark.needs("opengl")
def test_pictures_show_the_recorded_states(episodes):
    out = ["--form", "lerobot", "--out", "b", "--rate", "10", "--size", "64", "48"]
    pictures = ["--pictures", "overview", "hand_camera"]
    assert cli.main(["demos", "export", str(episodes), *out, *pictures]) == 0
    assert len(read_here(Path("b"), ImportSettings())) == 2
    info = json.loads(Path("b/meta/info.json").read_text())
    table = pyarrow.parquet.read_table("b/data/chunk-000/file-000.parquet")
    assert set(table.column_names) == set(info["features"])
    column = "observation.images.overview"
    assert info["features"][column]["dtype"] == "image"
    assert info["features"][column]["shape"] == [48, 64, 3]
    drawn = [
        np.asarray(Image.open(io.BytesIO(one["bytes"])))
        for one in table[column].to_pylist()
    ]
    assert len(drawn) == 10
    assert {one.shape for one in drawn} == {(48, 64, 3)}
    stats = json.loads(Path("b/meta/stats.json").read_text())[column]
    mean = np.mean(drawn, axis=(0, 1, 2)) / 255.0
    assert_allclose(np.ravel(stats["mean"]), mean, atol=1e-9)
    # The picture of an episode's state is that of the same episode when it ran.
    dataset = open_dataset(episodes)
    episode = dataset.episode(1)
    env = gym.make(
        dataset.environment,
        **dataset.arguments,
        render_mode="rgb_array",
        width=64,
        height=48,
    )
    with contextlib.closing(env):
        env.reset(seed=episode.seed, options=dict(episode.options))
        for action in episode.actions[:40]:
            env.step(action)
        as_it_ran = np.asarray(env.render(), dtype=int)
    assert np.abs(drawn[-1].astype(int) - as_it_ran).mean() < 0.5
    assert np.abs(drawn[0].astype(int) - as_it_ran).mean() > 0.5


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["SET", "--rate", "30"], "must divide the 100 steps per second"),
        (["SET", "--pictures", "side"], "camera_name = 'side' is not one of 'overv"),
        ([".", "--pictures", "top"], "--pictures and --rate are for episodes of"),
    ],
)
def test_what_cannot_be_exported_is_said(episodes, arguments, message, caplog):
    given = [str(episodes) if word == "SET" else word for word in arguments]
    assert cli.main(["demos", "export", *given, "--out", "b"]) == 2
    assert message in caplog.text
    assert not Path("b").exists()
