"""What each figure shows, against its data, and that drawing simulates nothing."""

import dataclasses
import functools
import re
from collections.abc import Callable
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import matplotlib
import numpy as np
import pytest
from matplotlib.axes import Axes
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure
from scipy.stats import f as fisher

from gplfd_env.task.opening import DEMONSTRATED_ANGLE
from gplfd_experiments.analysis.figures import (
    fig03_alignment,
    fig07_region,
    fig09_adaptation,
    fig10_stiffness,
    forecasts,
    style,
)
from gplfd_experiments.analysis.figures import material as module
from gplfd_experiments.analysis.figures.drawing import FIGURES, update_captions
from gplfd_experiments.analysis.figures.hindsight import (
    decisions,
    expectation,
    reviewed,
)
from gplfd_experiments.analysis.figures.material import Material, material
from gplfd_experiments.analysis.figures.pick_and_place import HEIGHT, PHASES
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.episodes.forecast_error import forecast_errors
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import prediction_errors
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.trajectory import GaussianTrajectory
from gplfd_policies.registry.catalogue import make_agent

pytestmark = pytest.mark.slow

Log = Callable[..., EpisodeLog]
Measured = Callable[[str], Any]
DOORS = ("small", "medium", "large", "heavy", "0.42")


@pytest.fixture(scope="module")
def doors() -> LabelledDemonstrations:
    radii = (0.35, 0.50, 0.65)
    given = Teacher().demonstrate_doors(radii, rng=np.random.default_rng(0))
    return LabelledDemonstrations(
        demonstrations=given, radii=tuple(radius for radius in radii for _ in range(2))
    )


@pytest.fixture(scope="module")
def measured(doors: LabelledDemonstrations, formula_log: Log) -> Measured:
    """What a figure shows of openings by formula; each figure is measured once."""
    logs = {door: formula_log(n_steps=61, dt=0.1, door=door) for door in DOORS}
    given = Material(seed=0, demonstrations=doors, episodes=logs)

    def simulate(*_: Any, **__: Any) -> None:
        raise AssertionError("a figure has simulated")

    @functools.cache
    def measure(name: str) -> Any:
        with pytest.MonkeyPatch.context() as patch:
            patch.setattr("gymnasium.make", simulate)
            patch.setattr("gplfd_experiments.episodes.rollout.rollout", simulate)
            patch.setattr(module, "rollout", simulate)
            patch.setattr(forecasts, "DOORS", ("large",))
            return FIGURES[name].measure(given)

    return measure


@pytest.fixture(scope="module")
def opened(tmp_path_factory: pytest.TempPathFactory) -> Material:
    """One real opening."""
    return material(tmp_path_factory.mktemp("runs"), ["large"], seed=0)


@pytest.fixture(scope="module")
def opening(opened: Material) -> Any:
    """What its policy predicted in it."""
    agent = make_agent("gp", opened.demonstrations.demonstrations)
    return reviewed(opened.episodes["large"], agent, (0.1, 0.25, 0.4))


@pytest.mark.parametrize("name", FIGURES)
def test_figures_draw_from_logs_without_simulating(
    name: str,
    measured: Measured,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setitem(style._STYLE, "savefig.dpi", 40)  # type: ignore[index]
    shown = measured(name)
    with style.paper_style():
        figure = FIGURES[name].draw(shown)
        style.write_figure(figure, tmp_path, name)
    assert (tmp_path / f"{name}.png").read_bytes().startswith(b"\x89PNG")
    assert b"</svg>" in (tmp_path / f"{name}.svg").read_bytes()
    assert type(figure.canvas).__name__ == "FigureCanvasAgg"
    assert figure.canvas.manager is None
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
    measured: Measured, tmp_path: Path
) -> None:
    written = []
    for number, grid in enumerate((False, True)):
        with matplotlib.rc_context({"axes.grid": grid, "svg.hashsalt": str(grid)}):
            before = dict(matplotlib.rcParams)
            with style.paper_style():
                figure = FIGURES["fig10"].draw(measured("fig10"))
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
    (tmp_path / "captions.md").write_text("## gone: T (seed 0)\n\nNo figure now.\n")
    for name, seed in (("fig04", 0), ("fig03", 0), ("fig03", 7), ("fig02", 7)):
        text = f"## {name}: T (seed {seed})\n\nSeen in {name}.\n"
        update_captions(tmp_path, name, text)
    assert (tmp_path / "captions.md").read_text() == (
        "## fig02: T (seed 7)\n\nSeen in fig02.\n\n"
        "## fig03: T (seed 7)\n\nSeen in fig03.\n\n"
        "## fig04: T (seed 0)\n\nSeen in fig04.\n"
    )


