"""The command line: runs, lists, help, and what is refused with one line."""

import hashlib
import itertools
import json
import os
import re
import subprocess
import sys
from typing import Any

import numpy as np
import pytest

from gplfd_env import (
    DISTURBANCES,
    DOORS,
    ENVIRONMENT_IDS,
    GRIPPER_ENVIRONMENT_ID,
    MOBILE_ENVIRONMENT_ID,
    RANDOMIZATIONS,
    RL_ENVIRONMENT_ID,
)
from gplfd_env.doors.config import DoorConfig
from gplfd_env.robot.stance import base_for
from gplfd_env.robot.tiago import TIAGO_LIKE
from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.recording import viewer
from gplfd_experiments.workflows import live, runs
from gplfd_policies.demonstrations.npz import load_demonstrations, save_demonstrations
from gplfd_policies.registry.catalogue import POLICIES

pytestmark = pytest.mark.slow

ORACLE = ("run", "--policy", "oracle")


def written(folder):
    return {path.name for path in folder.iterdir()}


# --- Runs --------------------------------------------------------------------


def test_run_writes_metrics_logs_recordings_and_where_they_came_from(
    gplfd, tmp_path, capsys
):
    out = tmp_path / "out"
    assert gplfd(*ORACLE, "--doors", "small", "0.42", "--out", str(out)) == 0
    assert written(out) == {
        *("metrics.json", "run.json", "demonstrations.npz"),
        *("small.rrd", "small.npz", "0.42.rrd", "0.42.npz"),
    }
    metrics = json.loads((out / "metrics.json").read_text())
    assert [(m["policy"], m["door"], m["radius"]) for m in metrics] == [
        ("oracle", "small", 0.35),
        ("oracle", "0.42", 0.42),
    ]
    log = EpisodeLog.load(out / "0.42.npz")
    assert episode_metrics(log).as_json() == metrics[1]
    demonstrations = load_demonstrations(out / "demonstrations.npz")
    assert demonstrations.radii == (0.35, 0.35, 0.50, 0.50, 0.65, 0.65)
    config = json.loads((out / "run.json").read_text())["config"]
    assert config["policy"] == "oracle"
    assert config["door_configs"]["0.42"]["radius"] == 0.42
    learned_from = (out / "demonstrations.npz").read_bytes()
    digest = hashlib.sha256(learned_from).hexdigest()
    assert config["demonstrations_sha256"] == {"demonstrations.npz": digest}
    printed = capsys.readouterr()
    assert f"gplfd view {out / 'small.rrd'}" in printed.out
    assert "0.42: opened" in printed.err

    # The next run replaces what this one wrote, and nothing else.
    for name in ("0.42.png", "notes.npz", "large.rrd"):
        (out / name).touch()
    assert gplfd(*ORACLE, "--doors", "small", "--out", str(out), "--json") == 0
    assert written(out) == {
        *("metrics.json", "run.json", "demonstrations.npz", "small.rrd", "small.npz"),
        *("0.42.png", "notes.npz", "large.rrd"),
    }
    # As JSON it prints its metrics and nothing else.
    metrics = json.loads((out / "metrics.json").read_text())
    assert json.loads(capsys.readouterr().out) == metrics


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"config": {"policy": "gp"}}', '{"config": 3}']
)
def test_run_keeps_out_of_a_folder_whose_content_is_not_known(
    refused, tmp_path, content
):
    (tmp_path / "run.json").write_text(content)
    assert "run.json does not list the files" in refused(*ORACLE, "--out", ".")
    assert (tmp_path / "run.json").read_text() == content


def test_run_removes_nothing_outside_its_folder(gplfd, tmp_path):
    (tmp_path / "mine.npz").touch()
    out = tmp_path / "out"
    out.mkdir()
    doors = {"../mine": {}, str(tmp_path / "mine"): {}, "small": {}}
    (out / "run.json").write_text(json.dumps({"config": {"door_configs": doors}}))
    assert gplfd(*ORACLE, "--doors", "0.42", "--out", str(out)) == 0
    assert (tmp_path / "mine.npz").exists()


