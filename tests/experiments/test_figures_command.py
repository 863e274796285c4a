import json
from types import SimpleNamespace

import pytest

from gplfd_experiments.analysis.figures import drawing, material

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_plots")]


def files(folder):
    return {path.name for path in folder.iterdir()}


def simulate(*_, **__):
    raise AssertionError("simulated")


def test_the_command_its_repetition_and_figures_without_episodes(
    gplfd, tmp_path, make_log, monkeypatch
):
    """Episodes by formula, and two figures, one of them with episodes."""

    def short(*_, door, **__):
        return make_log(n_steps=121, dt=0.05, door=door)

    agent = SimpleNamespace(control="pose")
    monkeypatch.setattr(material, "learned_agents", lambda *_: lambda: agent)
    monkeypatch.setattr(material, "rollout", simulate)
    two = {name: drawing.FIGURES[name] for name in ("fig03", "fig10")}
    monkeypatch.setattr(drawing, "FIGURES", two)

    out = tmp_path / "out"
    assert gplfd("figures", "--out", "out", "--only", "fig03") == 0
    assert {path.name for path in out.glob("*.*g")} == {"fig03.png", "fig03.svg"}
    monkeypatch.setattr(material, "rollout", short)
    assert gplfd("figures", "--out", "out") == 0
    drawn = {f"{name}{end}" for name in ("fig03", "fig10") for end in (".png", ".svg")}
    assert files(out) == {*drawn, "captions.md", "figures.json", "logs"}
    (runs,) = (out / "logs").iterdir()
    logs = {f"gp-{door}.npz" for door in ("medium", "heavy")}
    assert files(runs) == {"settings.json", "demonstrations.npz", *logs}
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
