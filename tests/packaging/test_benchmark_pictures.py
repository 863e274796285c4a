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

from gplfd_experiments.studies.trials.protocol import TRIALS

pytestmark = pytest.mark.slow

ROOT = Path(__file__).parents[2]
sys.path.insert(0, str(ROOT / "benchmarks"))  # as for a script that is run
leaderboard, pictures = map(importlib.import_module, ("leaderboard", "pictures"))
COLOURS = (10, 90, 170)


def test_pictures_stand_side_by_side_pixel_by_pixel():
    given = {str(value): np.full((40, 40, 3), value, np.uint8) for value in COLOURS}
    canvas = pictures.side_by_side(given, 2).canvas
    canvas.draw()
    drawn = np.asarray(canvas.buffer_rgba())[..., 0]
    assert drawn.shape == (2 * (40 + 26), 80)
    for value, (row, column) in zip(COLOURS, ((0, 0), (0, 40), (66, 0)), strict=True):
        inside = drawn[row + 1 : row + 39, column + 1 : column + 39]
        assert np.all(inside == value)


def test_a_moving_picture_lasts_at_its_end_and_has_shades_enough(tmp_path):
    """Few colours make blotches of a leaf on which the light changes."""
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
    for name in ("opening.gif", "folding.gif"):
        file = ROOT / "docs" / "images" / name
        assert file.stat().st_size < 600_000
        with Image.open(file) as film:
            assert film.width * 3 == film.height * 4
            film.seek(film.n_frames - 1)
            picture = np.asarray(film.convert("RGB")).reshape(-1, 3)
        assert len(np.unique(picture, axis=0)) > 150


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
def test_a_scene_is_pictured_and_a_film_shows_the_hand_s_way(tmp_path, monkeypatch):
    """Red grows from nothing, where the demonstrations' blue is from the start."""
    picture = pictures.pictured(pictures.Scene("", "cabinet", "fixed", 10.0), 80)
    assert picture.shape == (60, 80, 3)
    assert picture.std() > 10
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


def test_a_policy_of_others_has_its_place(tmp_path, capsys, monkeypatch):
    """Between those that open more and less; with lost episodes it has none."""
    # Its permutations take seconds, and the test above compares what it says.
    monkeypatch.setattr(leaderboard, "separated", lambda *_: "")
    stored = json.loads(leaderboard.STORED.read_text())["trials"]
    for name in leaderboard.GROUPS["All trials of hinged furniture"]:
        for policies in stored[name].values():
            if "oracle" in policies:  # not where there is a prior mean
                policies["mine:make"] = {**policies["oracle"], "errors": 1, "lost": 0}
    theirs, own = tmp_path / "trials.json", stored["heavy"]["14 N"]["mine:make"]

    def write() -> Path:
        theirs.write_text(
            json.dumps({"protocol": leaderboard.PROTOCOL, "trials": stored})
        )
        return theirs

    rows = printed(capsys, write()).splitlines()
    places = {row.split(" | ")[0]: number for number, row in enumerate(rows)}
    assert places["| `mine:make`"] == places["| `oracle` (learns nothing)"] - 1
    assert rows[places["| `mine:make`"]].split(" | ")[1] == "0.79"
    # What the oracle is best in is now somebody's who learns.
    column = rows[places["| policy"]].split(" | ").index("push")
    assert rows[places["| `mine:make`"]].split(" | ")[column] == "1.00<br>**3.6 mm**"
    own["lost"] = 1
    assert "mine:make" not in printed(capsys, write())
    # Earlier versions left errors out of rates, and did not say what was lost.
    del own["lost"]
    with pytest.raises(ValueError, match="leaves out episodes in which mine:make rai"):
        leaderboard.answers_of([leaderboard.STORED, write()])
    # Without a trial there is no place either, and another protocol has another board.
    del stored["heavy"]["14 N"]["mine:make"]
    assert "mine:make" not in printed(capsys, write())
    old = ROOT / "docs" / "results" / "trials-v1.json"
    with pytest.raises(
        ValueError, match=f"of protocol 1, .* leaderboard of {leaderboard.PROTOCOL}"
    ):
        leaderboard.main((old,))