def test_run_learns_from_a_file_and_the_same_seed_gives_the_same_log(gplfd, tmp_path):
    common = (*ORACLE, "--doors", "small")
    assert gplfd(*common, "--demonstrations-per-door", "1", "--out", "a") == 0
    file = tmp_path / "a" / "demonstrations.npz"
    assert gplfd(*common, "--demonstrations", str(file), "--out", "b") == 0
    given, copy = (
        load_demonstrations(tmp_path / name / "demonstrations.npz").demonstrations
        for name in ("a", "b")
    )
    assert len(copy) == 3
    np.testing.assert_array_equal(copy[2].poses, given[2].poses)
    first, second = (EpisodeLog.load(tmp_path / n / "small.npz") for n in ("a", "b"))
    assert first.qpos.tobytes() == second.qpos.tobytes()
    assert first.wrench.tobytes() == second.wrench.tobytes()


def test_an_interruption_leaves_only_complete_files(gplfd, tmp_path, monkeypatch):
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "record_episode", interrupt)
    with pytest.raises(KeyboardInterrupt):
        gplfd(*ORACLE, "--doors", "small", "--out", "out")
    out = tmp_path / "out"
    assert written(out) == {"run.json", "demonstrations.npz", "small.npz"}
    EpisodeLog.load(out / "small.npz")


def test_a_run_that_fails_keeps_the_results_of_the_earlier_one(
    refused, gplfd, tmp_path, monkeypatch, capsys
):
    run = (*ORACLE, "--doors", "small", "--out", "out")
    assert gplfd(*run, "--quiet") == 0
    capsys.readouterr()
    before = {file: file.read_bytes() for file in (tmp_path / "out").iterdir()}

    def fail(*_: Any, **__: Any) -> None:
        raise ValueError("no pose")

    monkeypatch.setattr(runs, "rollout", fail)
    assert refused(*run, "--seed", "1") == "no pose"
    assert {file: file.read_bytes() for file in before} == before


def test_a_run_may_be_randomized_and_disturbed_and_says_so(gplfd, tmp_path):
    run = (*ORACLE, "--doors", "small", "large", "--seed", "3", "--out", "hard")
    given = ("--randomization", "hard", "--disturbance", "person")
    assert gplfd(*run, *given) == 0
    small, large = (
        EpisodeLog.load(tmp_path / "hard" / f"{door}.npz")
        for door in ("small", "large")
    )
    assert small.door_config["hinge_friction"] != DOORS["small"].hinge_friction
    assert large.radius != small.radius, "each door of a run draws for itself"
    config = json.loads((tmp_path / "hard" / "run.json").read_text())["config"]
    assert config["randomization"] == "hard"
    metrics, _ = json.loads((tmp_path / "hard" / "metrics.json").read_text())
    assert metrics["person_force_peak"] == small.person_force.max() > 10.0


def test_a_policy_that_learns_nothing_is_not_said_to_learn(gplfd, monkeypatch, capsys):
    def stop(*_: Any) -> None:
        raise ValueError("enough")

    monkeypatch.setattr(runs, "learned_agents", stop)
    for policy, learns in {"hinge-fit": False, "gp-fixed": True}.items():
        assert gplfd("run", "--policy", policy, "--doors", "small") == 2
        assert ("learning from" in capsys.readouterr().err) is learns


def test_view_starts_the_viewer_itself(gplfd, tmp_path, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":0")
    started: list[list[str]] = []
    monkeypatch.setattr(viewer.subprocess, "call", lambda c: started.append(c) or 0)
    # A name that the viewer, given it alone, would take for an option.
    (tmp_path / "--version.rrd").write_bytes(b"RRF2")
    assert gplfd("view", "./--version.rrd") == 0
    assert started == [[viewer.viewer(), str(tmp_path / "--version.rrd")]]
    # Not the Python script of the same name, which would outlive its viewer.
    with open(viewer.viewer(), "rb") as executable:
        assert executable.read(2) != b"#!"


