import json
import os
import subprocess
import sys
from pathlib import Path

import mujoco
import pytest

from gplfd_experiments.files.provenance import arithmetic, git_state, provenance


def git(folder: Path, *arguments: str) -> None:
    identity = ["-c", "user.name=t", "-c", "user.email=t@example.org"]
    subprocess.run(["git", "-C", str(folder), *identity, *arguments], check=True)


def test_provenance_is_json_and_names_what_ran():
    record = provenance({"seed": 3})
    assert json.loads(json.dumps(record)) == record
    assert record["config"] == {"seed": 3}
    assert record["versions"]["mujoco"] == mujoco.__version__
    assert record["command"]


def test_arithmetic_follows_what_the_libraries_choose():
    """In another process, since libraries choose when they are loaded."""
    program = (
        "import json, sys; from gplfd_experiments.files.provenance import arithmetic; "
    )
    finished = subprocess.run(
        [sys.executable, "-c", program + "json.dump(dict(arithmetic()), sys.stdout)"],
        env={
            **os.environ,
            "OPENBLAS_CORETYPE": "Prescott",
            "NPY_DISABLE_CPU_FEATURES": "X86_V4 X86_V3",
        },
        capture_output=True,
        check=True,
    )
    there, here = json.loads(finished.stdout), arithmetic()
    changed = {name for name in here if there[name] != here[name]}
    # Fewer where the processor has no other, or the libraries are others.
    assert changed <= {"linear algebra", "vector functions"}
    assert changed or "SkylakeX" not in here["linear algebra"]


@pytest.mark.needs("git")
def test_git_state_follows_commits_and_edits(tmp_path):
    assert git_state(tmp_path) is None
    git(tmp_path, "init", "--quiet")
    assert git_state(tmp_path) == {"commit": None, "dirty": False}
    (tmp_path / "file").write_text("a")
    git(tmp_path, "add", "file")
    git(tmp_path, "commit", "--quiet", "-m", "first")
    state = git_state(tmp_path)
    assert state is not None
    assert len(state["commit"]) == 40
    assert state["dirty"] is False
    (tmp_path / "file").write_text("b")
    assert git_state(tmp_path) == {"commit": state["commit"], "dirty": True}
