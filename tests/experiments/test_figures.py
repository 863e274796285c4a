"""What is drawn, and that drawing simulates nothing."""

import dataclasses
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import (
    episodes,
    fig02_heteroscedastic,
    forecasts,
    style,
)
from gplfd_experiments.analysis.figures.captions import section, update_captions
from gplfd_experiments.analysis.figures.catalogue import FIGURES, chosen
from gplfd_experiments.analysis.figures.hindsight import decisions, expectation
from gplfd_experiments.analysis.figures.material import Material
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.demonstrations.npz import (
    load_demonstrations,
    save_demonstrations,
)
from gplfd_policies.registry.catalogue import make_agent

Log = Callable[..., EpisodeLog]


@pytest.fixture
def small(tmp_path: Path, make_log: Log, monkeypatch: pytest.MonkeyPatch) -> Material:
    """Saved openings by formula, read again; whoever simulates now fails."""
    radii = (0.35, 0.50, 0.65)
    given = Teacher().demonstrate_doors(radii, rng=np.random.default_rng(0))
    file = tmp_path / "demonstrations.npz"
    save_demonstrations(file, given, [radius for radius in radii for _ in range(2)])
    for door in ("small", "medium", "large", "heavy", "0.42"):
        make_log(n_steps=121, dt=0.05, door=door).save(tmp_path / f"{door}.npz")

    def simulate(*_: Any, **__: Any) -> None:
        raise AssertionError("a figure has simulated")

    monkeypatch.setattr("gymnasium.make", simulate)
    monkeypatch.setattr("gplfd_experiments.episodes.rollout.rollout", simulate)
    monkeypatch.setattr(episodes, "rollout", simulate)
    monkeypatch.setattr(fig02_heteroscedastic, "_SETS", 2)
    monkeypatch.setattr(forecasts, "DOORS", ("large", "0.42"))
    return Material(
        seed=0,
        demonstrations=load_demonstrations(file),
        episodes={
            door: EpisodeLog.load(tmp_path / f"{door}.npz")
            for door in ("small", "medium", "large", "heavy", "0.42")
        },
    )


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Material:
    """One real opening."""
    return episodes.material(tmp_path_factory.mktemp("runs"), ["large"], seed=0)


@pytest.mark.parametrize("name", FIGURES)
def test_figures_draw_from_saved_logs_without_simulating(
    name: str, small: Material, tmp_path: Path
) -> None:
    shown = FIGURES[name].measure(small)
    with style.paper_style():
        figure = FIGURES[name].draw(shown)
        style.write_figure(figure, tmp_path, name)
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert b"</svg>" in (tmp_path / f"{name}.svg").read_bytes()
    caption = FIGURES[name].caption(shown)
    assert len(caption) > 300
    assert "\n" not in caption
    assert "paper" in caption
    assert "nan" not in caption
    assert_units(figure, name)


def assert_units(figure: Figure, name: str) -> None:
    """Every axis that is labelled has a unit or is a ratio."""
    labels = [axes.get_xlabel() for axes in figure.axes]
    labels += [axes.get_ylabel() for axes in figure.axes]
    if name == "fig06":  # its units are above its columns
        titles = [axes.get_title() for axes in figure.axes]
        assert sum("[m]" in title or "[rad]" in title for title in titles) == 6
        labels = [label for label in labels if label not in _FIG06_ROWS]
    ratios = r"\[.+\]|^phase$|bound|ζ"
    assert all(re.search(ratios, label) for label in labels if label)
    assert sum(map(bool, labels)) >= 2


_FIG06_ROWS = ("recorded", "aligned", "policy, 95 %")


def test_the_same_data_give_the_same_bytes_whatever_the_user_has_configured(
    small: Material, tmp_path: Path
) -> None:
    written = []
    for number, grid in enumerate((False, True)):
        with matplotlib.rc_context({"axes.grid": grid, "svg.hashsalt": str(grid)}):
            before = dict(matplotlib.rcParams)
            with style.paper_style():
                figure = FIGURES["fig10"].draw(FIGURES["fig10"].measure(small))
                style.write_figure(figure, tmp_path, f"number{number}")
            assert dict(matplotlib.rcParams) == before
        written.append(
            [
                (tmp_path / f"number{number}{end}").read_bytes()
                for end in (".svg", ".png")
            ]
        )
    assert written[0] == written[1]
    assert b"<dc:date>" not in written[0][0]


def test_drawing_needs_no_window_system(small: Material) -> None:
    with style.paper_style():
        figure = FIGURES["fig03"].draw(FIGURES["fig03"].measure(small))
    assert type(figure.canvas).__name__ == "FigureCanvasAgg"
    assert figure.canvas.manager is None


def test_agents_of_a_log_decide_the_same_again(opened: Material) -> None:
    log = opened.episodes["large"]
    agent = make_agent("gp", opened.demonstrations.demonstrations)
    repeated = decisions(log, agent)
    for row, time in enumerate(log.times):
        for forecast in log.forecast_mean[log.forecast_times == time]:
            np.testing.assert_array_equal(expectation(agent).mean, forecast)
        decision = next(repeated)
        for name in ("action", "std", "stiffness", "predicted_mean", "predicted_std"):
            np.testing.assert_array_equal(
                getattr(decision, name), getattr(log, name)[row]
            )
        assert decision.via_point == log.via_point[row]
    assert next(repeated, None) is None


def test_expectation_of_an_agent_that_makes_no_forecasts(opened: Material) -> None:
    agent = make_agent("oracle", opened.demonstrations.demonstrations)
    with pytest.raises(ValueError, match="makes no forecasts"):
        expectation(agent)


def test_captions_keep_those_of_other_figures(tmp_path: Path) -> None:
    order = ["one", "two", "three"]
    first = {name: section(name, "T", 0, f"Seen in {name}.") for name in order[1:]}
    update_captions(tmp_path, first, order)
    update_captions(tmp_path, {"two": section("two", "T", 7, "New.")}, order)
    update_captions(tmp_path, {"one": section("one", "T", 7, "First.")}, order)
    assert (tmp_path / "captions.md").read_text() == (
        "## one: T (seed 7)\n\nFirst.\n\n"
        "## two: T (seed 7)\n\nNew.\n\n"
        "## three: T (seed 0)\n\nSeen in three.\n"
    )


def test_figures_are_chosen_by_name_in_the_catalogues_order() -> None:
    assert list(chosen([])) == list(FIGURES)
    assert list(chosen(["fig10", "fig02"])) == ["fig02", "fig10"]
    with pytest.raises(ValueError, match=r"no figure 'fig05'; figures: fig02, fig03"):
        chosen(["fig02", "fig05"])


def test_runs_are_kept_apart_by_whatever_they_depend_on(
    opened: Material, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    log = opened.episodes["large"]

    def rollout(*_: Any, door: str, **__: Any) -> EpisodeLog:
        made.append(door)
        return dataclasses.replace(log, door=door)

    monkeypatch.setattr(episodes, "rollout", rollout)
    agent = SimpleNamespace(control="pose")
    monkeypatch.setattr(episodes, "learned_agents", lambda *_: lambda: agent)
    for seed, doors in ((0, ["small"]), (0, ["small", "0.42"]), (1, ["small"])):
        episodes.material(tmp_path, doors, seed=seed)
    assert made == ["small", "0.42", "small"]
    monkeypatch.setattr(episodes, "_source_digest", lambda: "another program")
    episodes.material(tmp_path, ["small"], seed=0)
    assert made == ["small", "0.42", "small", "small"]
    assert len(list(tmp_path.iterdir())) == 3