# --- What is refused ---------------------------------------------------------

REFUSED = [
    ("run --policy mine.py", "name a function in it, as in mine.py:make"),
    ("run --policy :", "':' names no module; give module:function or path/to"),
    ("run --policy oracel", "unknown policy 'oracel' (did you mean 'oracle'?)"),
    ("run --doors smal", "unknown door 'smal' (did you mean 'small'?)"),
    ("run --doors 1.2", "DoorConfig.radius = 1.2 is outside [0.3, 1.05]"),
    ("run --doors small small", "door small is given twice"),
    ("run --doors 0.4 0.40", "door 0.4 is given twice"),
    ("run --doors", "--doors needs at least one door"),
    ("run --seed -1", "--seed -1 must be 0 or more"),
    ("run --demonstrations-per-door 0", "--demonstrations-per-door 0 must be 1"),
    ("run --demonstrations none.npz", "there is no file none.npz"),
    ("run --out taken", "--out taken is a file; give a folder"),
    ("run --out taken/below", "taken"),
    ("run --randomization mid", "did you mean 'mild'"),
    ("run --skill none.npz", "there is no file none.npz"),
    ("run --skill demos.npz", "demos.npz cannot be read as a gplfd skill"),
    ("run --skill demos.npz --policy kmp", "'kmp' does not learn a skill"),
    ("run --skill a --demonstrations b", "omit --demonstrations"),
    ("run --skill a --demonstrated-forces", "omit it, or omit --skill"),
    ("run --video op.gif", "--video writes .mp4 files, got 'op.gif'"),
    ("run --doors small --video folder.mp4", "--video folder.mp4 is a folder"),
    ("run --doors far.json", "far.json holds no door: DoorConfig.radius"),
    ("run --doors hight.json", "hight.json holds no door: "),
    (
        "run --doors friction.json",
        "mean 'hinge_friction' or 'closer_friction' or 'roller_friction'?)",
    ),
    ("run --doors mass.json", "(did you mean 'panel_mass'?)"),
    ("run --doors list.json", "list.json"),
    ("run --doors small.json", "small is the name of a door already"),
    ("learn none.npz --out s", "there is no file none.npz"),
    ("learn demos.npz --out s --policy promp", "'promp' does not learn"),
    ("learn demos.npz --out s --policy oracle", "choose one of"),
    ("learn demos.npz --out s --seed -1", "--seed -1 must be 0"),
    ("learn demos.npz --out demos.npz/s", "--out demos.npz is a file"),
    ("figures --only fig02 fig08", "no figure 'fig08'; figures: fig02, fig03, fig"),
    ("figures --seed -1", "--seed -1 must be 0 or more"),
    ("figures --out taken", "--out taken is a file; give a folder"),
    ("speed --repeats 0", "--repeats 0 must be 1 or more"),
    ("speed --out taken", "--out taken is a file; give a folder"),
    ("benchmark --policies table-1 gp", "gp is given twice in --policies"),
    ("benchmark --policies gp-fixd", "did you mean 'gp-fixed'"),
    ("benchmark --policies", "--policies needs at least one value"),
    ("benchmark --doors smal", "did you mean 'small'"),
    ("benchmark --seeds 0", "--seeds 0 must be 1 or more"),
    ("benchmark --seeds 1000000000", "tasks; at most 100,000"),
    ("benchmark --demonstrations-per-door 0", "--demonstrations-per-door 0 must be"),
    ("benchmark --demonstrations-per-door 2 1001", "door 1001 must be 1 to 1000"),
    ("benchmark --teacher-noise 21", "--teacher-noise 21.0 must be 0 to 20"),
    ("benchmark --config smal", "--config smal: there is no such file"),
    ("benchmark --config study.toml", "unknown policy 'kpm' (did you mean 'kmp'?)"),
    ("benchmark --engine serial --workers 2", "--workers 2 is for --engine loky"),
    ("benchmark --engine dask --address 127.0.0.1", "no Dask scheduler answers"),
    ("benchmark --out taken", "--out taken is a file; give a folder"),
    ("demos record --policy oracel", "unknown policy 'oracel'"),
    ("demos record --policy oracle --doors smal", "unknown door 'smal'"),
    ("demos record --policy oracle --episodes 0", "--episodes 0 must be 1 or more"),
    ("demos record --policy oracle --seed -1", "--seed -1 must be 0 or more"),
    ("demos record --policy oracle --max-steps 0", "--max-steps 0 must be 1 or more"),
    ("demos record --policy oracle --out demos", "for example door-opening-v0"),
    ("demos record --policy oracle --out taken-v0", "taken-v0 exists and is no data"),
    ("demos record --policy oracle --out taken-v0/below-v0", "taken-v0"),
    ("demos import none.csv --out s", "there is no file none.csv"),
    ("demos import a.csv --out a.csv", "exists and is no set of demonstrations"),
    ("demos import a.csv --out a.csv/s", "--out a.csv is a file"),
    ("demos import a.csv --out s --frame 1,2,3", "must be numbers x,y,z,qw"),
    (
        "demos import a.csv --out s --gravity 0,1",
        "--gravity '0,1' must be numbers x,y,z",
    ),
    ("demos import a.csv --out s --gravity 0,0,0", "has no direction"),
    ("demos import a.csv --out s --offset a", "--offset 'a' must be numbers"),
    ("demos import a.csv --out s --segment 1-x", "none, rests, turns, or times"),
    ("demos import a.csv --out s --rate -1", "rate = -1 must be a positive"),
    ("demos import a.csv --out s", "a.csv cannot be read as a table in a text file"),
    # Another kind of file is named, and nothing is waited for.
    ("learn a.csv --out s.npz", "gplfd demos import a.csv --out SET"),
    ("learn a.npz --out s.npz", "gplfd demos import a.npz --out SET"),
    ("learn folder --out s.npz", "there is no demonstrations.npz in folder; gplf"),
    ("learn pipe --out s.npz", "pipe is a named pipe; give a set"),
    ("skill a.csv --out s", "gplfd demos import a.csv --out SET makes"),
    ("run --skill folder --out s", "folder is a folder; give a file (.npz) th"),
    ("run --skill pipe --out s", "pipe is a named pipe; give a file"),
    ("view pipe", "pipe is a named pipe; give a Rerun recording"),
    ("report study", "a.json: it is a named pipe; give a file"),
    ("view", "give a recording to open, for example"),
    ("view nothing.rrd", "there is no file nothing.rrd; `gplfd run` writes"),
    ("view folder", "folder is a folder; recordings in it: a.rrd"),
    ("view taken", "taken is neither a Rerun recording"),
    ("view folder/a.rrd", "rerun --serve-web --bind 127.0.0.1 folder/a.rrd"),
    ("view a.rrd --seed 1", "--seed needs --live and cannot be combined"),
    ("view a.rrd --serve", "--serve needs --live and cannot be combined"),
    ("view --live a.rrd", "cannot be combined with a.rrd"),
    ("view --live", "`gplfd view --live --serve` serves the episode to a browser"),
    ("view --live --speed 0", "--speed 0 must be positive and finite"),
    ("view --live --speed nan", "--speed nan must be positive"),
    ("view --live --speed inf", "--speed inf must be positive"),
    ("view --live --seed -1", "--seed -1 must be 0 or more"),
    ("view --live --serve --door smal", "unknown door 'smal'"),
    ("view --live --serve --policy oracel", "unknown policy 'oracel'"),
    ("benchmrk --seeds 3", "'benchmrk' (did you mean 'benchmark'?); give"),
    ("lst", "'lst' (did you mean 'list'?); give gplfd with one of run, learn"),
    ("demos imprt a.csv", "'demos imprt' (did you mean 'import'?); give"),
    ("zzz", "unknown command 'zzz'; give gplfd with one of run, learn"),
    # Names that are offered can be given, and a mapping, which Python takes, cannot.
    *(
        (f"{command.format(option)} absent", f"unknown {option} 'absent'; give one of")
        for command in ("run --{}", "benchmark --{}s", "view --live --serve --{}")
        for option in ("randomization", "disturbance")
    ),
]
FILES = {
    "far.json": '{"radius": 9.0}',
    "hight.json": '{"hight": 0.9}',
    "friction.json": '{"friction": 1}',
    "mass.json": '{"mass": 9}',
    "list.json": "[0.4]",
    "small.json": '{"radius": 0.4}',
    "study.toml": "policies = ['gp', 'kpm']",
    "a.csv": "x,y\n1,two\n",
    "taken": "hello",
    "taken-v0": "",
    "folder/a.rrd": "RRF2",
}


