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
from PIL import Image, ImageSequence

from gplfd_experiments.files.plain_data import read_json
from gplfd_experiments.studies.trials import protocol
from gplfd_experiments.studies.trials.protocol import TRACKS, TRIALS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script that is run
sys.path.append(str(ROOT / "docs"))  # a hook of MkDocs
SCRIPTS = ("leaderboard", "measured", "pictures", "robots", "speed")
leaderboard, measured, pictures, robots, speed = map(importlib.import_module, SCRIPTS)


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


def test_results_of_robots_are_rows(monkeypatch, tmp_path):
    monkeypatch.setattr(robots, "DOCS", tmp_path)
    monkeypatch.setattr(robots, "ROBOTS", ("ur5e-like",))
    monkeypatch.setattr(robots, "ARMS", {"None": "none.urdf"})
    monkeypatch.setattr(robots, "EXAMPLES", tmp_path)
    (tmp_path / "none.urdf").write_text("<robot name='none'><link name='a'/></robot>")
    robots.commands(steps=2)
    robots.arms()
    rows = read_json(tmp_path / "results/random-commands.json")["rows"]
    assert [row["grasp"] for row in rows] == ["contact", "weld"]
    (arm,) = read_json(tmp_path / "results/arms.json")["rows"]
    assert (arm["arm"], arm["opened"]) == ("None", False)
    assert "none.urdf" in arm["reason"]


def test_no_image_of_the_pages_is_older_than_what_it_shows():
    """Every image has the hash of the present episodes, results, texts and files."""
    pages = [ROOT / "README.md", *(ROOT / "docs").glob("*.md")]
    texts = "".join(page.read_text() for page in pages)
    stored = read_json(ROOT / "docs/images/made-from.json")
    assert stored == pictures.made_from()
    assert set(re.findall(r"\]\((?:docs/)?images/([^)]+)\)", texts)) == set(stored)


def test_the_page_of_tasks_shows_every_condition():
    page = (ROOT / "docs" / "tasks.md").read_text()
    for trial in TRIALS:
        film = ROOT / f"docs/images/films/{trial}.gif"
        assert film.stat().st_size < 300_000
        assert f"{{{{ scored / {trial} }}}}" in page


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
        for frame in ImageSequence.Iterator(film):
            r, g, b = np.moveaxis(np.asarray(frame.convert("RGB"), dtype=int), -1, 0)
            red.append(int(np.sum((r > 1.5 * g) & (r > 1.5 * b))))
            blue.append(int(np.sum((b > 1.5 * r) & (b > 1.2 * g))))
    assert red[0] < 5
    assert red[-1] > 50
    assert blue[0] > 50


def results(shares: dict[str, float]) -> Any:
    """Every condition with a share for each policy, which grows a little by seed."""
    trials = {}
    for name, trial in TRIALS.items():
        policies = {}
        for policy in {*shares, *protocol.taking_part(name)}:
            share = shares.get(policy, 0.5)
            # No two differences are equal: their test takes a hundred times as long.
            grows = 0.001 * (0.6 + 0.4 * share)
            seeds = {str(100 + n): share + grows * n for n in range(10)}
            numbers = {"estimate": share, "low": 0.0, "high": 1.0, "seeds": seeds}
            policies[policy] = {"episodes": 10, "lost": 0}
            policies[policy] |= dict.fromkeys(trial.measures, numbers)
        trials[name] = {level: dict(policies) for level in trial.levels}
    contrasts = [
        {"p": 0.5, "verdict": "open", "estimate": 0.1, "low": 0.0, "high": 1.0}
        | {"idea": of.idea, "trial": name, "measure": of.measure}
        | {"with": str(of.having), "without": str(of.lacking)}
        for name, trial in TRIALS.items()
        for of in trial.contrasts
    ]
    return {"protocol": protocol.VERSION, "trials": trials, "contrasts": contrasts}


