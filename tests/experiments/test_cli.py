"""The command line: runs, lists, help, and bad input."""

import hashlib
import json
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from gplfd_env import DOORS
from gplfd_env.doors.config import DoorConfig
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.files.folders import folder_in_use
from gplfd_experiments.workflows import runs
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations
from gplfd_policies.registry.built_in import PARTS, POLICIES

pytestmark = pytest.mark.slow

ORACLE = ("run", "--policy", "oracle")
WRITTEN = {"metrics.json", "run.json", "demonstrations.npz", "small.rrd", "small.npz"}


def files(folder):
    return {path.name for path in folder.iterdir()}


# --- Runs --------------------------------------------------------------------


def test_run_writes_metrics_logs_recordings_and_settings(gplfd, tmp_path, capsys):
    out = tmp_path / "out"
    assert gplfd(*ORACLE, "--doors", "small", "0.42", "--out", str(out)) == 0
    assert files(out) == WRITTEN | {"0.42.rrd", "0.42.npz"}
    metrics = json.loads((out / "metrics.json").read_text())
    assert [(m["policy"], m["door"], m["radius"]) for m in metrics] == [
        ("oracle", "small", 0.35),
        ("oracle", "0.42", 0.42),
    ]
    log = EpisodeLog.load(out / "0.42.npz")
    assert episode_metrics(log) == metrics[1]
    demonstrations = load_demonstrations(out / "demonstrations.npz")
    assert demonstrations.radii == (0.35, 0.35, 0.50, 0.50, 0.65, 0.65)
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["door_configs"]["0.42"]["radius"] == 0.42
    digest = hashlib.sha256((out / "demonstrations.npz").read_bytes()).hexdigest()
    assert config["demonstrations_sha256"] == {"demonstrations.npz": digest}
    printed = capsys.readouterr()
    assert f"gplfd view {out / 'small.rrd'}" in printed.out
    assert "0.42: opened" in printed.err


@pytest.mark.parametrize("name", ["run.json", "small.rrd", "demonstrations.npz"])
def test_earlier_results_are_named_and_kept(name, refused, tmp_path):
    (tmp_path / "out").mkdir()
    (tmp_path / "out" / name).write_text("mine")
    message = refused(*ORACLE, "--doors", "small", "--out", "out")
    assert message.endswith(
        f"holds earlier results ({name}); remove them, or give another --out"
    )
    assert (tmp_path / "out" / name).read_text() == "mine"


