"""The scripts of benchmarks/: speed, pictures and films, and the leaderboard."""

import dataclasses
import functools
import importlib
import json
import re
import sys
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import gymnasium as gym
import numpy as np
import pytest
import tyro
from PIL import Image

from gplfd_experiments.studies.trials.protocol import TRACKS, TRIALS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script that is run
leaderboard, pictures, robots, speed = map(
    importlib.import_module, ("leaderboard", "pictures", "robots", "speed")
)


@pytest.fixture(autouse=True)
def _no_collections(monkeypatch):
    """Leave garbage alone, which here is that of all tests."""
    monkeypatch.setattr(speed, "gc", SimpleNamespace(collect=lambda: None))


def test_times_are_per_operation_and_without_preparation(monkeypatch):
    clock = {"now": 0.0}
    for name in ("process_time", "perf_counter"):
        monkeypatch.setattr(speed.time, name, lambda: clock["now"])

    def work(seconds):
        clock["now"] += seconds

    def prepare():
        work(100.0)
        return lambda: work(6.0)

    actions = {"a": (prepare, 3), "b": speed.repeated(lambda: work(4.0), 5)}
    times = speed.measure(actions, 2)
    np.testing.assert_allclose(times["a"], np.full((2, 2), 2.0))
    np.testing.assert_allclose(times["b"], np.full((2, 2), 4.0))


def test_environment_agents_and_vectors_are_measured(monkeypatch):
    make = functools.partial(speed.gym.make, max_episode_steps=60)
    monkeypatch.setattr(speed, "gym", SimpleNamespace(make=make, make_vec=gym.make_vec))
    rows = [*speed.vectors(1, counts=(2,)), *speed.agents(1, count=2, periods=4)]
    values = {what: float(measured.split()[0]) for what, measured in rows}
    assert min(values.values()) > 0.0
    assert "2 simulations on 2 threads, CPU over mj_step" in values
    assert "2 `gp` agents in lockstep" in values


def test_tables_of_robots_are_written_into_their_pages(monkeypatch, tmp_path):
    monkeypatch.setattr(robots, "DOCS", tmp_path)
    monkeypatch.setattr(robots, "ROBOTS", ("ur5e-like",))
    monkeypatch.setattr(robots, "ARMS", {"None": "none.urdf"})
    (tmp_path / "none.urdf").write_text("<robot name='none'><link name='a'/></robot>")
    page = tmp_path / "environment.md"
    page.write_text("a\n<!-- random-commands -->\n\n<!-- random-commands -->\nb\n")
    (tmp_path / "results").mkdir()
    robots.commands(steps=2)
    robots.arms(tmp_path)
    rows = json.loads((tmp_path / "results/random-commands.json").read_text())["rows"]
    assert [row["grasp"] for row in rows] == ["contact", "weld"]
    assert "\n| `ur5e-like`, weld | " in page.read_text()
    (arm,) = json.loads((tmp_path / "results/arms.json").read_text())["rows"]
    assert (arm["arm"], arm["opened"]) == ("None", False)
    assert "none.urdf" in arm["reason"]
    page.write_text("a\n")
    with pytest.raises(ValueError, match=r"environment\.md has no table between"):
        robots.commands(steps=2)


@pytest.mark.parametrize("trial", TRIALS)
def test_the_gallery_shows_every_trial(trial):
    task = pictures.task_of(trial)
    assert (task.policy, task.trial) == ("gp", trial)
    film = ROOT / "docs" / "images" / "films" / f"{trial}.gif"
    assert film.stat().st_size < 300_000
    page = (ROOT / "docs" / "gallery.md").read_text()
    assert f"### {trial}\n\n{TRIALS[trial].question} " in page
    assert f"(images/films/{trial}.gif)" in page


