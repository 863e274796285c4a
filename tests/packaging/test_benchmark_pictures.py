"""What scripts of benchmarks/ put into the documents: pictures, films, a table."""

import dataclasses
import importlib
import json
import sys
from pathlib import Path

import numpy as np
import pytest
import tyro
from PIL import Image

from gplfd_experiments.studies.trials.protocol import TRIALS, VERSION

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script that is run
leaderboard, pictures = map(importlib.import_module, ("leaderboard", "pictures"))


def test_pictures_stand_side_by_side_pixel_by_pixel():
    colours = {"a": 10, "b": 90, "c": 170}
    given = {
        name: np.full((40, 40, 3), value, np.uint8) for name, value in colours.items()
    }
    canvas = pictures.side_by_side(given, 2).canvas
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., 0]
    assert drawn.shape == (2 * (40 + 26), 80)
    for value, row, column in ((10, 0, 0), (90, 0, 40), (170, 66, 0)):
        inside = drawn[row + 1 : row + 39, column + 1 : column + 39]
        assert np.all(inside == value)


def test_a_moving_picture_lasts_at_its_end(tmp_path):
    frames = [Image.new("RGB", (8, 8), (40 * one, 0, 0)) for one in range(6)]
    pictures.write_gif(tmp_path / "film.gif", frames, 0.1, 8)
    lasting = []
    with Image.open(tmp_path / "film.gif") as film:
        for number in range(film.n_frames):
            film.seek(number)
            lasting.append(film.info["duration"])
            (red, *_) = film.convert("RGB").getpixel((4, 4))
            assert red == pytest.approx(40 * number, abs=8)
    assert lasting == [100, 100, 100, 100, 100, 1000]


def test_the_moving_picture_has_shades_enough_for_its_surfaces():
    """Few colours make blotches of a leaf on which the light changes."""
    file = ROOT / "docs" / "images" / "opening.gif"
    assert file.stat().st_size < 500_000
    with Image.open(file) as film:
        assert film.width * 3 == film.height * 4
        film.seek(film.n_frames - 1)
        picture = np.asarray(film.convert("RGB")).reshape(-1, 3)
    assert len(np.unique(picture, axis=0)) > 150


@pytest.mark.needs("opengl")
def test_a_scene_is_pictured_at_its_angle():
    scene = pictures.Scene("cabinet", "cabinet", "fixed", 10.0)
    picture = pictures.pictured(scene, 80)
    assert picture.shape == (60, 80, 3)
    assert picture.std() > 10


@pytest.mark.parametrize("trial", TRIALS)
def test_the_gallery_shows_every_trial(trial):
    task = pictures.task_of(trial)
    assert (task.policy, task.trial) == ("gp", trial)
    film = ROOT / "docs" / "images" / "films" / f"{trial}.gif"
    assert film.stat().st_size < 300_000
    with Image.open(film) as moving:
        assert 10 < moving.n_frames <= 50
    page = (ROOT / "docs" / "gallery.md").read_text()
    assert f"### {trial}\n\n{TRIALS[trial].question} " in page
    assert f"(images/films/{trial}.gif)" in page


@pytest.mark.needs("opengl")
def test_a_film_shows_the_hand_s_way(tmp_path, monkeypatch):
    """Red grows from nothing, where the demonstrations' blue is from the start."""
    task = dataclasses.replace(pictures.task_of("radius"), policy="oracle")
    monkeypatch.setattr(pictures, "task_of", lambda name: task)
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


# --- Leaderboard -------------------------------------------------------------


def printed(capsys: pytest.CaptureFixture[str], *files: Path) -> str:
    tyro.cli(leaderboard.main, args=[str(file) for file in files])
    return capsys.readouterr().out.strip()


def test_the_page_has_what_the_script_prints(capsys):
    page = (ROOT / "docs" / "leaderboard.md").read_text()
    assert f"\n\n{printed(capsys)}\n\n" in page


def test_a_policy_of_others_has_its_place(tmp_path, capsys):
    """Between those that open more and less; without a trial it has none."""
    stored = json.loads(leaderboard.STORED.read_text())["trials"]
    for policies in (level for trial in stored.values() for level in trial.values()):
        if "oracle" in policies:  # not where there is a prior mean
            policies["mine:make"] = policies["oracle"]
    theirs = tmp_path / "trials.json"
    theirs.write_text(json.dumps({"protocol": VERSION, "trials": stored}))
    rows = printed(capsys, theirs).splitlines()
    places = {row.split(" | ")[0]: number for number, row in enumerate(rows)}
    assert places["| `mine:make`"] == places["| `oracle` (learns nothing)"] - 1
    assert rows[places["| `mine:make`"]].split(" | ")[1] == "0.79"
    # What the oracle is best in is now somebody's who learns.
    assert rows[places["| `mine:make`"]].split(" | ")[2] == "1.00<br>**1.5 N**"
    del stored["stop"]["stop"]["mine:make"]
    theirs.write_text(json.dumps({"protocol": VERSION, "trials": stored}))
    assert "mine:make" not in printed(capsys, theirs)


def test_a_policy_with_lost_episodes_has_no_place(tmp_path, capsys):
    stored = json.loads(leaderboard.STORED.read_text())["trials"]
    for policies in (level for trial in stored.values() for level in trial.values()):
        if "oracle" in policies:
            policies["mine:make"] = {**policies["oracle"], "errors": 1, "lost": 0}
    theirs = tmp_path / "trials.json"
    theirs.write_text(json.dumps({"protocol": VERSION, "trials": stored}))
    assert "mine:make" in printed(capsys, theirs)
    stored["stop"]["stop"]["mine:make"]["lost"] = 1
    theirs.write_text(json.dumps({"protocol": VERSION, "trials": stored}))
    assert "mine:make" not in printed(capsys, theirs)
    # Earlier versions left errors out of rates, and did not say what was lost.
    del stored["stop"]["stop"]["mine:make"]["lost"]
    theirs.write_text(json.dumps({"protocol": VERSION, "trials": stored}))
    with pytest.raises(ValueError, match="leaves out episodes in which mine:make rai"):
        leaderboard.answers_of([leaderboard.STORED, theirs])


def test_another_protocol_has_another_leaderboard(tmp_path):
    old = ROOT / "docs" / "results" / "trials-v1.json"
    with pytest.raises(ValueError, match=f"of protocol 1, .* leaderboard of {VERSION}"):
        leaderboard.answers_of([leaderboard.STORED, old])
