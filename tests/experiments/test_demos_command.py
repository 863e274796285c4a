"""``gplfd demos`` at the command line."""

import json
import shutil
from pathlib import Path

import minari
import pytest

from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.minari import open_dataset

pytestmark = pytest.mark.slow

RECORD = ("demos", "record", "--policy", "oracle", "--max-steps", "8")


@pytest.fixture(scope="module")
def recorded(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("recorded") / "oracle-v0"
    doors = ("--doors", "small", "0.42", "--episodes", "2", "--seed", "5")
    assert cli.main([*RECORD, *doors, "--out", str(folder)]) == 0
    return folder


@pytest.fixture
def copied(recorded: Path, tmp_path: Path) -> Path:
    return Path(shutil.copytree(recorded, tmp_path / "copy-v0"))


def test_record_writes_every_door_and_seed(recorded):
    dataset = open_dataset(recorded)
    assert dataset.policy == "oracle"
    assert dataset.origin["config"]["doors"] == ["small", "0.42"]
    found = [
        (episode.options["door"]["radius"], episode.seed, len(episode.rewards))
        for episode in map(dataset.episode, range(dataset.n_episodes))
    ]
    assert found == [(0.35, 5, 8), (0.35, 6, 8), (0.42, 5, 8), (0.42, 6, 8)]
    # By Minari, every door is reached by the options of its episode.
    stored = minari.MinariDataset(recorded / "data")
    env = stored.recover_environment()
    metadata = stored.storage.get_episode_metadata(range(4))
    for one, (radius, _, _) in zip(metadata, found, strict=True):
        assert env.reset(options=one["options"])[1]["door_radius"] == radius


MAIN = "data/main_data.hdf5"


def test_inspect_prints_a_line_per_episode(gplfd, recorded, capsys):
    assert gplfd("demos", "inspect", str(recorded), "--all") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("oracle-v0: policy oracle in gplfd/DoorOpening-v1")
    assert "It holds 2 doors, and recover_environment() makes one" in lines[1]
    assert any("mujoco" in line and "numpy" in line for line in lines)
    rows = [line.split() for line in lines[-4:]]
    assert [[*row[:4], *row[-3:-1]] for row in rows] == [
        ["0", "0.350", "0.08", "0.0", "5", "8"],
        ["1", "0.350", "0.08", "0.0", "6", "8"],
        ["2", "0.420", "0.08", "0.0", "5", "8"],
        ["3", "0.420", "0.08", "0.0", "6", "8"],
    ]


def cut(folder: Path) -> None:
    content = (folder / MAIN).read_bytes()
    (folder / MAIN).write_bytes(content[: len(content) // 2])


def unknown(folder: Path) -> None:
    """Change what the environment is made from."""
    file = folder / "data" / "metadata.json"
    metadata = json.loads(file.read_text())
    spec = json.loads(metadata["env_spec"])
    spec |= {"id": "CartPole-v1", "entry_point": "os:abort"}
    file.write_text(json.dumps(metadata | {"env_spec": json.dumps(spec)}))


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (shutil.rmtree, "is not a data set: there is no data/metadata.json in it"),
        (cut, "episode 0 cannot be read: "),
        (unknown, "CartPole-v1 is no environment of gplfd"),
    ],
)
def test_a_bad_data_set_ends_with_status_2(gplfd, copied, capsys, damage, message):
    damage(copied)
    assert gplfd("demos", "inspect", str(copied)) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert len([line for line in printed.splitlines() if "gplfd: " in line]) == 1
    assert "Traceback" not in printed
