"""``gplfd demos`` at the command line."""

import hashlib
import json
import os
import shutil
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import h5py
import minari
import numpy as np
import pytest

from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.minari import open_dataset

pytestmark = pytest.mark.slow

Gplfd = Callable[..., int]
Printed = pytest.CaptureFixture[str]

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
        (episode.options["door"]["radius"], episode.seed, len(episode))
        for episode in map(dataset.episode, range(dataset.n_episodes))
    ]
    assert found == [(0.35, 5, 8), (0.35, 6, 8), (0.42, 5, 8), (0.42, 6, 8)]
    # By Minari, every door is reached by the options of its episode.
    stored = minari.MinariDataset(recorded / "data")
    env = stored.recover_environment()
    metadata = stored.storage.get_episode_metadata(range(4))
    for one, (radius, _, _) in zip(metadata, found, strict=True):
        assert env.reset(options=one["options"])[1]["door_radius"] == radius


def test_one_door_goes_to_a_folder_named_after_the_policy(gplfd, tmp_path, capsys):
    assert gplfd(*RECORD, "--doors", "0.42") == 0
    folder = tmp_path / "results/demos/oracle-v0"
    assert "(door of 0.42 m," in str(open_dataset(folder))
    printed = capsys.readouterr()
    assert "gplfd demos replay results/demos/oracle-v0" in printed.out
    assert "0.42, seed 0: time limit" in printed.err
    # It is the door that Minari recovers.
    dataset = minari.MinariDataset(folder / "data")
    _, info = dataset.recover_environment().reset(seed=0)
    assert info["door_radius"] == 0.42
    metadata = json.loads((folder / "data/metadata.json").read_text())
    assert "doors" not in metadata["description"]


def test_replay_is_bit_exact(gplfd, recorded, capsys):
    assert gplfd("demos", "replay", str(recorded), "--episodes", "3", "1") == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("oracle-v0: policy oracle in gplfd/DoorOpening-v1")
    assert lines[1:-1] == [f"episode {n}: bit-exact over 8 steps" for n in (3, 1)]
    assert lines[-1] == "2 of 2 episodes are the recording, bit for bit"
    # An unknown episode is refused before any is run.
    assert gplfd("demos", "replay", str(recorded), "--episodes", "0", "4") == 2
    printed = capsys.readouterr()
    assert "has no episode 4; its episodes are 0 to 3" in printed.err
    assert printed.out == ""


MAIN = "data/main_data.hdf5"


def edit(folder: Path, change: Callable[[Any], None]) -> None:
    file = folder / "data" / "metadata.json"
    metadata = json.loads(file.read_text())
    change(metadata)
    file.write_text(json.dumps(metadata))


def seal(folder: Path) -> None:
    """Make a changed file of arrays look like the one that was written."""
    sha256 = hashlib.sha256((folder / MAIN).read_bytes()).hexdigest()
    edit(folder, lambda metadata: metadata["gplfd"].update(sha256=sha256))


def edit_arrays(folder: Path, change: Callable[[Any], None]) -> None:
    with h5py.File(folder / MAIN, "a") as arrays:
        change(arrays)
    seal(folder)


def test_replay_of_a_tampered_recording_departs_with_status_1(gplfd, copied, capsys):
    def tamper(file: Any) -> None:
        file["episode_1/infos/physics_state"][6, 1] += 1e-12

    edit_arrays(copied, tamper)
    edit(copied, lambda m: m["gplfd"]["versions"].update(mujoco="3.9.0"))
    assert gplfd("demos", "replay", str(copied)) == 1
    lines = capsys.readouterr().out.splitlines()
    assert lines[1].startswith("not as recorded: mujoco was 3.9.0, is ")
    assert lines[2] == "so equal to a tolerance only, see docs/reproducibility.md"
    assert lines[3] == "episode 0: bit-exact over 8 steps"
    assert lines[4].startswith("episode 1: departs at step 6 of 8: qpos by 1e-12;")
    assert lines[-1] == "3 of 4 episodes are the recording, bit for bit"


def test_inspect_prints_a_line_per_episode(gplfd, recorded, capsys):
    assert gplfd("demos", "inspect", str(recorded)) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0].startswith("oracle-v0: policy oracle in gplfd/DoorOpening-v1")
    assert "It holds 2 doors, and recover_environment() makes one" in lines[1]
    assert any("mujoco" in line and "numpy" in line for line in lines)
    rows = [line.split() for line in lines[-4:]]
    assert [row[:6] for row in rows] == [
        ["0", "0.350", "5", "8", "0.08", "0.0"],
        ["1", "0.350", "6", "8", "0.08", "0.0"],
        ["2", "0.420", "5", "8", "0.08", "0.0"],
        ["3", "0.420", "6", "8", "0.08", "0.0"],
    ]
    assert rows[0][-1] == rows[1][-1] != rows[2][-1]


