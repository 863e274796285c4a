import hashlib
import json
import os
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from experiments import cli
from experiments.commands import view
from experiments.datasets.npz import load_demonstrations
from experiments.episodes.log import EpisodeLog
from experiments.episodes.metrics import episode_metrics
from experiments.recording.viewer import viewer
from experiments.study.doors import named_doors

Gplfd = Callable[..., int]


@pytest.fixture
def gplfd(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Gplfd:
    """Run the command in an empty folder; parser errors become exit statuses."""
    monkeypatch.chdir(tmp_path)
    for variable in ("OPENBLAS_NUM_THREADS", "OMP_NUM_THREADS", "MKL_NUM_THREADS"):
        monkeypatch.setenv(variable, "1")
    monkeypatch.setenv("VECLIB_MAXIMUM_THREADS", "1")

    def run(*arguments: str) -> int:
        try:
            return cli.main(arguments)
        except SystemExit as error:
            return int(error.code or 0)

    return run


def written(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_run_tells_of_doors_of_an_earlier_run(
    gplfd: Gplfd, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    out = tmp_path / "out"
    for doors in (["0.42"], ["small"]):
        gplfd("run", "--doors", *doors, "--policy", "oracle", "--out", str(out))
    assert f"{out} also keeps 0.42.rrd of an earlier run" in capsys.readouterr().err


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
    assert config["demonstrations_sha256"] == hashlib.sha256(learned_from).hexdigest()
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
        (["--policy", "oracel"], "unknown policy 'oracel' (did you mean 'oracle'?)"),
        (["--doors", "smal"], "unknown door 'smal' (did you mean 'small'?)"),
        (["--doors", "0.95"], "DoorConfig.radius = 0.95 is outside [0.3, 0.65]"),
        (["--doors", "small", "small"], "door small is given twice"),
        (["--doors", "0.4", "0.40"], "door 0.4 is given twice"),
        (["--doors"], "--doors needs at least one door"),
        (["--seed", "-1"], "--seed -1 must be 0 or more"),
        (["--demonstrations-per-door", "0"], "--demonstrations-per-door 0 must be 1"),
        (["--demonstrations", "none.npz"], "there is no file none.npz"),
        (["--out", "taken"], "--out taken is a file; give a folder"),
        (["--out", "taken/below"], "taken"),
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


def test_parser_errors_have_status_2(gplfd: Gplfd) -> None:
    assert gplfd("run", "--seed", "many") == 2
    assert gplfd("rum") == 2
    assert gplfd("run", "--help") == 0


def test_ctrl_c_has_status_130_and_leaves_only_complete_files(
    gplfd: Gplfd,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    from experiments import recording

    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(recording, "record_episode", interrupt)
    out = tmp_path / "out"
    arguments = ["--doors", "small", "--policy", "oracle", "--out", str(out)]
    assert gplfd("run", *arguments) == 130
    assert "interrupted" in capsys.readouterr().err
    assert written(out) == {"run.json", "demonstrations.npz", "small.npz"}
    EpisodeLog.load(out / "small.npz")


def test_list_names_everything(
    gplfd: Gplfd, capsys: pytest.CaptureFixture[str]
) -> None:
    assert gplfd("list") == 0
    printed = capsys.readouterr().out
    for name in ("small", "medium", "large", "gp ", "oracle", "gplfd/DoorOpening-v0"):
        assert name in printed


def test_named_doors_take_names_and_radii() -> None:
    doors = named_doors(["large", "0.420"])
    assert {name: config.radius for name, config in doors.items()} == {
        "large": 0.65,
        "0.42": 0.42,
    }


def test_view_starts_the_viewer_itself(
    gplfd: Gplfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("DISPLAY", ":0")
    started: list[list[str]] = []

    def call(command: list[str]) -> int:
        started.append(command)
        return 0

    monkeypatch.setattr(view.subprocess, "call", call)
    (tmp_path / "a.rrd").write_bytes(b"RRF2")
    assert gplfd("view", "a.rrd") == 0
    assert started == [[viewer(), "a.rrd"]]
    # Not the Python script of the same name, which would outlive its viewer.
    with open(viewer(), "rb") as executable:
        assert executable.read(2) != b"#!"


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
        "import os, experiments.cli as cli\n"
        "cli.main(['list'])\n"
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
        "import sys, experiments.cli as cli\n"
        "try: cli.main(['run', '--help'])\n"
        "except SystemExit: pass\n"
        "heavy = {'mujoco', 'rerun', 'scipy', 'numpy'} & set(sys.modules)\n"
        "sys.exit(f'loaded {heavy}' if heavy else 0)\n"
    )
    subprocess.run([sys.executable, "-c", code], check=True, capture_output=True)


def test_runs_as_a_module() -> None:
    finished = subprocess.run(
        [sys.executable, "-m", "experiments.cli", "run", "--doors", "nowhere"],
        check=False,
        capture_output=True,
        text=True,
        env={**os.environ, "COLUMNS": "200"},
    )
    assert finished.returncode == 2
    assert "unknown door 'nowhere'" in finished.stderr
