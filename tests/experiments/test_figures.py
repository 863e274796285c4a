"""What each figure shows, against its data; drawing simulates nothing."""

import functools
import itertools
import json
import re
from types import SimpleNamespace

import matplotlib
import numpy as np
import pytest
from matplotlib.collections import FillBetweenPolyCollection
from matplotlib.figure import Figure
from scipy.stats import f as fisher

from gplfd_experiments.analysis.figures import learned, openings, style, synthetic
from gplfd_experiments.analysis.figures.openings import expectation
from gplfd_experiments.analysis.figures.style import Material
from gplfd_experiments.analysis.figures.synthetic import HEIGHT, PHASES
from gplfd_experiments.data.teacher import Teacher
from gplfd_experiments.workflows import figures as module
from gplfd_experiments.workflows.figures import FIGURES, material, update_captions
from gplfd_policies import align
from gplfd_policies.control.stiffness import DEFAULT_PROFILE
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.skill import fit_skill
from gplfd_policies.registry.catalogue import make_agent

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("small_plots")]

DOORS = ("small", "medium", "large", "heavy", "0.42")


def simulate(*_, **__):
    raise AssertionError("a figure has simulated")


@pytest.fixture(scope="module")
def doors():
    radii = (0.35, 0.50, 0.65)
    given = Teacher().demonstrate_doors(radii, rng=np.random.default_rng(0))
    labels = tuple(radius for radius in radii for _ in range(2))
    return LabelledDemonstrations(demonstrations=given, radii=labels)


@pytest.fixture(scope="module")
def drawn(doors, make_log):
    """Figures of openings by formula with their captions; each is drawn once."""
    logs = {door: make_log(n_steps=61, dt=0.1, door=door) for door in DOORS}
    given = Material(seed=0, demonstrations=doors, episodes=logs)

    @functools.cache
    def draw(name):
        with pytest.MonkeyPatch.context() as patch, style.paper_style():
            patch.setattr("gymnasium.make", simulate)
            patch.setattr(synthetic, "_SETS", 3)
            patch.setattr(synthetic, "_FRESH", 400)
            patch.setattr("gplfd_experiments.episodes.rollout.rollout", simulate)
            return FIGURES[name].draw(given)

    return draw


@pytest.fixture(scope="module")
def opened():
    """One real opening."""
    return material(["large"], seed=0)


@pytest.mark.parametrize("name", FIGURES)
def test_figures_draw_from_logs_without_simulating(name, drawn):
    figure, caption = drawn(name)
    with style.paper_style():
        figure.draw_without_rendering()  # Fails where layout or a formula does.
    assert figure.canvas.manager is None
    assert len(caption) > 300
    assert "paper" in caption
    assert not re.search(r"\n|nan", caption)
    # Every axis that is labelled has a unit or is a ratio; Fig. 6 has its units above.
    labels = [axes.get_xlabel() for axes in figure.axes]
    labels += [axes.get_ylabel() for axes in figure.axes if name != "fig06"]
    labels += [axes.get_title() for axes in figure.axes if name == "fig06"]
    assert all(re.search(r"\[.+\]|^phase$|bound|ζ", one) for one in labels if one)
    assert sum(map(bool, labels)) >= (18 if name == "fig06" else 2)


def test_the_user_s_configuration_of_matplotlib_changes_nothing(tmp_path):
    written = []
    for grid in (False, True):
        with matplotlib.rc_context({"axes.grid": grid, "svg.hashsalt": str(grid)}):
            before = dict(matplotlib.rcParams)
            with style.paper_style():
                figure = Figure(figsize=(style.COLUMN, 1.0), layout="constrained")
                figure.subplots().plot([0.0, 1.0], [0.0, 1.0])
                style.write_figure(figure, tmp_path, "figure")
            assert dict(matplotlib.rcParams) == before
        files = [tmp_path / f"figure{end}" for end in (".svg", ".png")]
        written.append([file.read_bytes() for file in files])
    assert written[0] == written[1]
    svg, png = written[0]
    assert (svg[:5], png[1:4]) == (b"<?xml", b"PNG")
    assert b"<dc:date>" not in svg


def test_agents_of_a_log_decide_the_same_again(opened):
    log = opened.episodes["large"]
    agent = make_agent("gp", opened.demonstrations.demonstrations)
    names = ("action", "std", "stiffness", "predicted_mean", "predicted_std")
    rows = itertools.count()

    def act_and_compare(observation):
        row = next(rows)
        for forecast in log.forecasts.mean[log.forecasts.times == log.times[row]]:
            np.testing.assert_array_equal(expectation(agent).mean, forecast)
        decision = act(observation)
        for name in names:
            found, expected = getattr(decision, name), getattr(log.decisions, name)[row]
            np.testing.assert_array_equal(found, expected)
        assert decision.via_point == log.decisions.via_point[row]
        return decision

    act = agent.act
    compared = {"act": act_and_compare, "forecast": agent.forecast}
    openings.reviewed(log, SimpleNamespace(reset=agent.reset, **compared), ())
    assert next(rows) == log.times.size
    silent = make_agent("oracle", opened.demonstrations.demonstrations)
    with pytest.raises(ValueError, match="makes no forecasts"):
        expectation(silent)


