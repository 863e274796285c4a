"""`gplfd gallery`: its data, its films, and its page in a real browser."""

import dataclasses
import json
import shutil
import subprocess
from pathlib import Path

import imageio_ffmpeg
import numpy as np
import pytest

from gplfd_experiments.episodes.build import make_environment
from gplfd_experiments.episodes.metrics import episode_metrics
from gplfd_experiments.workflows import gallery

pytestmark = [pytest.mark.slow, pytest.mark.needs("opengl")]

NUMBERS = gallery.NUMBERS
STEPS = {"oracle": 300, "hinge-fit": 150}
COMMAND = ("gallery", "--doors", "0.42", "--policies", *STEPS, "--out")


@pytest.fixture(scope="module")
def made(tmp_path_factory):
    """A gallery of two short episodes with small films, and their logs."""
    folder, logs = tmp_path_factory.mktemp("gallery"), {}

    def short(task, control):
        return make_environment(task, control, max_episode_steps=STEPS[task.policy])

    def logged(env, agent, *, policy, **known):
        logs[policy] = rollout(env, agent, policy=policy, **known)
        return logs[policy]

    with pytest.MonkeyPatch.context() as patch:
        rollout = gallery.rollout
        small = dataclasses.replace(gallery.FORMAT, size=(64, 48))
        patch.setattr(gallery, "FORMAT", small)
        patch.setattr(gallery, "make_environment", short)
        patch.setattr(gallery, "rollout", logged)
        gallery.write_gallery(["0.42"], [*STEPS], folder, seed=3, options={"seed": 3})
    return folder, logs


def data(folder: Path):
    return json.loads(
        (folder / "episodes.js").read_text()[len("const GALLERY = ") : -2]
    )


def test_the_documentation_has_the_page_of_today():
    shown = Path(__file__).parents[2] / "docs/episodes/index.html"
    template = Path(gallery.__file__).with_name("gallery.html")
    assert shown.read_text() == template.read_text()


def test_the_page_has_the_numbers_and_films_of_the_episodes(made):
    folder, logs = made
    found = data(folder)
    assert found["made"][0]["config"] == {"seed": 3}
    assert [one["policy"] for one in found["episodes"]] == [*STEPS]  # As asked.
    names = {"index.html", "episodes.js", *(one["film"] for one in found["episodes"])}
    assert {one.name for one in folder.iterdir()} == names
    for one in found["episodes"]:
        log = logs[one["policy"]]
        measured = episode_metrics(log).as_json()
        assert [one[name] for name in NUMBERS] == [measured[name] for name in NUMBERS]
        assert (one["door"], one["seed"], one["why"]) == ("0.42", 3, "time ran out")
        assert f"--doors 0.42 --policy {one['policy']} --seed 3 " in one["run"]
        rows = [*gallery.FORMAT.rows(log)]
        degrees = np.degrees(log.door_angle[rows])
        assert one["angle"] == pytest.approx(degrees, abs=0.051)
        since = zip([-1, *rows], rows, strict=False)
        peaks = [abs(log.force_radial[a + 1 : b + 1]).max() for a, b in since]
        assert one["radial"] == pytest.approx(peaks, abs=0.051)
        assert one["pictures"] == len(rows) == STEPS[one["policy"]] // 10 + 1
        film = folder / one["film"]
        assert imageio_ffmpeg.count_frames_and_secs(film)[0] == len(rows)
        ffmpeg = [imageio_ffmpeg.get_ffmpeg_exe(), "-i", film]
        said = subprocess.run(ffmpeg, capture_output=True, check=False).stderr.decode()
        for part in ("Video: h264", "yuv420p", "64x48", "10 fps"):
            assert part in said


def test_only_what_is_missing_is_made(made, gplfd, tmp_path, monkeypatch):
    folder = Path(shutil.copytree(made[0], tmp_path / "copy"))
    first, second = data(folder)["episodes"]
    (folder / first["film"]).unlink()
    before = {one: one.read_bytes() for one in folder.glob("*.mp4")}

    def film(task, agent, _):
        name = f"{task.policy}-{task.seed}.mp4"
        (folder / name).touch()
        return {"policy": task.policy, "film": name, "seed": task.seed}

    monkeypatch.setattr(gallery, "_filmed", film)
    assert gplfd(*COMMAND, str(folder), "--seed", "3") == 0
    again, same = data(folder)["episodes"]
    assert (again["film"], again["made"], same) == ("oracle-3.mp4", 1, second)
    assert gplfd(*COMMAND, str(folder), "--seed", "4") == 0  # It is added.
    assert [one["seed"] for one in data(folder)["episodes"]] == [3, 3, 4, 4]
    assert before.items() <= {one: one.read_bytes() for one in before}.items()


def test_bad_input_writes_nothing(refused, tmp_path):
    assert "smal" in refused("gallery", "--doors", "smal", "--out", "o")
    assert "unknown policy 'gq'" in refused("gallery", "--policies", "gq", "--out", "o")
    assert "--seed -1 must be" in refused(*COMMAND, "o", "--seed", "-1")
    (tmp_path / "o").mkdir()
    (tmp_path / "o" / "index.html").write_text("of somebody else")
    assert "o has another index.html" in refused(*COMMAND, "o")
    (tmp_path / "o" / "episodes.js").write_text("const GALLERY = {};")
    assert "o/episodes.js: it lacks made" in refused(*COMMAND, "o")


@pytest.mark.needs("chromium")
def test_two_films_play_together_from_the_file_system(made, browser, tmp_path):
    shown = "door=0.42&seed=3&left=hinge-fit&right=oracle"
    with browser(tmp_path) as page:
        page.call("Page.navigate", url=f"{(made[0] / 'index.html').as_uri()}#{shown}")
        page.wait("document.readyState === 'complete'")
        page.wait("sides.every(side => side.film.readyState > 1)")
        assert page.value("location.hash") == f"#{shown}"
        assert "time ran out" in page.value("document.body.innerText")
        times = "sides.map(side => side.film.currentTime)"
        page.value("document.activeElement.blur()")
        page.call("Input.dispatchKeyEvent", type="keyDown", key=" ")
        page.wait("now > 0.6")
        left, right = page.value(times)
        assert abs(left - right) < 0.1
        assert 0.5 < right < 1.4
        page.call("Input.dispatchKeyEvent", type="keyDown", key=" ")
        page.wait("sides.every(({film}) => film.paused && !film.seeking)")
        assert page.value(times) == pytest.approx([page.value("now")] * 2, abs=0.04)
        page.value("play(true)")
        # The shorter one stays at its end.
        page.wait("!playing")
        assert page.value(times) == pytest.approx([1.55, 3.01], abs=0.1)
        page.value("$('time').value = 1.2; $('time').oninput()")
        page.wait("sides.every(side => !side.film.seeking)")
        assert page.value(times) == pytest.approx([1.21, 1.21], abs=0.02)
        page.value("sides[0].list.value = 'oracle'; sides[0].list.onchange()")
        page.wait("sides[0].film.readyState > 1 && !sides[0].film.seeking")
        assert page.value(times) == pytest.approx([1.21, 1.21], abs=0.02)
        assert "left=oracle" in page.value("location.hash")
        assert page.errors == []
