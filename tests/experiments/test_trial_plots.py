"""Plots of trials show the numbers of the tables, and which way is better."""

import math
from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from matplotlib.axes import Axes

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.report.page import report
from gplfd_experiments.analysis.report.trial_plots import (
    deciding_numbers,
    ideas,
    kind_of,
)
from gplfd_experiments.analysis.report.trials import ordered, trial_table
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import Shift
from gplfd_experiments.analysis.results.trials import Answer, of_trial, summary
from gplfd_experiments.studies.trials.protocol import TRIALS
from gplfd_experiments.studies.trials.records import Contrast, Side

FORCE = "person_force_peak"
POLICIES = {"kmp": 20.0, "gp": 30.0, "hinge-fit": 40.0, "gp-constant-100": 50.0}


@pytest.fixture
def episodes(write_study: Callable, episode_result: Callable) -> Callable[..., Any]:
    """Episodes of the trial `person`, eight seeds of each policy and level."""

    def read(measure: str = FORCE, **values: Any) -> Any:
        noise = np.random.default_rng(0).normal(0.0, 1.0, 8)
        results = []
        for policy, typical in POLICIES.items():
            for level in TRIALS["person"].levels:
                for seed in range(8):
                    one = episode_result(policy, seed, trial="person", level=level)
                    own = values.get(policy.replace("-", "_"), typical + noise)
                    one["metrics"][measure] = own[seed]
                    results.append(one)
        study = write_study(results)
        return study, of_trial(read_results(study).episodes, "person")

    return read


def rows_of(axes: Axes) -> list[str]:
    return [label.get_text() for label in axes.get_yticklabels()]


def drawn(axes: Axes, row: int) -> list[np.ndarray]:
    """x of everything drawn in a row: dots, interval, mark."""
    lines = [line for line in axes.lines if set(np.asarray(line.get_ydata())) == {row}]
    return [np.asarray(line.get_xdata(), float) for line in lines]


def test_rows_are_those_of_the_table_with_its_numbers(episodes: Callable) -> None:
    _, found = episodes()
    levels = ordered(TRIALS["person"], found)
    figure = deciding_numbers(levels, FORCE, "gp")
    assert len(figure.axes) == 2
    table = [row[0] for row in trial_table(TRIALS["person"], levels).rows]
    assert table[0] == "**holds the hand**"
    for axes, level in zip(figure.axes, levels, strict=True):
        assert axes.get_title(loc="left") == level
        assert rows_of(axes) == ["kmp", "gp", "hinge-fit", "gp-constant-100"]
    top = figure.axes[0]
    assert [name.split("`")[1] for name in table[1:5]] == rows_of(top)
    dots, interval, mark = drawn(top, 1)
    own = found["gp"]["holds the hand"]
    shown = summary(own, FORCE)
    assert sorted(dots) == sorted(one.metrics[FORCE] for one in own)
    assert interval.tolist() == [shown.low, shown.high]
    assert mark.tolist() == [shown.estimate]
    bold = [label.get_weight() == "bold" for label in top.get_yticklabels()]
    assert bold == [False, True, False, False]
    assert top.get_xlabel() == "" != figure.axes[1].get_xlabel()


def test_kinds_are_told_apart_by_their_marks(episodes: Callable) -> None:
    levels = ordered(TRIALS["person"], episodes()[1])
    figure = deciding_numbers(levels, FORCE, "gp")
    marks = [
        line.get_marker() for line in figure.axes[0].lines if len(line.get_xdata()) == 1
    ]
    assert [kind_of(policy) for policy in levels["in the way"]] == [
        "method",
        "method",
        "reference",
        "ablation",
    ]
    assert len(set(marks[-4:])) == 3
    (legend,) = figure.legends
    names = [text.get_text() for text in legend.get_texts()]
    assert names == ["learns", "lacks an idea", "learns nothing"]


def test_a_wide_range_of_forces_has_a_logarithmic_axis(episodes: Callable) -> None:
    levels = ordered(TRIALS["person"], episodes()[1])
    assert deciding_numbers(levels, FORCE, "gp").axes[0].get_xscale() == "linear"
    _, found = episodes(kmp=np.full(8, 1.0))
    levels = ordered(TRIALS["person"], found)
    assert deciding_numbers(levels, FORCE, "gp").axes[0].get_xscale() == "log"


def test_who_has_no_number_has_a_row_that_says_so(episodes: Callable) -> None:
    levels = ordered(TRIALS["person"], episodes(kmp=[None] * 8)[1])
    axes = deciding_numbers(levels, FORCE, "gp").axes[0]
    assert rows_of(axes)[-1] == "kmp"
    assert [text.get_text() for text in axes.texts] == ["no number"]
    assert drawn(axes, 3) == []


def test_equal_seeds_are_a_larger_dot(episodes: Callable) -> None:
    held = [True] * 6 + [False] * 2
    levels = ordered(TRIALS["person"], episodes("success", gp=held)[1])
    axes = deciding_numbers(levels, "success", "gp").axes[0]
    row = rows_of(axes).index("gp")
    lines = [line for line in axes.lines if set(np.asarray(line.get_ydata())) == {row}]
    sizes = {float(line.get_xdata()[0]): line.get_markersize() for line in lines[:2]}
    assert sizes[1.0] / sizes[0.0] == pytest.approx(math.sqrt(3.0))


def answer(policy: str, low: float, high: float, measure: str = FORCE) -> Answer:
    shift = Shift(estimate=0.5 * (low + high), low=low, high=high, n=20)
    sides = {"having": Side(policy="gp"), "lacking": Side(policy=policy)}
    contrast = Contrast(idea="softness", measure=measure, **sides)
    return Answer(contrast=contrast, shift=shift)


def test_what_helps_is_on_the_right_and_first() -> None:
    own = [
        answer("a", 5.0, 9.0),
        answer("b", -3.0, 2.0),
        answer("c", -9.0, -5.0),
        answer("d", 0.1, 0.3, "success"),
    ]
    figure = ideas({"person": own})
    share, force = figure.axes
    assert rows_of(share) == ["person: softness (d)"]
    assert [name[-2] for name in rows_of(force)] == ["c", "b", "a"]
    for axes in (share, force):
        left, right = axes.get_xlim()
        assert left == -right
    assert force.get_xlim()[0] > 0.0 > share.get_xlim()[0]
    marks = [
        (line.get_marker(), line.get_markerfacecolor())
        for line in force.lines
        if len(line.get_xdata()) == 1
    ]
    shown, open_, harm = marks
    assert len({shapes for shapes, _ in marks}) == 2
    assert shown[0] == open_[0] != harm[0]
    assert open_[1] == "white" != shown[1]


def test_a_contrast_without_numbers_is_left_out_and_without_interval_is_a_point() -> (
    None
):
    few = answer("a", -math.inf, math.inf)
    few = Answer(
        contrast=few.contrast,
        shift=Shift(estimate=2.0, low=-math.inf, high=math.inf, n=2),
    )
    none = Answer(contrast=few.contrast, shift=None)
    (axes,) = ideas({"person": [few, none]}).axes
    assert len(rows_of(axes)) == 1
    assert [x.tolist() for x in drawn(axes, 0)] == [[2.0]]


def test_the_report_has_them_in_their_sections(episodes: Callable) -> None:
    study, _ = episodes()
    document = report(read_results(study), study, study, "gp")
    names = [picture.name for picture in document.pictures]
    assert names == ["trials_ideas", "trial_person"]
    with style.paper_style():
        for picture in document.pictures:
            picture.draw().draw_without_rendering()
