"""`gplfd run --video`: an MP4 file per door, or an error before anything is written."""

import json
import math
import subprocess
import sys
from pathlib import Path
from unittest import mock

import imageio_ffmpeg
import numpy as np
import pytest

from gplfd_env.conventions.opengl import choose_opengl
from gplfd_env.envs.camera import Camera
from gplfd_experiments.workflows import runs

pytestmark = pytest.mark.slow

ORACLE = ("run", "--policy", "oracle")
RATE = 5
"""Images per second; as many as a video has take longer."""


@pytest.fixture(autouse=True)
def few_small_images(monkeypatch):
    monkeypatch.setattr(runs.video, "SIZE", (64, 48))
    monkeypatch.setattr(runs.video, "RATE", RATE)


def images_of(file: Path) -> np.ndarray:
    """Return the images of a video (N, 48, 64, 3), `RATE` per second."""
    raw = ("-r", str(RATE), "-f", "rawvideo", "-pix_fmt", "rgb24", "-")
    decoded = subprocess.run(
        [imageio_ffmpeg.get_ffmpeg_exe(), "-i", str(file), *raw],
        capture_output=True,
        check=True,
    )
    return np.frombuffer(decoded.stdout, np.uint8).reshape(-1, 48, 64, 3).astype(int)


@pytest.mark.needs("opengl")
def test_a_video_per_door_shows_the_whole_episode(gplfd, tmp_path, capsys):
    doors = ("--doors", "small", "0.42")
    assert gplfd(*ORACLE, *doors, "--video", "new/op.mp4", "--out", "o") == 0
    folder = tmp_path / "new"
    # And no temporary file.
    assert {one.name for one in folder.iterdir()} == {"op-small.mp4", "op-0.42.mp4"}
    metrics = json.loads((tmp_path / "o" / "metrics.json").read_text())
    for episode in metrics:
        seen = images_of(folder / f"op-{episode['door']}.mp4")
        # In real time, with the last state, and its end for a second.
        assert len(seen) == math.ceil(RATE * episode["duration"] - 1e-9) + 1 + RATE
        moved = np.abs(seen - seen[0]).mean(axis=(1, 2, 3))
        assert moved[1] < 0.5 < 2.0 < moved[-1]
    assert f"wrote {folder / 'op-small.mp4'}" in capsys.readouterr().err


def test_no_video_without_encoder_or_opengl(gplfd, refused, monkeypatch, capsys):
    command = (*ORACLE, "--video", "op.mp4", "--out", "o")
    picture = mock.Mock(side_effect=RuntimeError("no picture without OpenGL"))
    monkeypatch.setattr(Camera, "picture", picture)
    assert "--video: no picture without OpenGL" in refused(*command)
    with monkeypatch.context() as later:
        later.setattr(runs.video, "check_video", lambda: None)
        assert gplfd(*command) == 2
    assert "not drawn: no picture without OpenGL" in capsys.readouterr().err
    monkeypatch.setitem(sys.modules, "imageio_ffmpeg", None)
    assert "pip install 'gplfd[video]'" in refused(*command)


@pytest.mark.skipif(sys.platform != "linux", reason="EGL is of Linux")
def test_without_a_screen_egl_draws_unless_the_user_chose(monkeypatch):
    monkeypatch.setattr("ctypes.util.find_library", lambda name: "libEGL.so.1")
    monkeypatch.delitem(sys.modules, "mujoco")
    chosen = {"MUJOCO_GL": "osmesa"}
    for given, expected in (({}, "egl"), ({"DISPLAY": ":0"}, None), (chosen, "osmesa")):
        monkeypatch.setattr("os.environ", environment := dict(given))
        choose_opengl()
        assert environment.get("MUJOCO_GL") == expected
    # EGL alone, without the library of its functions, lets `import mujoco` fail.
    present = {"EGL": "libEGL.so.1"}
    monkeypatch.setattr("ctypes.util.find_library", present.get)
    monkeypatch.setattr("os.environ", environment := {})
    choose_opengl()
    assert environment == {}
    refusals = {
        "egl": "needs libOpenGL",
        "osmesa": "needs libOSM",
        "nix": "must be egl",
    }
    for given, words in refusals.items():
        monkeypatch.setattr("os.environ", {"MUJOCO_GL": given})
        with pytest.raises(OSError, match=f"MUJOCO_GL={given} {words}"):
            choose_opengl()
