"""Submissions: submit, then verify; what is changed, foreign or strange is found."""

import dataclasses
import hashlib
import importlib
import json
import sys
import zipfile
from pathlib import Path

import pytest

from gplfd_experiments.cli.main import main
from gplfd_experiments.files.provenance import code_state
from gplfd_experiments.studies import jobs
from gplfd_experiments.studies.engines import Engine
from gplfd_experiments.studies.runner import run_or_resume
from gplfd_experiments.studies.trials import protocol
from gplfd_experiments.workflows import submissions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("short_episodes")]

ROOT = Path(__file__).parents[2]
STILL = """
import helper

class Still:
    def act(self, observation):
        return helper.pose * 0.0 + observation["ee_pose"]

def make(training):
    return Still()
"""
CARD = ["--authors", "A. Author", "--code", "https://example.org", "--training-data"]
CARD += ["none", "--knowledge", "demonstrations", "mechanism"]


@pytest.fixture
def trials(tmp_path, monkeypatch, policies_here):
    """Results of a user's policy in a trial of two seeds, by code without edits."""
    module = f"still_{tmp_path.name.replace('-', '_')}"
    monkeypatch.chdir(tmp_path)
    Path(f"{module}.py").write_text(STILL.replace("helper", f"{module}_helper"))
    Path(f"{module}_helper.py").write_text("import numpy as np; pose = np.ones(6)\n")
    parts = protocol.PARTS.items()
    few = {part: dataclasses.replace(plan, seeds=2) for part, plan in parts}
    monkeypatch.setattr(protocol, "PARTS", few)
    state = {**code_state(), "git": {"commit": "0" * 40, "dirty": False}}
    monkeypatch.setattr(jobs, "code_state", lambda: state)
    policy = f"{module}:make"
    tasks = protocol.trial_tasks(protocol.named_trials(("stop",)), policies=[policy])
    tasks = [task for task in tasks if task.policy == policy]
    assert run_or_resume(tasks, {}, Path("trials"), Engine(engine="serial")) == 0
    return tasks


def changed(change, *, adapted, trust=("--trust",)):
    """Write the archive with other results, and with their hashes if adapted."""
    with zipfile.ZipFile("submission.zip") as archive:
        members = {name: archive.read(name) for name in archive.namelist()}
    about = json.loads(members["submission.json"])
    for name in [name for name in members if name.startswith("tasks/")]:
        result = json.loads(members[name])
        change(result)
        members[name] = json.dumps(result).encode()
        if adapted:
            about["files"][name] = hashlib.sha256(members[name]).hexdigest()
    with zipfile.ZipFile("changed.zip", "w") as archive:
        for name, content in {**members, "submission.json": json.dumps(about)}.items():
            archive.writestr(name, content)
    for name in [name for name in sys.modules if name.startswith("still_")]:
        del sys.modules[name]  # Its process would be another.
    return main(["verify", "changed.zip", *trust, "--engine", "serial", "--quiet"])


def test_what_was_submitted_is_verified_and_what_was_changed_is_found(trials, capsys):
    stored = Path("trials", "tasks", f"{trials[0].key}.json")
    result = json.loads(stored.read_text())
    stored.write_text(json.dumps({**result, "traceback": f"in {Path.cwd()}"}))
    assert main(["submit", "trials", *CARD]) == 0
    with zipfile.ZipFile("submission.zip") as archive:
        assert json.loads(archive.read(f"tasks/{stored.name}")) == result
    assert "pull_request" in capsys.readouterr().out.lower().replace(" ", "_")
    first = Path("submission.zip").read_bytes()
    assert main(["submit", "trials", *CARD]) == 0
    assert Path("submission.zip").read_bytes() == first
    for file in Path().glob("still_*.py"):
        file.unlink()
    assert main(["verify", "submission.zip", "--engine", "serial"]) == 2
    assert f"foreign policies: {trials[0].policy}. Read" in capsys.readouterr().err

    def more(amount, **fields):
        def change(result):
            result["metrics"]["duration"] += amount
            result.update(fields)

        return change

    for change, adapted, status, message in (
        (lambda result: None, True, 0, "equal in all that was run again"),
        (more(1e-9), False, 1, f"tasks/{trials[0].key}.json: changed, not of"),
        (more(1e-9), True, 1, ": duration is 1."),
        (more(1e-3, arithmetic={"machine": "another"}), True, 0, "equal in all"),
        (more(1.0, arithmetic={"machine": "another"}), True, 1, ": duration is 2."),
        (lambda r: r["task"].update(disturbance="push"), True, 1, "not the protocol's"),
    ):
        assert changed(change, adapted=adapted) == status
        assert message in capsys.readouterr().out
    # A source that is not stated is not trusted, either.
    assert (
        changed(lambda r: r["task"].pop("policy_source"), adapted=True, trust=()) == 2
    )


def test_the_leaderboard_has_archives_of_the_present_protocol(trials, monkeypatch):
    monkeypatch.syspath_prepend(ROOT / "benchmarks")
    leaderboard = importlib.import_module("leaderboard")
    assert main(["submit", "trials", *CARD, "--out", "theirs.zip"]) == 0
    answers = leaderboard.answers_of([Path("theirs.zip")])
    (policies,) = answers["stop"].values()
    (numbers,) = policies.values()
    assert [*policies] == [f"{trials[0].policy} (theirs)"]
    assert numbers["knows"] == "demonstrations, mechanism"
    assert numbers["success"]["seeds"] == {str(t.seed): 0.0 for t in trials}
    monkeypatch.setattr(submissions, "VERSION", "2.0")
    with pytest.raises(ValueError, match=r"theirs.zip: it is of protocol .*, not of 2"):
        leaderboard.submitted(Path("theirs.zip"))


def test_what_does_not_follow_the_protocol_is_not_submitted(trials, capsys):
    assert main(["submit", "trials", *CARD[:-3]]) == 2
    assert "must state knowledge, by options" in capsys.readouterr().err
    Path("trials", "tasks", f"{trials[0].key}.json").unlink()
    card = 'authors = ["A"]\ncode = "x"\ntraining_data = "none"\n'
    Path("card.toml").write_text(card)
    words = ["submit", "trials", "--card", "card.toml", "--knowledge", "data"]
    assert main(words) == 1
    assert "1 of 2 are missing" in capsys.readouterr().out
    assert not Path("submission.zip").exists()


@pytest.mark.parametrize(
    "names",
    [
        *("../tasks/a.json", "/tasks/a.json", "policies/../a.py", "tasks/a.pkl"),
        *("tasks/a.json", "study.json study.json", "policies/./a", "policies\\a", ""),
    ],
)
@pytest.mark.filterwarnings("ignore:Duplicate name")
def test_a_strange_archive_is_bad_input(names, tmp_path, capsys):
    with zipfile.ZipFile(tmp_path / "a.zip", "w") as archive:
        for name in names.split():
            archive.writestr(name, "{}")
    assert main(["verify", str(tmp_path / "a.zip")]) == 2
    assert "it is no submission" in capsys.readouterr().err
