import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import pytest

from gplfd_experiments.analysis.figures import (
    episodes,
    fig02_heteroscedastic,
    forecasts,
    style,
)
from gplfd_experiments.analysis.figures.catalogue import FIGURES
from gplfd_experiments.episodes.log import EpisodeLog

Gplfd = Callable[..., int]


def files(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def test_the_whole_command(
    gplfd: Gplfd,
    tmp_path: Path,
    make_log: Callable[..., EpisodeLog],
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def short(*_: Any, door: str, **__: Any) -> EpisodeLog:
        return make_log(n_steps=121, dt=0.05, door=door)

    monkeypatch.setattr(episodes, "rollout", short)
    monkeypatch.setitem(style._STYLE, "savefig.dpi", 40)  # type: ignore[index]
    monkeypatch.setattr(fig02_heteroscedastic, "_SETS", 2)
    monkeypatch.setattr(forecasts, "DOORS", ("large", "0.42"))
    assert gplfd("figures", "--out", "out") == 0
    out = tmp_path / "out"
    drawn = {f"{name}{end}" for name in FIGURES for end in (".png", ".svg")}
    assert files(out) == {*drawn, "captions.md", "figures.json", "logs"}
    (runs,) = (out / "logs").iterdir()
    assert files(runs) == {
        "settings.json",
        "demonstrations.npz",
        *(f"gp-{door}.npz" for door in ("small", "medium", "large", "heavy", "0.42")),
    }
    captions = (out / "captions.md").read_text()
    heads = [line.split(":")[0] for line in captions.splitlines() if line[:3] == "## "]
    assert heads == [f"## {name}" for name in FIGURES]
    assert json.loads((out / "figures.json").read_text())["config"]["seed"] == 0


def test_runs_are_used_again_and_give_the_same_bytes(
    gplfd: Gplfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert gplfd("figures", "--out", "a", "--only", "fig10") == 0
    assert gplfd("figures", "--out", "b", "--only", "fig10") == 0
    first = (tmp_path / "a" / "fig10.svg").read_bytes()
    assert (tmp_path / "b" / "fig10.svg").read_bytes() == first

    def simulate(*_: Any, **__: Any) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr(episodes, "rollout", simulate)
    assert gplfd("figures", "--out", "a", "--only", "fig10", "fig03") == 0
    assert (tmp_path / "a" / "fig10.svg").read_bytes() == first
    assert "fig03.png" in files(tmp_path / "a")
    assert "fig02.png" not in files(tmp_path / "a")


def test_figures_without_episodes_run_none(
    gplfd: Gplfd, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def simulate(*_: Any, **__: Any) -> None:
        raise AssertionError("simulated")

    monkeypatch.setattr(episodes, "rollout", simulate)
    assert gplfd("figures", "--out", "out", "--only", "fig07") == 0
    assert {"fig07.png", "fig07.svg"} <= files(tmp_path / "out")


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (["--only", "fig02", "fig08"], "no figure 'fig08'; figures: fig02, fig03, fig"),
        (["--seed", "-1"], "--seed -1 must be 0 or more"),
        (["--out", "taken"], "--out taken is a file; give a folder"),
        (["--out", "taken/below"], "taken"),
    ],
)
def test_bad_input_is_one_sentence_status_2_and_no_files(
    gplfd: Gplfd,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
    arguments: list[str],
    message: str,
) -> None:
    (tmp_path / "taken").write_text("")
    assert gplfd("figures", *arguments) == 2
    printed = capsys.readouterr().err
    assert printed.startswith("gplfd: ")
    assert len(printed.splitlines()) == 1
    assert message in printed
    assert files(tmp_path) == {"taken"}