def test_runs_are_kept_apart_by_whatever_they_depend_on(
    opened: Material, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made: list[str] = []
    log = opened.episodes["large"]

    def rollout(*_: Any, door: str, **__: Any) -> EpisodeLog:
        made.append(door)
        return dataclasses.replace(log, door=door)

    monkeypatch.setattr(module, "rollout", rollout)
    agent = SimpleNamespace(control="pose")
    monkeypatch.setattr(module, "learned_agents", lambda *_: lambda: agent)
    for seed, doors in ((0, ["small"]), (0, ["small", "0.42"]), (1, ["small"])):
        material(tmp_path, doors, seed=seed)
    assert made == ["small", "0.42", "small"]
    monkeypatch.setattr(module, "source_digest", lambda: "another program")
    material(tmp_path, ["small"], seed=0)
    assert made == ["small", "0.42", "small", "small"]
    assert len(list(tmp_path.iterdir())) == 3


def panel(figure: Figure, letter: str) -> Axes:
    heads = {axes.get_title(loc="left").split()[0]: axes for axes in figure.axes}
    return heads[rf"$\bf{{{letter}}}$"]


def bands(axes: Axes) -> list[tuple[np.ndarray, np.ndarray]]:
    """Lower and upper bounds of the shaded intervals of a panel."""
    found = []
    for shape in axes.collections:
        if isinstance(shape, FillBetweenPolyCollection):
            points = np.asarray(shape.get_paths()[0].vertices)
            at = np.unique(points[:, 0])
            columns = [points[points[:, 0] == x, 1] for x in at]
            found.append(
                (
                    np.array([column.min() for column in columns]),
                    np.array([column.max() for column in columns]),
                )
            )
    return found


def assert_shows(
    drawn: tuple[np.ndarray, np.ndarray], policy: GaussianTrajectory, output: int
) -> None:
    low, high = policy.interval(0.95)
    np.testing.assert_allclose(drawn[0], low[:, output], atol=1e-12)
    np.testing.assert_allclose(drawn[1], high[:, output], atol=1e-12)


def test_fig02_bands_are_the_policies_intervals(measured: Measured) -> None:
    shown = measured("fig02")
    figure = FIGURES["fig02"].draw(shown)
    for letter, name in (("a", "low"), ("b", "high"), ("c", "local")):
        (drawn,) = bands(panel(figure, letter))
        assert_shows(drawn, shown.policies[name], HEIGHT)


def test_fig02_only_local_noise_covers_everywhere(
    measured: Measured,
) -> None:
    shown = measured("fig02")
    ends, middle = (PHASES < 0.1) | (PHASES > 0.9), abs(PHASES - 0.5) < 0.1
    low, high, likely, local = (
        shown.coverage[name] for name in ("low", "high", "likely", "local")
    )
    assert low[middle].mean() < 0.3
    assert high[ends].mean() > 0.995
    assert likely[ends].mean() > 0.99
    assert likely[middle].mean() < 0.9
    assert local.min() > 0.88
    assert abs(local.mean() - 0.95) < 0.03
    assert shown.expected[0] < 0.95 < shown.expected[1]
    assert shown.expected[1] - shown.expected[0] < 0.08


def test_fig03_completion_aligns_what_distance_does_not(
    measured: Measured,
) -> None:
    shown = measured("fig03")
    assert shown.phase_error["completion"] < 0.015
    assert shown.phase_error["euclidean"] > 5 * shown.phase_error["completion"]
    assert shown.end_error["completion"] < 1e-9


def test_fig03_draws_what_was_recorded_and_aligned(
    measured: Measured,
) -> None:
    shown = measured("fig03")
    figure = fig03_alignment.draw(shown)
    for letter, name in (("b", "euclidean"), ("c", "completion")):
        for line, poses in zip(
            panel(figure, letter).lines, shown.aligned[name].poses, strict=True
        ):
            np.testing.assert_array_equal(line.get_ydata(), poses[:, HEIGHT])
    for line, motion in zip(panel(figure, "a").lines, shown.motions, strict=True):
        np.testing.assert_array_equal(
            line.get_ydata(), motion.demonstration.poses[:, HEIGHT]
        )
    for line, index in zip(panel(figure, "d").lines, shown.completion, strict=True):
        np.testing.assert_array_equal(line.get_ydata(), index)


def test_fig04_strong_via_points_are_hit_and_weak_ones_are_not(
    measured: Measured,
) -> None:
    shown = measured("fig04")
    strong, weak = shown.via_points
    for name in ("process", "product"):
        assert shown.miss(name, strong) < 2e-3
        assert 0.01 < shown.miss(name, weak) < 0.04
    figure = FIGURES["fig04"].draw(shown)
    for letter, name in zip("abcd", (*_FIG04, "coarse"), strict=True):
        (drawn,) = bands(panel(figure, letter))
        assert_shows(drawn, shown.policies[name], HEIGHT)
    assert shown.std("product", 0.5) < 0.8 * shown.std("coarse", 0.5)


_FIG04 = ("demonstrated", "process", "product")


def test_fig06_draws_recordings_alignment_and_policy(
    doors: LabelledDemonstrations, measured: Measured
) -> None:
    shown = measured("fig06")
    axes = np.reshape(FIGURES["fig06"].draw(shown).axes, (3, 6))
    for output in range(6):
        assert_shows(bands(axes[2, output])[0], shown.policy, output)
        for number, line in enumerate(axes[0, output].lines):
            poses = doors.demonstrations[number].poses
            np.testing.assert_array_equal(line.get_ydata(), poses[:, output])
            assert axes[0, output].get_ylim()[0] < poses[:, output].min()
            assert axes[0, output].get_ylim()[1] > poses[:, output].max()


def test_fig06_scales_of_a_kind_differ_by_what_is_written(
    measured: Measured,
) -> None:
    axes = np.reshape(FIGURES["fig06"].draw(measured("fig06")).axes, (3, 6))
    spans = [float(np.ptp(column[0].get_ylim())) for column in axes.T]
    written = [
        int(column[0].texts[0].get_text().split()[0]) if column[0].texts else 1
        for column in axes.T
    ]
    assert written[0] == written[2] == written[4] == 1
    assert written[1] > 1
    for kind in (slice(0, 3), slice(3, 6)):
        scaled = np.multiply(spans[kind], written[kind])
        np.testing.assert_allclose(scaled, scaled[0])


def test_fig07_radius_holds_95_percent() -> None:
    rng = np.random.default_rng(1)
    free = 5
    normal = rng.standard_normal((200_000, 2))
    assert fig07_region.squared_radius(None) == pytest.approx(5.991, abs=1e-3)
    inside = (normal**2).sum(axis=1) <= fig07_region.squared_radius(None)
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
    scaled = normal / np.sqrt(rng.chisquare(free, (200_000, 1)) / free)
    inside = (scaled**2).sum(axis=1) <= fig07_region.squared_radius(free)
    assert inside.mean() == pytest.approx(0.95, abs=0.002)
    assert fig07_region.squared_radius(free) == pytest.approx(
        2.0 * fisher.ppf(0.95, 2, free)
    )


def test_fig07_counts_the_samples_of_the_arcs(measured: Measured) -> None:
    shown = measured("fig07")
    mean, std = shown.policy.mean[:, (0, 2)], shown.policy.std[:, (0, 2)]
    few = shown.policy.degrees_of_freedom
    for free, counted in zip((few, None), shown.arc_inside, strict=True):
        inside = [
            (((point - mean) / std) ** 2).sum(axis=1).min()
            <= fig07_region.squared_radius(free)
            for path in shown.arcs.values()
            for point in path
        ]
        assert counted == pytest.approx(np.mean(inside))
    assert shown.arc_inside[1] > 0.95
    lengths = [np.linalg.norm(path - [0.0, -r], axis=1) for r, path in _arcs(shown)]
    for radius, length in zip((0.35, 0.50, 0.65), lengths, strict=True):
        np.testing.assert_allclose(length, radius)


def _arcs(shown: fig07_region.Region) -> list[tuple[float, Any]]:
    return list(shown.arcs.items())


def test_fig09_draws_the_logs_predictions(opening: Any) -> None:
    log = opening.log
    shown = dict.fromkeys(fig09_adaptation.DOORS, opening)
    rows = np.reshape(fig09_adaptation.draw(shown).axes, (3, 4))
    order = np.argsort(log.observed_phase[opening.motion], kind="stable")
    for index, output in enumerate((0, 2)):
        for stage in range(3):
            initial, adapted = bands(rows[index, stage])
            assert_shows(initial, opening.initial, output)
            assert_shows(adapted, opening.stages[stage], output)
        _, adaptive, truth = rows[index, 3].lines
        predicted = log.predicted_mean[opening.motion][order, output]
        np.testing.assert_array_equal(adaptive.get_ydata(), predicted)
        np.testing.assert_array_equal(
            truth.get_ydata(), log.handle_pose[opening.motion][order, output]
        )
        first = log.forecast_mean[0, :, output]
        fixed = np.interp(log.observed_phase, log.forecast_phase, first)
        np.testing.assert_array_equal(opening.fixed.mean[:, output], fixed)
        errors = prediction_errors(log)[opening.motion][order, output]
        np.testing.assert_array_equal(rows[2, 0].lines[2 + index].get_ydata(), errors)


def test_fig09_adaptive_predicts_better_than_fixed(opening: Any) -> None:
    adaptive, fixed = (errors.mean(axis=0) for errors in opening.errors())
    assert (10.0 * adaptive[[0, 2]] < fixed[[0, 2]]).all()
    # Student t with 5 degrees of freedom, however many via-points later.
    np.testing.assert_allclose(opening.adaptive.width, 2.571, atol=0.01)
    np.testing.assert_array_equal(opening.fixed.width, opening.adaptive.width[0])


def test_fig10_rates_are_the_logs_and_bounds_the_controllers(make_log: Log) -> None:
    rng = np.random.default_rng(2)
    log = make_log(n_steps=50, std_rate=0.03 * rng.standard_normal((50, 6)))
    shown = fig10_stiffness.stability(log, DEFAULT_PROFILE)
    axes = np.reshape(fig10_stiffness.draw({"medium": shown}).axes, (3,))
    for line, output in zip(axes[1].lines, (0, 2), strict=False):
        np.testing.assert_array_equal(line.get_xdata(), log.times)
        np.testing.assert_array_equal(line.get_ydata(), -log.std_rate[:, output])
    drawn = [float(np.asarray(line.get_ydata())[0]) for line in axes[1].lines[2:]]
    # 8 γ k_min^1.5 / (α (k_max - k_min) (√k_min + δγ√m)), γ = 70 /s; then 2δγ√m.
    assert drawn == pytest.approx([560e3 / (600 * 400 * c) for c in (80, 150)])
    used = log.stiffness_rate / (log.stiffness_rate + log.stability_margin)
    np.testing.assert_array_equal(axes[2].lines[0].get_ydata(), used[:, 0])
    np.testing.assert_array_equal(axes[0].lines[1].get_ydata(), log.stiffness[:, 0])


def test_fig10_marks_where_the_governor_holds_back(make_log: Log) -> None:
    agent_std = np.full((50, 6), 0.01)
    stiffness = np.tile([300.0, 300.0, 300.0, 30.0, 30.0, 30.0], (50, 1))
    stiffness[20:23, 0] -= 15.0
    log = make_log(n_steps=50, std=agent_std, stiffness=stiffness)
    shown = fig10_stiffness.stability(log, DEFAULT_PROFILE)
    np.testing.assert_array_equal(np.flatnonzero(shown.governed[:, 0]), [20, 21, 22])
    assert not shown.governed[:, 2].any()
    use = fig10_stiffness.draw({"medium": shown}).axes[2]
    marks = [line for line in use.lines if line.get_marker() == "v"]
    np.testing.assert_array_equal(marks[0].get_xdata(), log.times[20:23])
    assert len(np.asarray(marks[1].get_xdata())) == 0


def test_fig10_uses_the_law_of_the_policy_that_it_shows(opened: Material) -> None:
    """Where the governor holds nothing back, the stiffness is what the law gives."""
    episodes = dict.fromkeys(fig10_stiffness.DOORS, opened.episodes["large"])
    both = dataclasses.replace(opened, episodes=episodes)
    shown = fig10_stiffness.measure(both)["medium"]
    assert 0.0 < shown.governed[:, [0, 2]].mean() < 0.3


def test_forecasts_are_of_what_is_still_to_come(opened: Material) -> None:
    log = opened.episodes["large"]
    given = opened.demonstrations.demonstrations
    agents = {name: make_agent(name, given) for name in forecasts.FORMS}
    shown = forecasts.foretold(log, agents)
    for each in shown.by_form.values():
        for forecast, phase in zip(each, shown.phases, strict=True):
            rest = forecast.rest
            assert rest.times[0] > phase >= rest.times[0] - 0.011
            assert rest.times[-1] == 1.0
            variance = np.diagonal(rest.covariance, axis1=1, axis2=2).T
            np.testing.assert_allclose(variance, rest.std**2, rtol=1e-6)
            distance = np.linalg.norm(
                forecast.truth[:, (0, 2)] - [0.0, -log.radius], axis=1
            )
            np.testing.assert_allclose(distance, log.radius, atol=2e-3)
    # Where it will go; when is another matter.
    early, *_, late = (
        error for error in forecast_errors(log, DEMONSTRATED_ANGLE) if error
    )
    assert late < 0.2 * early


def test_forecast_scores_by_hand() -> None:
    ramp = np.outer([0.0, 0.1, 0.2, 0.3], np.ones(6))
    rest = GaussianTrajectory(
        times=np.array([0.7, 0.8, 0.9, 1.0]),
        mean=ramp,
        std=np.full((4, 6), 0.01),
        mean_rate=ramp,
        std_rate=ramp,
        covariance_function=lambda: np.zeros((6, 4, 4)),
    )
    truth = ramp[:2].copy()
    truth[0, 0] += 0.03  # outside
    truth[1, 2] -= 0.01  # inside
    truth[:, 1] += 1.0  # not on the plane
    forecast = forecasts.Forecast(rest=rest, truth=truth)
    assert forecast.coverage() == pytest.approx(3 / 4)
    assert forecast.rms_error() == pytest.approx(np.sqrt((0.03**2 + 0.01**2) / 2))
