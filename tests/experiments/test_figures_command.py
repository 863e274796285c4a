import json
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest

from gplfd_experiments.analysis.figures import drawing, material, style
from gplfd_experiments.episodes.log import EpisodeLog

pytestmark = pytest.mark.slow

Gplfd = Callable[..., int]


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


@pytest.fixture
def short_runs(make_log, monkeypatch):
    """Episodes by formula, and two figures, one of them with episodes."""

    def short(*_: Any, door: str, **__: Any) -> EpisodeLog:
        return make_log(n_steps=121, dt=0.05, door=door)

    agent = SimpleNamespace(control="pose")
    monkeypatch.setattr(material, "learned_agents", lambda *_: lambda: agent)
    monkeypatch.setattr(material, "rollout", short)
    monkeypatch.setitem(style._STYLE, "savefig.dpi", 40)  # type: ignore[index]
    two = {name: drawing.FIGURES[name] for name in ("fig03", "fig10")}
    monkeypatch.setattr(drawing, "FIGURES", two)


@pytest.mark.usefixtures("short_runs")
def test_the_whole_command_and_its_repetition(gplfd, tmp_path, monkeypatch):
    assert gplfd("figures", "--out", "out") == 0
    out = tmp_path / "out"
    drawn = {f"{name}{end}" for name in ("fig03", "fig10") for end in (".png", ".svg")}
    assert files(out) == {*drawn, "captions.md", "figures.json", "logs"}
    (runs,) = (out / "logs").iterdir()
    assert files(runs) == {
        "settings.json",
        "demonstrations.npz",
        *(f"gp-{door}.npz" for door in ("medium", "heavy")),
    }
    captions = (out / "captions.md").read_text()
    heads = [line.split(":")[0] for line in captions.splitlines() if line[:3] == "## "]
    assert heads == ["## fig03", "## fig10"]
    assert json.loads((out / "figures.json").read_text())["config"]["seed"] == 0
    first = {path.name: path.read_bytes() for path in out.glob("fig??.*")}

    # Runs are used again, and give the same bytes.
    monkeypatch.setattr(material, "rollout", simulate)
    (out / "fig10.svg").unlink()
    assert gplfd("figures", "--out", "out", "--only", "fig10") == 0
    assert {path.name: path.read_bytes() for path in out.glob("fig??.*")} == first


@pytest.mark.usefixtures("short_runs")
def test_figures_without_episodes_run_none(gplfd, tmp_path, monkeypatch):
    monkeypatch.setattr(material, "rollout", simulate)
    assert gplfd("figures", "--out", "out", "--only", "fig03") == 0
    assert {"fig03.png", "fig03.svg"} <= files(tmp_path / "out")
    assert "fig10.png" not in files(tmp_path / "out")


def simulate(*_: Any, **__: Any) -> None:
    raise AssertionError("simulated")