@pytest.mark.parametrize(("command", "message"), REFUSED)
def test_bad_input_is_one_line_status_2_and_no_files(
    refused, tmp_path, monkeypatch, command, message
):
    monkeypatch.setattr(sys, "platform", "linux")
    monkeypatch.setattr(live, "viewer_process", None)
    monkeypatch.setenv("MUJOCO_GL", "egl")
    for variable in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(variable, raising=False)
    for folder in ("folder.mp4", "folder", "study/tasks"):
        (tmp_path / folder).mkdir(parents=True)
    for name, content in FILES.items():
        (tmp_path / name).write_text(content)
    for pipe in ("pipe", "study/tasks/a.json"):
        os.mkfifo(tmp_path / pipe)
    np.savez(tmp_path / "a.npz", positions=np.zeros((9, 3)))
    if "demos.npz" in command:
        shown = Teacher().demonstrate_doors([0.5], 2, rng=np.random.default_rng(0))
        save_demonstrations(tmp_path / "demos.npz", shown)
    assert message in refused(*command.split())


@pytest.mark.parametrize(
    "command",
    ["run", "benchmark --policies oracle", "figures", "demos record --policy oracle"],
)
def test_a_disk_that_cannot_be_written_to_is_said_before_any_work(
    refused, tmp_path, monkeypatch, command
):
    monkeypatch.setattr(os, "access", lambda *_: False)
    said = refused(*command.split(), "--out", "new/data-v0")
    assert said.startswith(f"{tmp_path}: is not writable")


