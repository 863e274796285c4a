import hashlib
import itertools
import json
import os
import re
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
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
from gplfd_experiments.cli import main as cli
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.episodes.task import named_doors
from gplfd_experiments.recording import viewer
from gplfd_experiments.workflows import runs
from gplfd_policies.demonstrations.npz import load_demonstrations
from gplfd_policies.registry.catalogue import POLICIES

pytestmark = pytest.mark.slow

Gplfd = Callable[..., int]


def written(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_run_replaces_what_an_earlier_run_wrote_and_nothing_else(
    gplfd: Gplfd, tmp_path: Path
) -> None:
    out = tmp_path / "out"
    oracle = ("run", "--policy", "oracle", "--out", str(out))
    gplfd(*oracle, "--doors", "0.42", "0.5")
    for name in ("0.42.png", "notes.npz", "large.rrd"):
        (out / name).touch()
    gplfd(*oracle, "--doors", "small")
    assert written(out) == {
        *("metrics.json", "run.json", "demonstrations.npz", "small.rrd", "small.npz"),
        *("0.42.png", "notes.npz", "large.rrd"),
    }


@pytest.mark.parametrize(
    "content", ["{", "[]", '{"config": {"policy": "gp"}}', '{"config": 3}']
)
def test_run_keeps_out_of_a_folder_whose_content_is_not_known(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str], content: str
) -> None:
    (tmp_path / "run.json").write_text(content)
    assert gplfd("run", "--policy", "oracle", "--out", ".") == 2
    assert "run.json does not say what was written" in capsys.readouterr().err
    assert (tmp_path / "run.json").read_text() == content


def test_run_removes_nothing_outside_its_folder(gplfd: Gplfd, tmp_path: Path) -> None:
    (tmp_path / "mine.npz").touch()
    out = tmp_path / "out"
    out.mkdir()
    doors = {"../mine": {}, str(tmp_path / "mine"): {}, "small": {}}
    (out / "run.json").write_text(json.dumps({"config": {"door_configs": doors}}))
    oracle = ("--policy", "oracle", "--doors", "0.42", "--out", str(out))
    assert gplfd("run", *oracle) == 0
    assert (tmp_path / "mine.npz").exists()


def test_run_writes_metrics_logs_recordings_and_where_they_came_from(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    doors = ["--doors", "small", "0.42"]
    assert gplfd("run", *doors, "--policy", "oracle", "--out", str(out)) == 0
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
    assert "small" in printed.out
    assert f"gplfd view {out / 'small.rrd'}" in printed.out
    assert "0.42: opened" in printed.err


def test_same_seed_gives_the_same_log(gplfd: Gplfd, tmp_path: Path) -> None:
    for name in ("a", "b"):
        arguments = ["--doors", "small", "--policy", "oracle", "--out", name]
        assert gplfd("run", *arguments) == 0
    first, second = (EpisodeLog.load(tmp_path / n / "small.npz") for n in ("a", "b"))
    assert first.qpos.tobytes() == second.qpos.tobytes()
    assert first.wrench.tobytes() == second.wrench.tobytes()


def test_run_learns_from_a_file(gplfd: Gplfd, tmp_path: Path) -> None:
    common = ["--doors", "small", "--policy", "oracle"]
    assert gplfd("run", *common, "--demonstrations-per-door", "1", "--out", "a") == 0
    file = tmp_path / "a" / "demonstrations.npz"
    assert gplfd("run", *common, "--demonstrations", str(file), "--out", "b") == 0
    copy = load_demonstrations(tmp_path / "b" / "demonstrations.npz")
    assert len(copy.demonstrations) == 3
    np.testing.assert_array_equal(
        copy.demonstrations[2].poses,
        load_demonstrations(file).demonstrations[2].poses,
    )


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--policy", "mine.py"], "name a function in it, as in mine.py:make"),
        (["--policy", ":"], "':' names no module; give module:function or path/to"),
        (["--policy", "oracel"], "unknown policy 'oracel' (did you mean 'oracle'?)"),
        (["--doors", "smal"], "unknown door 'smal' (did you mean 'small'?)"),
        (["--doors", "1.2"], "DoorConfig.radius = 1.2 is outside [0.3, 0.95]"),
        (["--doors", "small", "small"], "door small is given twice"),
        (["--doors", "0.4", "0.40"], "door 0.4 is given twice"),
        (["--doors"], "--doors needs at least one door"),
        (["--seed", "-1"], "--seed -1 must be 0 or more"),
        (["--demonstrations-per-door", "0"], "--demonstrations-per-door 0 must be 1"),
        (["--demonstrations", "none.npz"], "there is no file none.npz"),
        (["--out", "taken"], "--out taken is a file; give a folder"),
        (["--out", "taken/below"], "taken"),
        (["--randomization", "mid"], "did you mean 'mild'"),
    ],
)
def test_bad_input_is_one_paragraph_status_2_and_no_files(
    gplfd: Gplfd,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    (tmp_path / "taken").write_text("")
    assert gplfd("run", "--policy", "oracle", *arguments) == 2
    printed = capsys.readouterr().err
    complaint = printed.splitlines()[-1]
    assert complaint.startswith("gplfd: ")
    assert message in complaint
    assert "Traceback" not in printed
    assert written(tmp_path) == {"taken"}


@pytest.mark.parametrize(
    "command",
    [
        ("run", "--policy", "oracle"),
        ("benchmark", "--policies", "oracle"),
        ("figures",),
        ("demos", "record", "--policy", "oracle"),
    ],
)
def test_a_disk_that_cannot_be_written_to_is_said_before_any_work(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: tuple[str, ...],
) -> None:
    monkeypatch.setattr(os, "access", lambda *_: False)
    assert gplfd(*command, "--out", "new/data-v0") == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"gplfd: {tmp_path}: cannot be written to")
    assert written(tmp_path) == set()


