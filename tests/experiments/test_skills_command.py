"""`gplfd learn` and `gplfd run --skill`."""

import json
import shlex
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from gplfd_experiments.cli import main as cli
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII, Teacher
from gplfd_experiments.workflows.skills import demonstrated_doors
from gplfd_policies.demonstrations.npz import save_demonstrations
from gplfd_policies.movements.skill import load_skill

pytestmark = pytest.mark.slow


@pytest.fixture(autouse=True)
def demonstrations(tmp_path, monkeypatch):
    """Write demonstrations to the working folder."""
    monkeypatch.chdir(tmp_path)
    shown = Teacher().demonstrate_doors(
        DEMONSTRATED_RADII, 2, rng=np.random.default_rng(0)
    )
    save_demonstrations("demos.npz", shown)


def metrics(folder: str) -> dict[str, Any]:
    (one,) = json.loads(Path(folder, "metrics.json").read_text())
    return {name: value for name, value in one.items() if "latency" not in name}


@pytest.mark.filterwarnings("ignore:sensor noise")
@pytest.mark.usefixtures("short_episodes")
def test_the_command_after_learn_opens_the_doors_of_a_run_with_its_policy(capsys):
    """A bar's skill at the default doors would be no use to who has opened an oven."""
    own = {"preset": "oven", "closer": {"preload": 0.4}}
    Path("doors").mkdir()
    Path("doors/mine.json").write_text(json.dumps(own))
    doors = ["0.50", "oven", "doors/mine.json"]
    run = ["run", "--doors", *doors, "--out", "kinds", "--policy", "oracle"]
    policy = ["--policy", "gp@no-continuation"]
    learn = ["learn", "kinds/demonstrations-oven.npz", *policy]
    assert cli.main([*run, "--quiet"]) == 0
    capsys.readouterr()
    assert cli.main([*learn, "--out", "my skill.npz", "--quiet"]) == 0
    again = ["run", "--skill", "my skill.npz", "--doors", "oven", "doors/mine.json"]
    printed = capsys.readouterr().out.rsplit(":  ")[-1]
    assert shlex.split(printed) == ["gplfd", *again, *policy]
    assert cli.main([*again, *policy, "--out", "again", "--quiet"]) == 0
    assert cli.main([*again, "--out", "other"]) == 2  # The policy of another.
    assert demonstrated_doors(Path("kinds/demonstrations-0.5.npz")) == ("0.50",)
    assert demonstrated_doors(Path("demos.npz")) == ()


@pytest.mark.usefixtures("short_episodes")
def test_a_kept_skill_opens_doors_as_one_that_was_just_learned(capsys):
    assert cli.main(["learn", "demos.npz", "--out", "new/skill.npz", "--quiet"]) == 0
    assert "gplfd run --skill new/skill.npz" in capsys.readouterr().out
    assert load_skill("new/skill.npz").count == 6
    kept = ["run", "--skill", "new/skill.npz", "--doors", "0.42", "--quiet"]
    new = ["run", "--demonstrations", "demos.npz", "--doors", "0.42", "--quiet"]
    assert cli.main([*kept, "--out", "a"]) == 0
    assert cli.main([*new, "--out", "b"]) == 0
    assert metrics("a") == metrics("b")
    first, second = (
        json.loads(Path(folder, "run.json").read_text())["config"] for folder in "ab"
    )
    assert len(first["skill_sha256"]) == 64
    assert second["skill_sha256"] is None
    # Another policy follows the same skill in its own way.
    assert cli.main([*kept, "--policy", "gp@constant-500", "--out", "c"]) == 0
    assert metrics("c")["force_radial_peak"] != metrics("a")["force_radial_peak"]