@pytest.mark.parametrize(
    ("gain", "separated", "oracle", "mean", "measures"),
    [
        (0.2, 4, 0.9, 0.5, True),
        (0.1, 4, 0.9, 0.5, False),
        (0.2, 3, 0.9, 0.5, False),
        (0.2, 4, 0.8, 0.5, False),
        (0.2, 4, 0.9, 0.7, False),
    ],
)
def test_the_criteria_of_the_protocol_decide(gain, separated, oracle, mean, measures):
    learners = dict.fromkeys(TRACKS["learner"].policies, mean)
    learners |= dict.fromkeys(("gp", "gmr", "kmp", "dmp")[:separated], mean + gain)
    shares = learners | {"oracle": oracle}
    text = leaderboard.verdict(results(shares)["trials"])
    assert text.startswith("**These doors measure learners.**") is measures


def test_a_policy_of_others_has_its_place(tmp_path, capsys, monkeypatch):
    """Between those that open more and less; with lost episodes it has none."""
    monkeypatch.setattr(leaderboard, "STORED", tmp_path / "none.json")
    monkeypatch.setattr(leaderboard, "SUBMISSIONS", tmp_path / "none")
    content, theirs = results({"oracle": 0.9, "mine:make": 0.8}), tmp_path / "a.json"

    def printed() -> str:
        theirs.write_text(json.dumps(content))
        tyro.cli(leaderboard.main, args=[str(theirs)])
        return capsys.readouterr().out

    first, second = printed().split("## Track ")[1].splitlines()[4:6]
    assert first.startswith("| `oracle` | the door | 90 %<br>90 to 91 |")
    assert second.startswith("| `mine:make` | demonstrations | 80 %<br>80 to 81 |")
    content["trials"]["motions"]["flap"]["mine:make"]["lost"] = 1
    assert "mine:make" not in printed().split("## Track ")[1]
    content["protocol"] = 8
    with pytest.raises(ValueError, match=r"of protocol 8, .* leaderboard of 1\.1"):
        printed()


def test_every_number_of_the_pages_has_a_result(tmp_path, monkeypatch):
    """A number without a result is an error that names page and number."""
    for file in (ROOT / "docs" / "results").glob("*.json"):
        (tmp_path / file.name).write_bytes(file.read_bytes())
    made = tmp_path / leaderboard.STORED.name
    monkeypatch.setattr(measured, "RESULTS", tmp_path)
    monkeypatch.setattr(leaderboard, "STORED", made)
    monkeypatch.setattr(leaderboard, "SUBMISSIONS", tmp_path)  # which take long to read
    pages = {page.name: page.read_text() for page in (ROOT / "docs").glob("*.md")}
    for complete in (False, True):
        for name, text in pages.items():
            written = measured.written(text, name)
            assert not measured.MACRO.search(written), name
            assert "<!-- results:" not in written, name
            assert not complete or leaderboard.NOT_RUN not in written, name
        made.write_text(json.dumps(results({})))
        numbers = {"gp": {"success": 0.9, "force_radial_20ms": 1.0}}
        made_too = {"numbers": {"a": numbers, "b": {}}, "kendall": {"b": {}}}
        (tmp_path / "robustness.json").write_text(json.dumps(made_too))
    with pytest.raises(KeyError, match=r"a\.md: \{\{ trials / radius / gpp / success"):
        measured.written("{{ trials / radius / gpp / success }}", "a.md")
    assert measured.number("trials / learner / gp / success") == "50 % (50 to 51)"


def test_the_readme_has_the_present_results():
    answers = leaderboard.answers_of(filter(Path.exists, [leaderboard.STORED]))
    readme = (ROOT / "README.md").read_text()
    assert leaderboard.with_results(readme, answers) == readme
    assert len(readme.splitlines()) <= 90


@pytest.mark.parametrize(
    "page", ["README.md", "docs/index.md", "docs/leaderboard.md", "docs/results.md"]
)
def test_no_measurement_is_typed(page):
    """Numbers are macros or stand beside the file or commit that has them."""
    text = (ROOT / page).read_text()
    text = re.sub(r"(?s)```.*?```|<!-- results: \w+ -->.*?<!-- end -->", "", text)
    text = measured.MACRO.sub("", text)
    typed = r"(?<!at least )(?<!at most )\b\d[\d.]* ?(?:N|mm|%)(?![\w/]| interval)"
    found = [
        paragraph
        for paragraph in re.split(r"\n\n|\n(?=\* )", text)
        if re.search(rf"{typed}|\d of \d+ (?:doors|episodes)", paragraph)
        and not re.search(r"results/[\w.-]+\.json|commit [0-9a-f]{7}", paragraph)
    ]
    assert found == []