def test_parser_errors_have_status_2(gplfd: Gplfd) -> None:
    assert gplfd("run", "--seed", "many") == 2
    assert gplfd("run", "--help") == 0


def test_an_interruption_leaves_only_complete_files(
    gplfd: Gplfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(runs, "record_episode", interrupt)
    out = tmp_path / "out"
    with pytest.raises(KeyboardInterrupt):
        gplfd("run", "--doors", "small", "--policy", "oracle", "--out", str(out))
    assert written(out) == {"run.json", "demonstrations.npz", "small.npz"}
    EpisodeLog.load(out / "small.npz")


def test_a_run_in_a_randomized_world_says_which_door_it_was(
    gplfd: Gplfd, tmp_path: Path
) -> None:
    common = ["--doors", "small", "large", "--policy", "oracle", "--seed", "3"]
    assert gplfd("run", *common, "--randomization", "hard", "--out", "hard") == 0
    assert gplfd("run", *common, "--out", "none") == 0
    hard, none = (
        EpisodeLog.load(tmp_path / name / "small.npz") for name in ("hard", "none")
    )
    assert none.door_config["hinge_friction"] != hard.door_config["hinge_friction"]
    other = EpisodeLog.load(tmp_path / "hard" / "large.npz")
    assert other.radius != hard.radius, "each door of a run draws for itself"
    config = json.loads((tmp_path / "hard" / "run.json").read_text())["config"]
    assert config["randomization"] == "hard"


def test_a_run_may_be_disturbed(gplfd: Gplfd, tmp_path: Path) -> None:
    run = ["run", "--doors", "medium", "--policy", "oracle", "--out", "held"]
    assert gplfd(*run, "--disturbance", "person") == 0
    assert EpisodeLog.load(tmp_path / "held" / "medium.npz").person_force.max() > 10.0
    (metrics,) = json.loads((tmp_path / "held" / "metrics.json").read_text())
    assert metrics["person_force_peak"] > 10.0
    assert gplfd(*run, "--disturbance", "persn") == 2


def test_list_names_everything(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gplfd("list") == 0
    printed = capsys.readouterr().out
    for name in ("small", "medium", "large", "gp ", "oracle", "gplfd/DoorOpening-v1"):
        assert name in printed


def test_list_states_the_radii_that_can_be_given(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gplfd("list") == 0
    first = capsys.readouterr().out.splitlines()[0]
    low, high, standing = re.findall(r"\d\.\d+", first)
    assert named_doors([low, high, standing]).keys() == {low, high, standing}
    for beyond in (float(low) - 0.01, float(high) + 0.01):
        with pytest.raises(ValueError, match="outside"):
            named_doors([f"{beyond:g}"])
    assert base_for(DoorConfig(radius=float(standing))) == "fixed"
    assert base_for(DoorConfig(radius=float(standing) + 0.01)) == "mobile"


def test_list_as_json_names_what_can_be_given(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gplfd("list", "--json") == 0
    listed = json.loads(capsys.readouterr().out)
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


def test_run_as_json_prints_its_metrics_and_nothing_else(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    oracle = ("--policy", "oracle", "--doors", "small", "--out", "out")
    assert gplfd("run", *oracle, "--json") == 0
    written = json.loads((tmp_path / "out" / "metrics.json").read_text())
    assert json.loads(capsys.readouterr().out) == written


def test_help_and_errors_have_no_colours_where_nobody_sees_them(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gplfd("--help") == 0
    assert gplfd("list", "--jsn") == 2
    printed = capsys.readouterr()
    assert "doctor" in printed.out
    # The overview has the first paragraph of each command's description.
    assert "Learn from demonstrations, open doors" in printed.out
    assert "Writes DIR/" not in printed.out
    assert "Unrecognized options: --jsn" in printed.err
    assert "\x1b" not in printed.out + printed.err


@pytest.mark.parametrize(
    ("command", "message"),
    [
        (("benchmrk", "--seeds", "3"), "'benchmrk' (did you mean 'benchmark'?); give"),
        (("lst",), "'lst' (did you mean 'list'?); give gplfd with one of run, learn"),
        (("demos", "imprt", "a.csv"), "'demos imprt' (did you mean 'import'?); give"),
        (("zzz",), "'zzz'; give gplfd with one of run, learn"),
    ],
)
def test_a_mistyped_command_is_refused_with_a_suggestion(
    gplfd: Gplfd,
    capsys: pytest.CaptureFixture[str],
    command: tuple[str, ...],
    message: str,
) -> None:
    assert gplfd(*command) == 2
    (said,) = capsys.readouterr().err.splitlines()
    assert said.startswith(f"gplfd: unknown command {message}")


def test_subcommands_that_are_suggested_exist(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    for command, names in cli.SUBCOMMANDS.items():
        assert gplfd(command, "--help") == 0
        assert f"{{{','.join(names)}}}" in capsys.readouterr().out


def test_debug_prints_the_traceback_of_an_error(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    for arguments in (
        ("run", "--doors", "smal", "--debug"),
        ("--debug", "view", "nothing.rrd"),
    ):
        assert gplfd(*arguments) == 2
        first, second, *_ = capsys.readouterr().err.splitlines()
        assert first.startswith("gplfd: ")
        assert second == "Traceback (most recent call last):"


@pytest.mark.parametrize("width", [80, 120])
@pytest.mark.parametrize("command", [*cli.COMMANDS, "demos import", ""])
def test_help_breaks_lines_at_the_width_of_the_terminal_only(
    gplfd: Gplfd,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    command: str,
    width: int,
) -> None:
    monkeypatch.setenv("COLUMNS", str(width))
    assert gplfd(*command.split(), "--help") == 0
    printed = capsys.readouterr().out
    assert max(map(len, printed.splitlines()[2:])) <= width
    _, _, rest = printed.partition("\n\n")
    description, *boxes = re.split(r"\n\n[╭ ]", rest)
    assert boxes
    for line, following in itertools.pairwise(description.splitlines()):
        if line and following:
            assert len(line) + 1 + len(following.split()[0]) > width


def test_help_of_options_is_not_broken_where_its_docstring_is(
    gplfd: Gplfd, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("COLUMNS", "120")
    assert gplfd("run", "--help") == 0
    assert " names (see `gplfd list`), radii in metres, or .json files of door p" in (
        capsys.readouterr().out
    )


@pytest.mark.parametrize("command", ["run", "benchmark", "view", "demos record"])
def test_help_names_every_randomization(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str], command: str
) -> None:
    assert gplfd(*command.split(), "--help") == 0
    printed = " ".join(capsys.readouterr().out.replace("│", " ").split())
    *names, last = RANDOMIZATIONS
    assert f"{', '.join(names)} or {last}" in printed


@pytest.mark.parametrize("shell", ["bash", "zsh"])
def test_shells_can_complete_it(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str], shell: str
) -> None:
    assert gplfd("--tyro-print-completion", shell) == 0
    script = capsys.readouterr().out
    assert "--randomization" in script
    assert "doctor" in script


def test_named_doors_take_names_and_radii() -> None:
    doors = named_doors(["large", "0.420"])
    assert {name: config.radius for name, config in doors.items()} == {
        "large": 0.65,
        "0.42": 0.42,
    }


def test_a_door_of_one_s_own_is_given_as_a_file(tmp_path: Path) -> None:
    own = tmp_path / "pantry.json"
    own.write_text('{"preset": "heavy", "radius": 0.44}')
    whole = tmp_path / "whole.json"
    whole.write_text(json.dumps(DOORS["room-834"].as_dict()))
    doors = named_doors([str(own), str(whole), "small"])
    assert list(doors) == ["pantry", "whole", "small"]
    assert doors["pantry"] == DOORS["heavy"].replaced({"radius": 0.44})
    assert doors["whole"] == DOORS["room-834"]


@pytest.mark.parametrize(
    ("name", "content", "complaint"),
    [
        ("pantry.json", '{"radius": 9.0}', "pantry.json holds no door: .*radius"),
        ("pantry.json", '{"hight": 0.9}', "holds no door: .*hight"),
        ("a.json", '{"friction": 1}', r"mean 'hinge_friction' or 'closer_friction'\?"),
        ("a.json", '{"mass": 9}', r"\(did you mean 'panel_mass'\?\)"),
        ("pantry.json", "[0.4]", "pantry.json"),
        ("small.json", '{"radius": 0.4}', "small is the name of a door already"),
    ],
)
def test_a_file_that_is_no_door_is_refused(
    gplfd: Gplfd,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    name: str,
    content: str,
    complaint: str,
) -> None:
    file = tmp_path / name
    file.write_text(content)
    assert gplfd("run", "--doors", str(file), "--out", str(tmp_path / "out")) == 2
    assert re.search(complaint, capsys.readouterr().err)
    assert not (tmp_path / "out").exists()


def test_a_policy_that_learns_nothing_is_not_said_to_learn(
    gplfd: Gplfd, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    def stop(*_: Any) -> None:
        raise ValueError("enough")

    monkeypatch.setattr(runs, "learned_agents", stop)
    for policy, learns in {"hinge-fit": False, "gp-fixed": True}.items():
        assert gplfd("run", "--policy", policy, "--doors", "small") == 2
        assert ("learning from" in capsys.readouterr().err) is learns


@pytest.mark.parametrize("command", [("view",), ("demos", "record")])
def test_help_shows_no_none(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str], command: tuple[str, ...]
) -> None:
    gplfd(*command, "--help")
    assert "{None}" not in capsys.readouterr().out


def test_view_starts_the_viewer_itself(
    gplfd: Gplfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    started: list[list[str]] = []

    def call(command: list[str]) -> int:
        started.append(command)
        return 0

    monkeypatch.setattr(viewer.subprocess, "call", call)
    # A name that the viewer, given it alone, would take for an option.
    (tmp_path / "--version.rrd").write_bytes(b"RRF2")
    assert gplfd("view", "./--version.rrd") == 0
    assert started == [[viewer.viewer(), str(tmp_path / "--version.rrd")]]
    # Not the Python script of the same name, which would outlive its viewer.
    with open(viewer.viewer(), "rb") as executable:
        assert executable.read(2) != b"#!"


@pytest.mark.parametrize(
    ("option", "names"),
    [("randomization", "none, mild, hard"), ("disturbance", "none, push, person, ")],
)
@pytest.mark.parametrize(
    "command", ["run --{}", "benchmark --{}s", "view --live --serve --{}"]
)
def test_names_that_are_offered_can_be_given(
    gplfd: Gplfd,
    capsys: pytest.CaptureFixture[str],
    command: str,
    option: str,
    names: str,
) -> None:
    """A mapping, which Python takes, cannot."""
    assert gplfd(*command.format(option).split(), "absent") == 2
    said = capsys.readouterr().err
    assert f"unknown {option} 'absent'; give one of {names}" in said
    assert "mapping" not in said


@pytest.mark.parametrize(
    ("file", "display", "message"),
    [
        ("nothing.rrd", ":0", "there is no file nothing.rrd; `gplfd run` writes"),
        ("folder", ":0", "folder is a folder; recordings in it: a.rrd"),
        ("text.rrd", ":0", "text.rrd is not a Rerun recording"),
        ("folder/a.rrd", "", "rerun --serve-web --bind 127.0.0.1 folder/a.rrd"),
    ],
)
def test_view_says_what_is_wrong(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
    file: str,
    display: str,
    message: str,
) -> None:
    monkeypatch.setenv("DISPLAY", display)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)
    (tmp_path / "folder").mkdir()
    (tmp_path / "folder" / "a.rrd").write_bytes(b"RRF2")
    (tmp_path / "text.rrd").write_text("hello")
    assert gplfd("view", file) == 2
    assert message in capsys.readouterr().err


def test_numpy_is_kept_to_one_thread_unless_the_user_says_otherwise() -> None:
    code = (
        "import os, gplfd_experiments.cli.main as cli\n"
        "cli.main(['view', 'nothing.rrd'])\n"
        "print(os.environ['OPENBLAS_NUM_THREADS'], os.environ['OMP_NUM_THREADS'])\n"
    )
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "3"}
    environment.pop("OMP_NUM_THREADS", None)
    finished = subprocess.run(
        [sys.executable, "-c", code],
        check=True,
        capture_output=True,
        text=True,
        env=environment,
    )
    assert finished.stdout.split()[-2:] == ["3", "1"]


def test_help_loads_neither_simulator_nor_viewer() -> None:
    code = (
        "import sys, gplfd_experiments.cli.main as cli\n"
        "try: cli.main(['run', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'mujoco', 'rerun', 'scipy', 'numpy'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_runs_as_a_module() -> None:
    finished = subprocess.run(
        [sys.executable, "-m", "gplfd", "run", "--doors", "nowhere"],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert finished.returncode == 2
    assert "unknown door 'nowhere'" in finished.stderr