def test_captions_keep_those_of_other_figures(tmp_path):
    (tmp_path / "captions.md").write_text("## gone: T (seed 0)\n\nNo figure now.\n")
    for name, seed in (("fig04", 0), ("fig03", 0), ("fig03", 7), ("fig02", 7)):
        text = f"## {name}: T (seed {seed})\n\nSeen in {name}.\n"
        update_captions(tmp_path, name, text)
    assert (tmp_path / "captions.md").read_text() == (
        "## fig02: T (seed 7)\n\nSeen in fig02.\n\n"
        "## fig03: T (seed 7)\n\nSeen in fig03.\n\n"
        "## fig04: T (seed 0)\n\nSeen in fig04.\n"
    )


def panel(figure, letter):
    heads = {axes.get_title(loc="left").split()[0]: axes for axes in figure.axes}
    return heads[rf"$\bf{{{letter}}}$"]


def lines(axes):
    """Values of the labelled lines of a panel."""
    return {line.get_label(): np.asarray(line.get_ydata()) for line in axes.lines}


def assert_band(axes, policy, output, which=0):
    """A shaded interval of a panel is the policy's."""
    shapes = [
        one for one in axes.collections if isinstance(one, FillBetweenPolyCollection)
    ]
    points = np.asarray(shapes[which].get_paths()[0].vertices)
    columns = [points[points[:, 0] == x, 1] for x in np.unique(points[:, 0])]
    low, high = policy.interval(0.95)
    lowest, highest = [one.min() for one in columns], [one.max() for one in columns]
    np.testing.assert_allclose(lowest, low[:, output], atol=1e-12)
    np.testing.assert_allclose(highest, high[:, output], atol=1e-12)


def test_fig02_only_local_noise_covers_everywhere(drawn):
    figure, _ = drawn("fig02")
    ends, middle = (PHASES < 0.1) | (PHASES > 0.9), abs(PHASES - 0.5) < 0.1
    covered = lines(panel(figure, "e"))
    assert covered["ends (a)"][middle].mean() < 30.0
    assert covered["middle (b)"][ends].mean() > 99.5
    assert covered["most likely"][ends].mean() > 99.0
    assert covered["most likely"][middle].mean() < 90.0
    assert covered["local (c)"].min() > 88.0
    assert abs(covered["local (c)"].mean() - 95.0) < 3.0
    low, high = synthetic.expected_coverage(np.random.default_rng(0))
    assert low < 0.95 < high < low + 0.08


def test_fig03_completion_aligns_what_distance_does_not():
    motions = synthetic.shelf_motions(np.random.default_rng(0))
    shown = [motion.demonstration for motion in motions]
    aligned = {
        name: align(shown, method=method, trim_rests=False)
        for name, method in (("far", "dtw-euclidean"), ("index", "interpolation"))
    }
    phase_error = synthetic.phase_errors(motions, aligned)
    assert phase_error["index"] < 0.015
    assert phase_error["far"] > 5 * phase_error["index"]


def test_fig04_strong_via_points_are_hit_and_weak_ones_are_not(drawn):
    demonstrations = synthetic.constrained_set(10, np.random.default_rng(0))
    (strong, weak), policies = synthetic.via_point_policies(demonstrations)
    for name in ("process", "product"):
        assert synthetic.missed(policies[name], strong) < 2e-3
        assert 0.01 < synthetic.missed(policies[name], weak) < 0.04
    figure, _ = drawn("fig04")
    names = ("demonstrated", "process", "product", "coarse")
    for letter, name in zip("abcd", names, strict=True):
        assert_band(panel(figure, letter), policies[name], HEIGHT)


def test_fig06_draws_recordings_and_policy_at_the_scales_that_it_says(doors, drawn):
    axes = np.reshape(drawn("fig06")[0].axes, (3, 6))
    skill = fit_skill(align(doors.demonstrations))
    for output in range(6):
        assert_band(axes[2, output], skill.predict(skill.aligned.times), output)
        low, high = axes[0, output].get_ylim()
        for line, one in zip(axes[0, output].lines, doors.demonstrations, strict=True):
            np.testing.assert_array_equal(line.get_ydata(), one.poses[:, output])
            assert low < one.poses[:, output].min()
            assert one.poses[:, output].max() < high
    factors = [
        column[0].texts[0].get_text() if column[0].texts else "" for column in axes.T
    ]
    spans = [float(np.ptp(column[0].get_ylim())) for column in axes.T]
    enlarged = [int((factor or "1").split()[0]) for factor in factors]
    assert enlarged[0] == enlarged[2] == enlarged[4] == 1 < enlarged[1]
    for kind in (slice(0, 3), slice(3, 6)):
        scaled = np.multiply(spans[kind], enlarged[kind])
        np.testing.assert_allclose(scaled, scaled[0])