def cut(folder: Path) -> None:
    content = (folder / MAIN).read_bytes()
    (folder / MAIN).write_bytes(content[: len(content) // 2])


def one_bit(folder: Path) -> None:
    content = bytearray((folder / MAIN).read_bytes())
    content[len(content) // 2] ^= 1
    (folder / MAIN).write_bytes(content)


def replaced(name: str, array: Any = None) -> Callable[[Path], None]:
    """Remove an array, or put another one in its place."""

    def change(file: Any) -> None:
        del file[name]
        if array is not None:
            file[name] = array

    return lambda folder: edit_arrays(folder, change)


def linked(name: str) -> Callable[[Path], None]:
    """Put a link in the place of an array; behind it is a named pipe."""

    def damage(folder: Path) -> None:
        os.mkfifo(folder / "data/pipe")
        replaced(name, h5py.ExternalLink("pipe", "/x"))(folder)

    return damage


def many_long_texts(folder: Path) -> None:
    """Thousands of references to one text of a million letters."""
    with h5py.File(folder / MAIN, "a") as file:
        infos = file["episode_0/infos"]
        del infos["failure"]
        made = infos.create_dataset("failure", (5000,), h5py.string_dtype())
        made[0] = 1_100_003 * "a"
        offset = made.id.get_offset()
    content = bytearray((folder / MAIN).read_bytes())
    reference = content[offset : offset + 16]
    assert int.from_bytes(reference[:4], "little") == 1_100_003
    content[offset : offset + 16 * 5000] = reference * 5000
    (folder / MAIN).write_bytes(content)
    seal(folder)


def endless(folder: Path) -> None:
    def change(file: Any) -> None:
        del file["episode_0/actions"]
        file.create_dataset("episode_0/actions", (10**12, 6), "f4", chunks=(1, 6))

    edit_arrays(folder, change)


def shorten_the_states(folder: Path) -> None:
    states = "episode_0/infos/physics_state"
    edit_arrays(folder, lambda file: file[states].resize(5, axis=0))


def metadata(change: Callable[[Any], Any]) -> Callable[[Path], None]:
    return lambda folder: edit(folder, change)


def specification(**changes: Any) -> Callable[[Path], None]:
    """Change what the environment is made from."""

    def change(metadata: Any) -> None:
        spec = json.loads(metadata["env_spec"]) | changes
        metadata["env_spec"] = json.dumps(spec)

    return lambda folder: edit(folder, change)


@pytest.mark.parametrize(
    ("damage", "message"),
    [
        (shutil.rmtree, "is not a data set: there is no data/metadata.json in it"),
        (lambda f: (f / MAIN).unlink(), "no data/main_data.hdf5"),
        (cut, "main_data.hdf5 is damaged or was changed after it was recorded"),
        (one_bit, "main_data.hdf5 is damaged or was changed after it was recorded"),
        (replaced("episode_0"), "copy-v0: episode 0 cannot be read: "),
        (replaced("episode_0/actions"), "actions"),
        (replaced("episode_0/infos/physics_state"), "info physics_state is missing"),
        (replaced("episode_0/infos/success"), "info success is missing"),
        (shorten_the_states, "physics_state has shape (5, 182), must have (9, 182)"),
        (endless, "it unpacks to more than its size allows"),
        (many_long_texts, "unpacks to more than its size allows"),
        *(
            (linked(f"episode_0{name}"), "is a ExternalLink, and links are not foll")
            for name in ("", "/rewards", "/infos/slip")
        ),
        (replaced("episode_0/rewards", 3.0), "rewards has shape (), must have (1,)"),
        (replaced("episode_0/actions", b"text"), "/actions is one text, not an array"),
        (replaced("episode_0/actions", np.zeros((8, 5))), "episode 0 cannot be run"),
        (
            lambda f: (f / "data/metadata.json").write_text("{"),
            "data/metadata.json cannot be read as JSON: Expecting",
        ),
        (metadata(lambda m: m.pop("gplfd")), "was not recorded by `gplfd de"),
        (metadata(lambda m: m["gplfd"].update(layout=9)), "layout 9, this"),
        (
            metadata(lambda m: m["gplfd"]["versions"].pop("numpy")),
            "does not state its numpy",
        ),
        (metadata(lambda m: m.pop("env_spec")), "it lacks env_spec, which must"),
        (metadata(lambda m: m.update(env_spec="[]")), "holds [], not an obj"),
        (metadata(lambda m: m["gplfd"].update(git=[])), "git = [] must be an object"),
        (
            specification(id="CartPole-v1", entry_point="os:abort"),
            "recorded in CartPole-v1, which is no environ",
        ),
        (specification(kwargs={"gravity": "up"}), "cannot make gplfd/DoorOpening-v1"),
    ],
)
def test_a_bad_data_set_is_one_paragraph_and_status_2(
    gplfd, copied, capsys, damage, message
):
    damage(copied)
    assert gplfd("demos", "replay", str(copied)) == 2
    printed = capsys.readouterr().err
    assert message in printed
    assert len([line for line in printed.splitlines() if "gplfd: " in line]) == 1
    assert "Traceback" not in printed


def test_without_minari_the_extra_is_named(gplfd, recorded, capsys, monkeypatch):
    read_minari = ("gplfd_experiments.data.", "gplfd_experiments.episodes.dataset")
    for name in [name for name in sys.modules if name.startswith(read_minari)]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.setitem(sys.modules, "minari", None)
    for command in (RECORD, ("demos", "replay", str(recorded))):
        assert gplfd(*command) == 2
        printed = capsys.readouterr().err
        assert "pip install '.[minari]'" in printed
        assert "pip install 'gplfd[minari]'" in printed
        assert "Traceback" not in printed
