"""``gplfd demos export``: what is written for others is read back as it was."""

import json
from pathlib import Path

import h5py
import numpy as np
import pyarrow.parquet
import pytest
from numpy.testing import assert_allclose, assert_array_equal

from experiments import cli
from experiments.datasets.npz import save_demonstrations
from experiments.datasets.preparation.samples import usable
from experiments.datasets.readers import read_recordings
from experiments.datasets.readers.selection import Selection
from experiments.teacher import Teacher
from gplfd_env.se3 import rotation_distance
from policies.demonstrations import Demonstration


@pytest.fixture(autouse=True)
def shown(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> tuple[Demonstration, ...]:
    """Two demonstrations in a file of the working folder, one with a gripper."""
    monkeypatch.chdir(tmp_path)
    both = Teacher().demonstrate_doors([0.35, 0.5], 1, rng=np.random.default_rng(0))
    gripper = [{"gripper": np.full((len(one.times), 2), 0.04)} for one in both]
    save_demonstrations("demonstrations.npz", both, signals=gripper)
    return both


def exported(form: str, out: str) -> int:
    return cli.main(["demos", "export", ".", "--form", form, "--out", out])


@pytest.mark.parametrize(
    ("form", "out", "apart"), [("robomimic", "a.hdf5", 1e-9), ("lerobot", "b", 1e-6)]
)
def test_what_was_written_is_read_back(
    shown: tuple[Demonstration, ...], form: str, out: str, apart: float
) -> None:
    assert exported(form, out) == 0
    again = read_recordings(out, Selection())
    assert len(again) == len(shown)
    for one, recorded in zip(shown, again, strict=True):
        samples, notes = usable(recorded, None, None)
        assert len(notes) <= 1
        assert_allclose(samples.times, one.times - one.times[0], atol=1e-9)
        assert_allclose(samples.poses[:, :3], one.poses[:, :3], rtol=0, atol=apart)
        found = Demonstration.from_quaternions(
            samples.times, samples.poses[:, :3], samples.poses[:, 3:]
        )
        turned = rotation_distance(found.poses[:, 3:], one.poses[:, 3:])
        assert turned.max() < apart


def test_robomimic_finds_what_it_looks_for(shown: tuple[Demonstration, ...]) -> None:
    assert exported("robomimic", "a.hdf5") == 0
    with h5py.File("a.hdf5") as file:
        data = file["data"]
        assert data.attrs["total"] == sum(len(one.times) for one in shown)
        assert set(json.loads(data.attrs["env_args"])) == {
            "env_name",
            "env_type",
            "env_kwargs",
        }
        demo = data["demo_1"]
        assert demo.attrs["num_samples"] == len(shown[1].times)
        assert set(demo) == {"actions", "dones", "next_obs", "obs", "rewards", "states"}
        position = demo["obs/robot0_eef_pos"][()]
        assert_array_equal(demo["actions"][:-1, :3], position[1:])
        assert_array_equal(demo["next_obs/robot0_eef_pos"][:-1], position[1:])
        assert_array_equal(demo["obs/robot0_gripper_qpos"][()], 0.04)
        assert demo["dones"][()].sum() == demo["dones"][-1] == 1


def test_lerobot_finds_what_it_looks_for(shown: tuple[Demonstration, ...]) -> None:
    assert exported("lerobot", "b") == 0
    info = json.loads(Path("b/meta/info.json").read_text())
    lengths = [len(one.times) for one in shown]
    assert (info["total_episodes"], info["total_frames"]) == (2, sum(lengths))
    tasks = pyarrow.parquet.read_table("b/meta/tasks.parquet")
    assert tasks.to_pydict() == {"task_index": [0], "task": ["recorded motion"]}
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


def test_uneven_steps_and_what_is_there_are_refused(
    shown: tuple[Demonstration, ...], caplog: pytest.LogCaptureFixture
) -> None:
    assert exported("robomimic", "demonstrations.npz") == 2
    assert "--out demonstrations.npz exists" in caplog.text
    one = shown[0]
    uneven = Demonstration(times=one.times**1.2, poses=one.poses)
    save_demonstrations("demonstrations.npz", [uneven])
    assert exported("robomimic", "a.hdf5") == 2
    assert "not sampled at equal steps; import it with --rate 100" in caplog.text
    save_demonstrations("demonstrations.npz", [one])
    slow = Demonstration(times=2.123 * one.times, poses=one.poses)
    save_demonstrations("demonstrations.npz", [one, slow])
    assert exported("lerobot", "b") == 2
    assert not Path("b").exists()
    assert not Path("a.hdf5").exists()
