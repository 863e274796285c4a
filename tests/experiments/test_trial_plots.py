"""Plots of trials show the numbers of the tables, and which way is better."""

import dataclasses
import math

import numpy as np
import pytest

from gplfd_experiments.analysis.report.plots import deciding_numbers, ideas
from gplfd_experiments.analysis.report.sections import ordered, trial_section
from gplfd_experiments.analysis.results.reading import read_results
from gplfd_experiments.analysis.results.statistics import Shift
from gplfd_experiments.analysis.results.trials import MEASURES, Answer, of_trials
from gplfd_experiments.studies.trials.protocol import TRIALS, Contrast, Side

pytestmark = pytest.mark.slow

FORCE = "person_force_peak"
POLICIES = {"kmp": 20.0, "gp": 30.0, "hinge-fit": 40.0, "gp@constant-100": 50.0}
POLICIES["oracle"] = 60.0
TRIAL = TRIALS["person"]


@pytest.fixture
def results(write_study, episode_result):
    """Results of the trial `person`, eight seeds of each policy and level."""

    def read(measure=FORCE, **values):
        noise = np.random.default_rng(0).normal(0.0, 1.0, 8)
        made = []
        for policy, typical in POLICIES.items():
            own = values.get(policy, typical + noise)
            for level in TRIAL.levels:
                for seed in range(8):
                    one = episode_result(policy, seed, trial="person", level=level)
                    one["metrics"][measure] = own[seed]
                    made.append(one)
        return read_results(write_study(made))

    return read


@pytest.fixture
def levels(results):
    """The same by level and policy, in the order in which they are shown."""
    return lambda *measure, **values: ordered(
        TRIAL, of_trials(results(*measure, **values))["person"]
    )


def rows_of(axes):
    return [label.get_text() for label in axes.get_yticklabels()]


def drawn(axes, row):
    """x of everything drawn in a row: dots, interval, mark."""
    lines = (line for line in axes.lines if set(line.get_ydata()) == {row})
    return [np.asarray(line.get_xdata(), float) for line in lines]


def single(axes):
    """Points that are drawn alone."""
    return [line for line in axes.lines if len(line.get_xdata()) == 1]


def test_rows_are_those_of_the_table_with_its_numbers(levels):
    runs = levels()
    figure = deciding_numbers(runs, FORCE, "gp")
    table = [row[0] for row in trial_section("person", runs, "gp").blocks[1].rows]
    assert table[0] == "**holds the hand**"
    for axes, level in zip(figure.axes, runs, strict=True):
        assert axes.get_title(loc="left") == level
        assert rows_of(axes) == [*POLICIES]
    top, bottom = figure.axes
    assert [name.split("`")[1] for name in table[1:6]] == rows_of(top)
    dots, interval, mark = drawn(top, 1)
    episodes = runs["holds the hand"]["gp"]
    typical = MEASURES[FORCE].typical(episodes)
    assert sorted(dots) == sorted(episode.metrics[FORCE] for episode in episodes)
    assert interval.tolist() == [typical.low, typical.high]
    assert mark.tolist() == [typical.estimate]
    bold = [label.get_weight() == "bold" for label in top.get_yticklabels()]
    assert bold == [policy == "gp" for policy in POLICIES]
    assert top.get_xlabel() == "" != bottom.get_xlabel()
    # Kinds of policies are told apart by their marks.
    assert len({line.get_marker() for line in single(top)[-5:]}) == 4
    names = [text.get_text() for text in figure.legends[0].get_texts()]
    assert names == ["learns", "another pipeline", "learns nothing", "knows the door"]


def test_a_wide_range_is_logarithmic_and_who_has_no_number_says_so(levels):
    for values, scale in (({}, "linear"), ({"kmp": np.full(8, 1.0)}, "log")):
        axes = deciding_numbers(levels(**values), FORCE, "gp").axes[0]
        assert axes.get_xscale() == scale
    axes = deciding_numbers(levels(kmp=[None] * 8), FORCE, "gp").axes[0]
    assert rows_of(axes)[-1] == "kmp"
    assert [text.get_text() for text in axes.texts] == ["no number"]
    assert drawn(axes, 4) == []


def answer(policy, low, high, measure=FORCE):
    middle = 0.5 * (low + high) if math.isfinite(low) else 2.0
    sides = {"having": Side(policy="gp"), "lacking": Side(policy=policy)}
    contrast = Contrast(idea="softness", measure=measure, **sides)
    shift = Shift(estimate=middle, low=low, high=high)
    p_value = float(low <= 0.0 <= high)
    return Answer(contrast=contrast, shift=shift, p_value=p_value, changes={})


def test_what_helps_is_on_the_right_and_first():
    ends = {"a": (5.0, 9.0), "b": (-3.0, 2.0), "c": (-9.0, -5.0)}
    own = [answer(name, *interval) for name, interval in ends.items()]
    figure = ideas({"person": [*own, answer("d", 0.1, 0.3, "success")]})
    share, force = figure.axes
    assert rows_of(share) == ["person: softness (d)"]
    assert [name[-2] for name in rows_of(force)] == ["c", "b", "a"]
    for axes in (share, force):
        left, right = axes.get_xlim()
        assert left == -right
    assert force.get_xlim()[0] > 0.0 > share.get_xlim()[0]
    looks = [(one.get_marker(), one.get_markerfacecolor()) for one in single(force)]
    shown, open_, harm = looks
    assert shown[0] == open_[0] != harm[0]
    assert open_[1] == "white" != shown[1]


def test_a_contrast_without_numbers_is_left_out_and_without_interval_is_a_point():
    few = answer("a", -math.inf, math.inf)
    none = dataclasses.replace(few, shift=None)
    (axes,) = ideas({"person": [few, none]}).axes
    assert len(rows_of(axes)) == 1
    assert [x.tolist() for x in drawn(axes, 0)] == [[2.0]]