def test_debug_prints_the_traceback_of_an_error(gplfd, capsys):
    for command in ("run --doors smal --debug", "--debug view nothing.rrd"):
        assert gplfd(*command.split()) == 2
        first, second, *_ = capsys.readouterr().err.splitlines()
        assert first.startswith("gplfd: ")
        assert second == "Traceback (most recent call last):"


# --- Doors and names ---------------------------------------------------------


def test_doors_are_names_radii_and_files(tmp_path):
    own = tmp_path / "pantry.json"
    own.write_text('{"preset": "heavy", "radius": 0.44}')
    whole = tmp_path / "whole.json"
    whole.write_text(json.dumps(DOORS["room-834"].as_dict()))
    assert named_doors([str(own), str(whole), "large", "0.420"]) == {
        "pantry": DOORS["heavy"].replaced({"radius": 0.44}),
        "whole": DOORS["room-834"],
        "large": DOORS["large"],
        "0.42": DoorConfig(radius=0.42),
    }


def test_list_names_everything_and_states_the_radii_that_can_be_given(gplfd, capsys):
    assert gplfd("list") == 0
    first, *rest = capsys.readouterr().out.splitlines()
    low, high, standing = re.findall(r"\d\.\d+", first)
    assert named_doors([low, high, standing]).keys() == {low, high, standing}
    for beyond in (float(low) - 0.01, float(high) + 0.01):
        with pytest.raises(ValueError, match="outside"):
            named_doors([f"{beyond:g}"])
    assert base_for(DoorConfig(radius=float(standing)), TIAGO_LIKE) == "fixed"
    assert base_for(DoorConfig(radius=float(standing) + 0.01), TIAGO_LIKE) == "mobile"
    assert gplfd("list", "--json") == 0
    listed = json.loads(capsys.readouterr().out)
    assert {line.split()[0] for line in rest if line[:2] == "  "} == {
        name for section in listed.values() for name in section
    }
    assert set(listed["doors"]) == set(DOORS)
    assert set(listed["environments"]) == {
        *ENVIRONMENT_IDS.values(),
        GRIPPER_ENVIRONMENT_ID,
        MOBILE_ENVIRONMENT_ID,
        RL_ENVIRONMENT_ID,
    }
    assert set(listed["randomizations"]) == set(RANDOMIZATIONS)
    assert set(listed["disturbances"]) == set(DISTURBANCES)
    kinds = ("methods", "ablations", "references")
    assert {name for kind in kinds for name in listed[kind]} == set(POLICIES)


