import importlib.metadata
import json
import sys
import tomllib
from pathlib import Path

import pytest

from gplfd_experiments.cli import doctor
from gplfd_experiments.cli import main as cli


@pytest.fixture
def machine(monkeypatch):
    """Pretend that this machine draws in one way only, and has no screen."""

    def pretend(way, missing="", renderer="llvmpipe"):
        for name in ("DISPLAY", "WAYLAND_DISPLAY"):
            monkeypatch.delenv(name, raising=False)
        monkeypatch.setenv("MUJOCO_GL", way)
        monkeypatch.setattr(sys, "platform", "linux")
        monkeypatch.setattr(doctor, "choose_opengl", lambda: None)
        monkeypatch.setattr(doctor, "drawn_by", lambda: renderer)
        installed = importlib.metadata.version

        def version(distribution):
            if distribution == missing:
                raise importlib.metadata.PackageNotFoundError
            return installed(distribution)

        monkeypatch.setattr(importlib.metadata, "version", version)

    return pretend


def test_doctor_tells_what_is_here_and_what_is_missing(machine, capsys):
    machine("osmesa", missing="dask")
    assert cli.main(["doctor", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    parts = found["parts"]
    assert found["packages"]["numpy"] == importlib.metadata.version("numpy")
    assert parts["pictures"]["present"]
    assert parts["pictures"]["remark"] == "with MUJOCO_GL=osmesa, drawn by llvmpipe"
    assert not parts["windows"]["present"]
    assert parts["dask"]["remark"] == "dask missing; pip install 'gplfd[dask]'"
    assert parts["robomimic"]["remark"].startswith("h5py ")
    assert cli.main(["doctor"]) == 0
    lines = capsys.readouterr().out.splitlines()
    (line,) = (line for line in lines if line.startswith("  dask "))
    assert line.split()[1] == "NO"


def test_a_way_to_draw_that_was_chosen_and_fails_is_named(machine):
    machine("osmesa", renderer="")
    pictures = doctor.examined()["parts"]["pictures"]
    assert not pictures["present"]
    assert "MUJOCO_GL=osmesa does not work here; unset it" in pictures["remark"]


def test_every_extra_for_users_is_looked_at():
    project = (Path(__file__).parents[2] / "pyproject.toml").read_text(encoding="utf-8")
    extras = tomllib.loads(project)["project"]["optional-dependencies"]
    assert set(extras) == {*doctor.EXTRAS, "test", "docs", "dev"}