HOLD = """
import sys, time
from pathlib import Path
from gplfd_experiments.files.folders import folder_in_use
with folder_in_use(Path(sys.argv[1])):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_folder_is_of_one_process_until_it_dies(refused, tmp_path):
    words = [sys.executable, "-c", HOLD, str(tmp_path / "r")]
    with subprocess.Popen(words, stdout=subprocess.PIPE, text=True) as other:
        assert other.stdout
        assert other.stdout.readline() == "held\n"
        for command in ("run", "benchmark", "trials --part small"):
            message = refused(*command.split(), "--out", "r")
            assert message.startswith("r is in use by another command")
        other.kill()
    with folder_in_use(tmp_path / "r") as path:
        assert path == tmp_path / "r"
    assert not list(path.iterdir())


def test_a_folder_is_released_after_its_mark_is_removed(tmp_path, monkeypatch):
    unlinked = type(tmp_path).unlink

    def unlink(mark):
        with pytest.raises(ValueError, match="in use by"), folder_in_use(tmp_path):
            pass
        unlinked(mark)

    monkeypatch.setattr(type(tmp_path), "unlink", unlink)
    with folder_in_use(tmp_path):
        pass


@pytest.mark.usefixtures("policies_here", "short_episodes")
def test_a_policy_that_changes_the_folder_does_not_move_the_results(gplfd, tmp_path):
    (tmp_path / "there").mkdir()
    (tmp_path / "moves.py").write_text(
        "import os\nfrom gplfd_policies import make_agent\ndef make(training):\n"
        f"    os.chdir({str(tmp_path / 'there')!r})\n"
        "    return make_agent('oracle', training.demonstrations)\n"
    )
    words = ("--policy", "moves.py:make", "--doors", "small", "--out", "out")
    assert gplfd("run", *words) == 0
    assert files(tmp_path / "out") == WRITTEN
    assert not files(tmp_path / "there")


@pytest.mark.usefixtures("short_episodes")
def test_run_learns_from_a_file_and_the_same_seed_gives_the_same_log(gplfd, tmp_path):
    common = (*ORACLE, "--doors", "small")
    assert gplfd(*common, "--demonstrations-per-door", "1", "--out", "a") == 0
    file = tmp_path / "a" / "demonstrations.npz"
    assert gplfd(*common, "--demonstrations", str(file), "--out", "b") == 0
    first, second = (
        load_demonstrations(tmp_path / name / "demonstrations.npz").demonstrations
        for name in ("a", "b")
    )
    assert len(second) == 3
    np.testing.assert_array_equal(second[2].poses, first[2].poses)
    logs = [EpisodeLog.load(tmp_path / name / "small.npz") for name in ("a", "b")]
    assert logs[0].motion.qpos.tobytes() == logs[1].motion.qpos.tobytes()
    assert logs[0].forces.wrench.tobytes() == logs[1].forces.wrench.tobytes()


@pytest.mark.usefixtures("short_episodes")
def test_a_run_that_ends_early_leaves_complete_files(
    refused, gplfd, tmp_path, monkeypatch, capsys
):
    run = (*ORACLE, "--doors", "small", "--out", "out", "--quiet")
    assert gplfd(*run) == 0
    capsys.readouterr()
    before = {file: file.read_bytes() for file in (tmp_path / "out").iterdir()}

    def fail(*_: Any, **__: Any) -> None:
        raise ValueError("no pose")

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(runs.build, "open_together", fail)
        assert refused(*run[:-3], "--out", "new") == "no pose"
    assert {file: file.read_bytes() for file in before} == before
    monkeypatch.setattr(runs, "record_episode", interrupt)
    with pytest.raises(KeyboardInterrupt):
        gplfd(*run[:-3], "--out", "new")
    assert files(tmp_path / "new") == {"run.json", "demonstrations.npz", "small.npz"}


def test_a_run_may_be_randomized_and_disturbed(gplfd, tmp_path):
    run = (*ORACLE, "--doors", "small", "large", "--seed", "3", "--out", "hard")
    assert gplfd(*run, "--randomization", "hard", "--disturbance", "person") == 0
    small = EpisodeLog.load(tmp_path / "hard" / "small.npz")
    large = EpisodeLog.load(tmp_path / "hard" / "large.npz")
    assert small.door_config["hinge_friction"] != DOORS["small"].hinge_friction
    assert large.radius != small.radius, "each door of a run draws for itself"
    config = json.loads((tmp_path / "hard" / "run.json").read_text())["config"]
    assert config["randomization"] == "hard"
    metrics, _ = json.loads((tmp_path / "hard" / "metrics.json").read_text())
    assert metrics["person_force_peak"] == small.forces.person_force.max() > 10.0


# --- Bad input ---------------------------------------------------------------

REFUSED = [
    ("run --policy oracel", "unknown policy 'oracel' (did you mean 'oracle'?)"),
    ("run --doors 0.4 0.40", "door 0.4 is given twice"),
    ("run --doors far.json", "far.json holds no door: DoorConfig.radius"),
    ("run --seed -1", "--seed -1 must be 0 or more"),
    ("run --out taken", "--out taken is a file; give a folder"),
    ("run --disturbance absent", "unknown disturbance 'absent'; give one of"),
    ("run --skill demos.npz", "demos.npz cannot be read as a gplfd skill"),
    ("run --skill a --demonstrations b", "omit --demonstrations"),
    ("run --skill a --doors small oven", "are of two kinds (they differ in"),
    ("run --video op.gif", "--video writes .mp4 files, got 'op.gif'"),
    ("correct none.npz --port 70000 --device mouse", "--port 70000 must be 0 to"),
    ("figures --only fig02 fig08", "unknown figure 'fig08'; known: fig02, fig03, fig"),
    ("benchmark --policies table-1 gp", "gp is given twice in --policies"),
    ("benchmark --seeds 1000000000", "99,000,000,000 tasks are more than the 100,0"),
    ("run --demonstrations-per-door 9999", "door 9999 must be 1 to 1000"),
    ("demos record --randomization detector", "approach"),
    ("demos record --doors small room-834 --policy oracle", "record two data sets"),
    ("learn demos.npz --out demos.npz", "holds the demonstrations; give another file"),
    ("demos record --policy oracle --out taken-v0", "taken-v0 exists and is no data"),
    ("demos import a.csv --out s --frame 1,2,3", "or a pose x,y,z"),
    ("demos import a.csv --out s", "a.csv cannot be read as a table in a text file"),
    ("view nothing.rrd", "there is no file nothing.rrd; `gplfd run` writes"),
    ("view folder/a.rrd", "rerun --serve-web --bind 127.0.0.1 folder/a.rrd"),
]
FILES = {
    "far.json": '{"radius": 9.0}',
    "a.csv": "x,y\n1,two\n",
    "taken": "hello",
    "taken-v0": "",
    "folder/a.rrd": "RRF2",
}


@pytest.mark.parametrize(("command", "message"), REFUSED)
def test_bad_input_is_one_line_status_2_and_no_files(
    refused, tmp_path, monkeypatch, command, message
):
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    (tmp_path / "folder").mkdir()
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    if "demos.npz" in command:
        given = Teacher().demonstrate_doors([0.5], 2, rng=np.random.default_rng(0))
        save_demonstrations(tmp_path / "demos.npz", given)
    assert message in refused(*command.split())


def test_debug_prints_the_traceback_of_an_error(gplfd, capsys):
    assert gplfd("run", "--doors", "smal", "--debug") == 2
    first, second, *_ = capsys.readouterr().err.splitlines()
    assert first.startswith("gplfd: ")
    assert second == "Traceback (most recent call last):"


# --- Names and help ----------------------------------------------------------


def test_doors_are_names_radii_and_files(tmp_path):
    pantry = tmp_path / "pantry.json"
    pantry.write_text('{"preset": "heavy", "radius": 0.44}')
    assert named_doors([str(pantry), "large", "0.420"]) == {
        "pantry": DOORS["heavy"].replaced({"radius": 0.44}),
        "large": DOORS["large"],
        "0.42": DoorConfig(radius=0.42),
    }


def test_list_has_all_names_and_the_range_of_radii(gplfd, capsys):
    assert gplfd("list") == 0
    first, *rest = capsys.readouterr().out.splitlines()
    low, high, standing = re.findall(r"\d\.\d+", first)
    assert named_doors([low, high, standing]).keys() == {low, high, standing}
    assert gplfd("list", "--json") == 0
    listed = json.loads(capsys.readouterr().out)
    assert {line.split()[0] for line in rest if line[:2] == "  "} == {
        name for section in listed.values() for name in section
    }
    assert set(listed["doors"]) == set(DOORS)
    kinds = ("learners", "references")
    assert set(listed["pipelines"]) == {"published", "tuned", *PARTS}
    assert {name for kind in kinds for name in listed[kind]} == set(POLICIES)


@pytest.mark.parametrize("command", ["", *cli.COMMANDS, "demos import"])
def test_help_has_every_option_with_its_text(gplfd, monkeypatch, capsys, command):
    monkeypatch.setenv("COLUMNS", "120")
    assert gplfd(*command.split(), "--help") == 0
    printed = capsys.readouterr().out
    assert "\x1b" not in printed
    if command == "":  # The first paragraph of each description.
        assert "Learn from demonstrations, open doors" in printed
        assert "Writes DIR/" not in printed
    if command == "run":  # Without the line breaks of the source.
        assert ".json of an arm (docs/environment.md)." in printed


def test_unknown_commands_and_options_end_with_status_2(gplfd, capsys):
    for words in ("benchmrk", "demos imprt a.csv", "list --jsn", "run --seed many"):
        assert gplfd(*words.split()) == 2
        assert "gplfd --help" in capsys.readouterr().err
