"""`gplfd benchmark`: what it runs, what it keeps, and what it refuses."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from pathlib import Path
from typing import Any

import pytest

from gplfd_experiments.cli.main import main
from gplfd_experiments.studies import jobs, runner, tasks
from gplfd_experiments.studies.settings import StudySettings, read_settings

pytestmark = pytest.mark.slow


@pytest.fixture
def ran(monkeypatch, episode_result, learning_result):
    """Replace what a worker does; remember the tasks."""
    tasks = []
    metrics = {
        "episode": episode_result("gp", radius=0.35)["metrics"],
        "skill": learning_result("gp")["metrics"],
    }

    def run_job(job: Any, **_: Any) -> list[Any]:
        tasks.extend(job)
        return [
            jobs.failed(task, "ValueError: cannot learn")
            if (task.policy, task.seed) == ("oracle", 1)
            else {**jobs._origin(task), "metrics": metrics[task.kind]}
            for task in job
        ]

    monkeypatch.setattr(runner, "run_job", run_job)
    return tasks


ONE = ("--policies", "gp", "--doors", "small", "--no-skill", "--seeds")
"""A study of one episode per seed."""


def benchmark(out: Path, *arguments: str) -> int:
    try:
        return main(["benchmark", "--engine", "serial", "--out", str(out), *arguments])
    except SystemExit as error:
        return int(error.code or 0)


def test_writes_table_and_settings_and_says_where(tmp_path, ran, capsys):
    options = ["--policies", "gp", "oracle", "--doors", "small", "--seeds", "2"]
    assert benchmark(tmp_path, *options) == 1
    printed = capsys.readouterr()
    table = (tmp_path / "table.md").read_text()
    head, gp, oracle = printed.out.splitlines()[2:5]
    heads = ["policy", "door", "opened", "radial force [N]", "not opened because"]
    assert re.split(r"  +", head) == heads
    assert [gp.split()[:3], oracle.split()[:3]] == [
        ["gp", "small", "2/2"],
        ["oracle", "small", "1/2"],
    ]
    assert "| gp | small | 2/2 |" in table
    assert "| oracle | small | 1/2 |" in table
    assert table.startswith(
        "1 of 4 episodes ended in an error of the policy and count as not opened: "
        "oracle 1.\n"
    )
    assert f"gplfd report {tmp_path}" in printed.out
    said = [line for line in printed.err.splitlines() if line.startswith("gplfd: ")]
    assert said[0] == "gplfd: 8 tasks, 0 of them done already"
    assert said[1].startswith("gplfd: 1 of 8 tasks ended in errors, kept in ")
    assert said[2:] == ["gplfd: oracle, small, seed 1: ValueError: cannot learn"]
    kept = read_settings(tmp_path / "study.toml")
    assert kept == StudySettings(policies=("gp", "oracle"), doors=("small",), seeds=2)
    config = json.loads((tmp_path / "study.json").read_text())["config"]
    assert (config["seeds"], config["engine"]) == (2, "serial")
    # Two episodes per policy, and two learning tests per seed of the one that learns.
    assert len(ran) == 4 + 4
    assert len(list((tmp_path / "tasks").iterdir())) == 8
    assert benchmark(tmp_path, *options) == 1
    assert [(task.policy, task.seed) for task in ran[8:]] == [("oracle", 1)]


def test_a_later_version_s_study_is_refused_and_kept(tmp_path, ran, capsys):
    assert benchmark(tmp_path, *ONE, "1") == 0
    file = tmp_path / "study.json"
    later = file.read_text().replace('"format_version": 1', '"format_version": 7')
    file.write_text(later)
    capsys.readouterr()
    assert benchmark(tmp_path, *ONE, "2") == 2
    assert f"gplfd: {file}: it has version 7 of gplfd " in capsys.readouterr().err
    assert file.read_text() == later
    assert len(ran) == 1


def test_every_condition_has_a_table_and_as_json_its_rows(
    tmp_path, ran, episode_result, capsys
):
    varied = ("--teacher-noise", "1", "2", "--randomizations", "none", "hard")
    study = (*ONE, "2", *varied)
    assert benchmark(tmp_path, *study) == 0
    printed = capsys.readouterr().out
    rows = [line for line in printed.splitlines() if line.startswith("gp ")]
    assert [row.split()[:3] for row in rows] == [["gp", "small", "2/2"]] * 4
    said = "2 demonstrations per door, teacher noise × 2, randomization hard:"
    assert said in printed
    assert benchmark(tmp_path, *study, "--json") == 0
    rows = json.loads(capsys.readouterr().out)
    assert len(rows) == 4
    metrics = episode_result("gp", radius=0.35)["metrics"]
    numbers = {"episodes": 2, "errors": 0, "opened": 2}
    expected = numbers | {"force_radial_peak": metrics["force_radial_peak"]}
    for row in rows:
        assert row.items() >= {"policy": "gp", "door": "small", **expected}.items()


WAITING = """\
import time
from pathlib import Path

class Pushing:  # Its hand slips off the handle at once.
    def act(self, observation):
        return [-0.3, 0.3, 0.0, 0.0, 0.0, 0.0]

def make(training):
    while training.seed >= int(Path("allowed").read_text()):
        time.sleep(0.02)
    return Pushing()
"""
"""A policy that learns from as many seeds as a file allows, and waits for more."""

STUDY = [*("--policies", "waiting:make", "--doors", "small"), *ONE[-2:], "2"]
"""Two jobs of one seed."""

INTERRUPTED = """\
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from gplfd.__main__ import main
from gplfd_experiments.studies import tasks
tasks.TOGETHER = 1
sys.exit(main())
"""
"""The command, also where pytest is a shell's background job, which ignores SIGINT."""


def files(out: Path) -> list[Path]:
    return sorted((out / "tasks").glob("[!.]*.json"))


@pytest.mark.usefixtures("policies_here")
@pytest.mark.parametrize("interrupt", ["a terminal does", "kill does"])
def test_a_study_that_was_interrupted_goes_on(interrupt, tmp_path, monkeypatch):
    monkeypatch.setattr(tasks, "TOGETHER", 1)
    monkeypatch.delitem(sys.modules, "waiting", raising=False)
    monkeypatch.chdir(tmp_path)
    Path("waiting.py").write_text(WAITING)
    Path("allowed").write_text("1")
    command = ["benchmark", *STUDY, "--out", "stopped", "--workers", "1"]
    process = subprocess.Popen(
        [sys.executable, "-c", INTERRUPTED, *command],
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    until = time.monotonic() + 300.0
    while not files(Path("stopped")):
        assert process.poll() is None
        assert time.monotonic() < until
        time.sleep(0.02)
    if interrupt == "kill does":
        process.terminate()
    else:  # It tells all processes.
        os.killpg(process.pid, signal.SIGINT)
    # Ends when the last process that could write has ended: the workers, too.
    _, printed = process.communicate(timeout=300.0)
    assert process.returncode == 130
    assert printed.splitlines()[-1] == (
        "gplfd: interrupted; finished files are kept; run the same command again to go "
        "on"
    )
    assert "Traceback" not in printed
    content = {path: path.read_bytes() for path in files(Path("stopped"))}
    Path("allowed").write_text("2")
    assert benchmark(Path("stopped"), *STUDY) == 0
    assert len(files(Path("stopped"))) == 2
    # What was finished was not done again.
    assert {path: path.read_bytes() for path in content} == content
