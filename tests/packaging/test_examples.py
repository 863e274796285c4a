"""Every example runs and says something."""

import runpy
import sys
import warnings
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ALL = sorted((Path(__file__).parents[2] / "examples").glob("*.py"))
ELSEWHERE = {"cloned_policy", "learned_policy"}
"""Run by .ci/run, with the commands of docs/learners.md; tested in tests/learners, with
what it needs."""
EXAMPLES = {path.stem: path for path in ALL if path.stem not in ELSEWHERE}

SAYS = {
    "random_agent": "failure:",
    "your_own_policy": "gplfd view results/imitate/medium.rrd",
    "vectorised_evaluation": "5/5 opened",
    "rl_smoke": "16/16 opened",
    "plot_episode": "opened: True",
    "play_trajectory": "opened: True",
}
"""A part of what each of them prints."""

WRITES = {
    "play_trajectory": {"movement.csv"},
    "plot_episode": {"episode.png"},
    "your_own_policy": {"results"},
}
"""What they leave in the working folder."""


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", [str(EXAMPLES[name]), *arguments])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", "sensor noise")
            runpy.run_path(str(EXAMPLES[name]), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_every_example_is_known():
    assert set(SAYS) | ELSEWHERE == {path.stem for path in ALL}


@pytest.mark.parametrize("name", EXAMPLES)
def test_example_runs(name, tmp_path, printed):
    assert SAYS[name] in printed(name)
    written = list(tmp_path.iterdir())
    assert {each.name for each in written} == WRITES.get(name, set())
    assert all(each.stat().st_size > 10_000 for each in written if each.is_file())


def test_a_table_of_one_s_own_is_played_and_left_as_it_is(tmp_path, printed):
    names = "x [m],y [m],z [m],qx,qy,qz,qw"
    text = "\n".join(["# mine", names, *5 * ["0,0,0,0,0,0,1"]])
    table = tmp_path / "opening.csv"
    table.write_text(text)
    said = printed("play_trajectory", "opening.csv")
    assert said == "5 rows of opening.csv played: door at 0 deg, opened: False\n"
    assert table.read_text() == text
    assert list(tmp_path.iterdir()) == [table]