def test_fig07_radius_holds_95_percent():
    free = 5
    exact = 2.0 * fisher.ppf(0.95, 2, free)
    assert learned.squared_radius(free) == pytest.approx(exact)
    assert learned.squared_radius(None) == pytest.approx(5.991, abs=1e-3)
    rng = np.random.default_rng(1)
    normal = rng.standard_normal((200_000, 2))
    scaled = normal / np.sqrt(rng.chisquare(free, (200_000, 1)) / free)
    for points, known in ((normal, None), (scaled, free)):
        inside = (points**2).sum(axis=1) <= learned.squared_radius(known)
        assert inside.mean() == pytest.approx(0.95, abs=0.002)


def test_fig09_adaptive_predicts_better_than_fixed(opened):
    log = opened.episodes["large"]
    agent = make_agent("gp", opened.demonstrations.demonstrations)
    opening = openings.reviewed(log, agent, (0.1, 0.25, 0.4))
    adaptive, fixed = (errors.mean(axis=0) for errors in opening.errors())
    assert (10.0 * adaptive[[0, 2]] < fixed[[0, 2]]).all()
    # Normal: what the innovations show of the spread is in σ itself.
    np.testing.assert_allclose(opening.adaptive.width, 1.96, atol=1e-3)
    np.testing.assert_array_equal(opening.fixed.width, opening.adaptive.width[0])
    # The first forecast, where the door is.
    for output, first in enumerate(log.forecasts.mean[0].T):
        fixed = np.interp(log.decisions.observed_phase, log.forecasts.phases, first)
        np.testing.assert_array_equal(opening.fixed.mean[:, output], fixed)
    # Drawn in the order of the phase: the adaptive mean, and the door's truth.
    rows = Figure(figsize=(style.PAGE, 3.0)).subplots(2, 4)
    openings.draw_opening(rows, opening)
    assert_band(rows[1, 0], opening.initial, 2)
    assert_band(rows[1, 2], opening.stages[2], 2, which=1)
    order = np.argsort(log.decisions.observed_phase[opening.motion], kind="stable")
    curves = (line.get_ydata() for line in rows[1, 3].lines[1:])
    for curve, values in zip(
        curves, (log.decisions.predicted_mean, log.opening.handle_pose), strict=True
    ):
        np.testing.assert_array_equal(curve, values[opening.motion][order, 2])


def test_fig10_rates_are_the_logs_and_bounds_the_controllers(make_log):
    rng = np.random.default_rng(2)
    stiffness_of = np.tile([300.0, 300.0, 300.0, 30.0, 30.0, 30.0], (50, 1))
    stiffness_of[20:23, 0] -= 15.0
    rates = 0.03 * rng.standard_normal((50, 6))
    log = make_log(n_steps=50, std_rate=rates, stiffness=stiffness_of)
    gains, fall, use = panels = Figure(figsize=(1.0, 1.0)).subplots(3)
    openings.draw_door(panels, log, DEFAULT_PROFILE)
    kept = log.decisions
    np.testing.assert_array_equal(gains.lines[1].get_ydata(), kept.stiffness[:, 0])
    for line, output in zip(fall.lines, (0, 2), strict=False):
        np.testing.assert_array_equal(line.get_xdata(), log.times)
        np.testing.assert_array_equal(line.get_ydata(), -kept.std_rate[:, output])
    bounds = [float(np.asarray(line.get_ydata())[0]) for line in fall.lines[2:]]
    # 8 γ k_min^1.5 / (α (k_max - k_min) (√k_min + δγ√m)), γ = 70 /s; then 2δγ√m.
    assert bounds == pytest.approx([560e3 / (600 * 400 * c) for c in (80, 150)])
    used = kept.stiffness_rate / (kept.stiffness_rate + kept.stability_margin)
    np.testing.assert_array_equal(use.lines[0].get_ydata(), used[:, 0])
    # Marks are where the governor holds back.
    marks = [line for line in use.lines if line.get_marker() == "v"]
    np.testing.assert_array_equal(marks[0].get_xdata(), log.times[20:23])
    assert len(np.asarray(marks[1].get_xdata())) == 0


def test_the_command_draws_some_figures(gplfd, tmp_path, make_log, monkeypatch):
    """Episodes by formula, and two figures, one of them with episodes."""

    def short(tasks, *_, **__):
        return [make_log(n_steps=121, dt=0.05, door=task.door) for task in tasks]

    monkeypatch.setattr(module.build, "learned_agents", lambda *_: object)
    monkeypatch.setattr(module.build, "open_together", short)
    out = tmp_path / "out"
    for only in ("fig10", "fig03"):
        assert gplfd("figures", "--out", "out", "--only", only) == 0
    images = {f"{name}{end}" for name in ("fig03", "fig10") for end in (".png", ".svg")}
    expected = {*images, "captions.md", "figures.json"}
    assert {path.name for path in out.iterdir()} == expected
    captions = (out / "captions.md").read_text()
    heads = [line.split(":")[0] for line in captions.splitlines() if line[:3] == "## "]
    assert heads == ["## fig03", "## fig10"]
    assert json.loads((out / "figures.json").read_text())["config"]["seed"] == 0
