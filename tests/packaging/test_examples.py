"""Every example runs and says something."""

import runpy
import sys
import warnings
from pathlib import Path

import pytest

pytestmark = pytest.mark.slow

ALL = {
    path.stem: path for path in (Path(__file__).parents[2] / "examples").glob("*.py")
}
ELSEWHERE = {"cloned_policy", "diffusion_policy", "learned_policy"}
"""Run by .ci/run, with the commands of docs/learners.md; tested in tests/learners, with
what it needs."""

EXPECTED = {
    "random_agent": ("failure:", set()),
    "your_own_policy": ("gplfd view results/imitate/medium.rrd", {"results"}),
    "vectorised_evaluation": ("5/5 opened", set()),
    "rl_smoke": ("16/16 opened", set()),
    "plot_episode": ("opened: True", {"episode.png"}),
    "bag_with_forces": ("6 bags in bags", {"bags"}),
    "robot_client": ("equal to one process: True", set()),
    "play_trajectory": ("opened: True", {"movement.csv"}),
}
"""A part of what each of them prints, and what it leaves in the working folder."""


@pytest.fixture
def printed(tmp_path, monkeypatch, capsys):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("MPLBACKEND", "agg")

    def run(name, *arguments):
        monkeypatch.setattr(sys, "argv", [str(ALL[name]), *arguments])
        with warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.filterwarnings("ignore", "sensor noise")
            runpy.run_path(str(ALL[name]), run_name="__main__")
        return capsys.readouterr().out

    return run


def test_every_example_is_known():
    assert set(EXPECTED) | ELSEWHERE == set(ALL)


@pytest.mark.parametrize("name", EXPECTED)
def test_example_runs(name, tmp_path, printed):
    said, left = EXPECTED[name]
    assert said in printed(name)
    written = list(tmp_path.iterdir())
    assert {each.name for each in written} == left
    assert all(each.stat().st_size > 10_000 for each in written if each.is_file())


def test_a_table_of_one_s_own_is_played_and_left_as_it_is(tmp_path, printed):
    names = "x [m],y [m],z [m],qx,qy,qz,qw"
    table = tmp_path / "opening.csv"
    table.write_text(text := "\n".join(["# mine", names, *5 * ["0,0,0,0,0,0,1"]]))
    said = printed("play_trajectory", "opening.csv")
    assert said == "5 rows of opening.csv played: door at 0 deg, opened: False\n"
    assert table.read_text() == text
    assert list(tmp_path.iterdir()) == [table]