@pytest.mark.needs("opengl")
def test_a_scene_is_pictured_and_a_film_shows_the_hand_s_way(tmp_path, monkeypatch):
    """Red grows from nothing, where the demonstrations' blue is from the start."""
    scene = {"title": "", "door": "cabinet", "base": "fixed", "angle": 10.0}
    image = pictures.pictured(scene, 80)
    assert image.size == (80, 60)
    assert np.std(image) > 10
    task = dataclasses.replace(pictures.task_of("radius"), policy="oracle")
    monkeypatch.setattr(pictures, "task_of", lambda name: task)
    monkeypatch.setattr(pictures, "_EVERY", 8 * pictures._EVERY)
    pictures.film_trial(tmp_path / "radius.gif", "radius", (160, 120))
    red, blue = [], []
    with Image.open(tmp_path / "radius.gif") as film:
        for number in range(film.n_frames):
            film.seek(number)
            r, g, b = np.moveaxis(np.asarray(film.convert("RGB"), dtype=int), -1, 0)
            red.append(int(np.sum((r > 1.5 * g) & (r > 1.5 * b))))
            blue.append(int(np.sum((b > 1.5 * r) & (b > 1.2 * g))))
    assert red[0] < 5
    assert red[-1] > 50
    assert blue[0] > 50


def printed(capsys: pytest.CaptureFixture[str], *files: Path) -> str:
    tyro.cli(leaderboard.main, args=[str(file) for file in files])
    return capsys.readouterr().out.strip()


def test_the_page_has_what_the_script_prints(capsys, monkeypatch):
    """Of the comparisons with the mean, whose tests take seconds, that of one table."""
    page = (ROOT / "docs" / "leaderboard.md").read_text()
    answers = leaderboard.answers_of([leaderboard.STORED])
    overview = leaderboard.markdown_table(leaderboard.overview(answers))
    assert f"\n\n{overview}\n\n" in (ROOT / "README.md").read_text()
    assert f"\n\n{leaderboard.separated(answers, TRACKS['other motions'])}\n\n" in page
    monkeypatch.setattr(leaderboard, "separated", lambda *_: "SEPARATED")
    page = re.sub(r"^Compared with the mean .*", "SEPARATED", page, flags=re.MULTILINE)
    assert f"\n\n{printed(capsys)}\n\n" in page


@pytest.mark.parametrize(
    ("gain", "separated", "oracle", "measures"),
    [
        (0.2, 4, 0.9, True),
        (0.1, 4, 0.9, False),
        (0.2, 3, 0.9, False),
        (0.2, 4, 0.8, False),
    ],
)
def test_the_criteria_of_the_protocol_decide(gain, separated, oracle, measures):
    shares = {"oracle": oracle, "mean": 0.5}
    shares |= {name: 0.5 + gain for name in ("gp", "gmr", "kmp", "dmp")[:separated]}
    each: Any = {}
    for policy, share in shares.items():
        seeds = {str(seed): share + 0.001 * seed for seed in range(10)}
        measure = {"estimate": share, "seeds": seeds}
        measures_of = dict.fromkeys(("success", "force_handle_peak"), measure)
        each[policy] = {"lost": 0, **measures_of}
    answers = {"motions": dict.fromkeys(TRIALS["motions"].levels, each)}
    text = leaderboard.separated(answers, ["motions"])
    assert text.endswith("doors measure learners.") is measures


def test_a_policy_of_others_has_its_place(tmp_path, capsys, monkeypatch):
    """Between those that open more and less; with lost episodes it has none."""
    # Its permutations take seconds, and the test above compares what it says.
    monkeypatch.setattr(leaderboard, "separated", lambda *_: "")
    stored = json.loads(leaderboard.STORED.read_text())["trials"]
    for name in TRACKS["furniture"]:
        for policies in stored[name].values():
            if "oracle" in policies:  # not where there is a prior mean
                policies["mine:make"] = {**policies["oracle"], "lost": 0}
    theirs = tmp_path / "trials.json"

    def write(protocol=leaderboard.PROTOCOL) -> Path:
        theirs.write_text(json.dumps({"protocol": protocol, "trials": stored}))
        return theirs

    (track,) = re.findall(
        r"## Track furniture\n(.*?)\n## ", printed(capsys, write()), re.S
    )
    rows = track.splitlines()
    places = {row.split(" | ")[0]: number for number, row in enumerate(rows)}
    assert places["| `mine:make`"] == places["| `oracle` (learns nothing)"] - 1
    stored["heavy"]["14 N"]["mine:make"]["lost"] = 1
    assert "mine:make" not in printed(capsys, write())
    with pytest.raises(ValueError, match=r"of protocol 8, .* leaderboard of 10"):
        leaderboard.answers_of([write(protocol=8)])