# --- Help --------------------------------------------------------------------


def test_help_and_errors_have_no_colours_where_nobody_sees_them(gplfd, capsys):
    assert gplfd("--help") == 0
    assert gplfd("list", "--jsn") == 2
    assert gplfd("run", "--seed", "many") == 2
    printed = capsys.readouterr()
    # The overview has the first paragraph of each command's description.
    assert "Learn from demonstrations, open doors" in printed.out
    assert "Writes DIR/" not in printed.out
    assert "Unrecognized options: --jsn" in printed.err
    assert "\x1b" not in printed.out + printed.err


@pytest.mark.parametrize(
    ("command", "width"),
    [*((command, 80) for command in (*cli.COMMANDS, "demos import", "")), ("run", 120)],
)
def test_help_breaks_lines_at_the_width_of_the_terminal_only(
    gplfd, monkeypatch, capsys, command, width
):
    monkeypatch.setenv("COLUMNS", str(width))
    assert gplfd(*command.split(), "--help") == 0
    printed = capsys.readouterr().out
    assert "{None}" not in printed
    assert max(map(len, printed.splitlines()[2:])) <= width
    _, _, rest = printed.partition("\n\n")
    description, *boxes = re.split(r"\n\n[╭ ]", rest)
    assert boxes
    for line, following in itertools.pairwise(description.splitlines()):
        if line and following:
            assert len(line) + 1 + len(following.split()[0]) > width
    if width == 120:  # Nor where the docstring of an option is broken.
        options = " names (see `gplfd list`), radii in metres, or .json files of door p"
        assert options in printed


def test_shells_can_complete_it(gplfd, capsys):
    assert gplfd("--tyro-print-completion", "bash") == 0
    script = capsys.readouterr().out
    assert "--randomization" in script
    assert "doctor" in script


# --- Processes ---------------------------------------------------------------


def python(code, **environment):
    return subprocess.run(
        [sys.executable, *code],
        check=False,
        capture_output=True,
        text=True,
        env=environment,
    )


def test_numpy_is_kept_to_one_thread_unless_the_user_says_otherwise():
    code = (
        "import os, gplfd_experiments.cli.main as cli\n"
        "cli.main(['view', 'nothing.rrd'])\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])\n"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "3"}
    environment.pop("OMP_NUM_THREADS", None)
    assert python(("-c", code), **environment).stdout.split()[-2:] == ["3", "1"]


def test_help_loads_neither_simulator_nor_viewer():
    code = (
        "import sys, gplfd_experiments.cli.main as cli\n"
        "try: cli.main(['run', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'mujoco', 'rerun', 'scipy', 'numpy'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)\n"
    )
    assert python(("-c", code), **os.environ).returncode == 0


def test_runs_as_a_module():
    wide = {**os.environ, "COLUMNS": "200"}
    finished = python(("-m", "gplfd", "run", "--doors", "nowhere"), **wide)
    assert finished.returncode == 2
    assert "unknown door 'nowhere'" in finished.stderr
