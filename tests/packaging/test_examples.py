"""Every example runs and says something."""

import subprocess
import sys
from pathlib import Path

import pytest

EXAMPLES = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))


SAYS = {
    "random_agent": "failure:",
    "your_own_policy": "gplfd view results/replay/medium.rrd",
    "vectorised_evaluation": "5/5 opened",
    "rl_smoke": "16/16 opened",
    "plot_episode": "opened: True",
    "play_trajectory": "opened: True",
}
"""A part of what each of them prints."""

WRITES = {
    "play_trajectory": {"opening.csv"},
    "plot_episode": {"episode.png"},
    "your_own_policy": {"results"},
}
"""What they leave in the working folder."""


def test_every_example_is_known():
    assert set(SAYS) == {path.stem for path in EXAMPLES}


@pytest.mark.parametrize("path", EXAMPLES, ids=lambda path: path.stem)
def test_example_runs(path, tmp_path):
    ran = subprocess.run(
        [sys.executable, "-W", "error", "-W", "ignore:sensor noise", path],
        check=False,
        cwd=tmp_path,
        capture_output=True,
        text=True,
        timeout=120,
    )
    assert ran.returncode == 0, ran.stderr
    assert SAYS[path.stem] in ran.stdout
    written = list(tmp_path.iterdir())
    assert {each.name for each in written} == WRITES.get(path.stem, set())
    assert all(each.stat().st_size > 10_000 for each in written if each.is_file())
