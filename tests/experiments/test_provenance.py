import json
import subprocess
from pathlib import Path

import mujoco
import pytest

from gplfd_experiments.files.provenance import git_state, provenance


def git(folder: Path, *arguments: str) -> None:
    identity = ["-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run(["git", "-C", str(folder), *identity, *arguments], check=True)


def test_provenance_is_json_and_names_what_ran():
    record = provenance({"seed": 3})
    assert json.loads(json.dumps(record)) == record
    assert record["config"] == {"seed": 3}
    assert record["versions"]["mujoco"] == mujoco.__version__
    assert record["command"]


@pytest.mark.needs("git")
def test_git_state_follows_commits_and_edits(tmp_path):
    assert git_state(tmp_path) is None
    git(tmp_path, "init", "--quiet")
    (tmp_path / "file").write_text("a")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "--quiet", "-m", "first")
    state = git_state(tmp_path)
    assert state is not None
    assert len(state["commit"]) == 40
    assert state["dirty"] is False
    (tmp_path / "file").write_text("b")
    assert git_state(tmp_path) == {"commit": state["commit"], "dirty": True}
