"""Plots of a study."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Final

import numpy as np

from experiments.figures import style
from experiments.report.panels import (
    bar,
    colour,
    dots,
    line,
    log_scale,
    say,
    small_multiples,
)
from experiments.results.grouping import by_policy, places
from experiments.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    SKILL_MEASURES,
    median,
)
from experiments.results.records import Episode, LearningTest, Outcome
from experiments.results.table import wilson_interval
from experiments.teacher import DEMONSTRATED_RADII

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

LEVELS: Final = (50, 90, 95)
"""Nominal coverages with a measured one [%]."""


def success_by_radius(runs: Mapping[str, Sequence[Episode]]) -> Figure:
    """Rate of doors opened to 60 degrees over the handle's radius."""

    def draw(axes: Axes, policy: str, faint: bool) -> None:
        points = [
            (radius, sum(e.opened() for e in own), len(own))
            for radius, own in _by_radius(runs[policy])
        ]
        if not points:
            return
        radii = [radius for radius, _, _ in points]
        rates = [wins / n for _, wins, n in points]
        if not faint:
            for radius, wins, n in points:
                axes.plot([radius] * 2, wilson_interval(wins, n), **bar(policy))
        axes.plot(radii, rates, **line(policy, faint))

    def prepare(axes: Axes) -> None:
        _radius_axis(axes, runs)
        axes.set_ylim(-0.05, 1.05)
        axes.set_yticks([0.0, 0.5, 1.0])

    return small_multiples(runs, draw, prepare, "radius [m]", "opened to 60°")


def force_by_radius(runs: Mapping[str, Sequence[Episode]]) -> Figure:
    """Peak radial force of opened doors over the handle's radius: all and median."""
    measure = EPISODE_MEASURES["radial"]

    def draw(axes: Axes, policy: str, faint: bool) -> None:
        points = [
            (radius, force)
            for radius, own in _by_radius(runs[policy])
            for e in own
            if (force := measure.of(e)) is not None
        ]
        middles = [
            (radius, middle)
            for radius, own in _by_radius(runs[policy])
            if (middle := median(map(measure.of, own))) is not None
        ]
        if not middles:
            if not faint:
                say(axes, "none opened")
            return
        if not faint:
            axes.plot(*zip(*points, strict=True), **dots(policy))
        axes.plot(*zip(*middles, strict=True), **line(policy, faint))

    def prepare(axes: Axes) -> None:
        _radius_axis(axes, runs)
        axes.axhline(ADA_FORCE, color=style.LIMIT, linewidth=0.8, linestyle="--")
        log_scale(axes, "y")

    return small_multiples(runs, draw, prepare, "radius [m]", "peak radial force [N]")


def forecast_by_progress(runs: Mapping[str, Sequence[Episode]]) -> Figure:
    """Error of the forecast of the rest over progress: median and middle half."""

    def curve(policy: str) -> tuple[list[float], list[list[float]]]:
        errors: dict[float, list[float]] = {}
        for one in runs[policy]:
            progress = one.numbers("forecast_progress")
            measured = one.numbers("forecast_error_mm")
            for at, error in zip(progress, measured, strict=False):
                if at is not None and error is not None:
                    errors.setdefault(at, []).append(error)
        steps = sorted(errors)
        return steps, [errors[at] for at in steps]

    def draw(axes: Axes, policy: str, faint: bool) -> None:
        steps, errors = curve(policy)
        if not steps:
            if not faint:
                say(axes, "no forecast")
            return
        low, middle, high = (
            [float(np.percentile(each, q)) for each in errors] for q in (25, 50, 75)
        )
        if not faint:
            style.band(
                axes, np.array(steps), np.array(low), np.array(high), colour(policy)
            )
        axes.plot(steps, middle, **line(policy, faint))

    def prepare(axes: Axes) -> None:
        axes.set_xlim(0.0, 1.0)
        axes.set_xticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])
        log_scale(axes, "y")

    return small_multiples(
        runs, draw, prepare, "door angle / final angle", "error [mm]"
    )


def coverage(runs: Mapping[str, Sequence[LearningTest]]) -> Figure:
    """Share of left-out numbers inside intervals of a nominal share."""

    def measured(policy: str) -> list[tuple[float, float]]:
        points = []
        for level in LEVELS:
            of = SKILL_MEASURES[f"coverage_{level}"].of
            share = median(map(of, runs[policy]))
            if share is not None:
                points.append((level / 100.0, share))
        return points

    def draw(axes: Axes, policy: str, faint: bool) -> None:
        points = measured(policy)
        if points:
            axes.plot(*zip(*points, strict=True), **line(policy, faint))
        elif not faint:
            say(axes, "no uncertainty")

    def prepare(axes: Axes) -> None:
        axes.plot([0.0, 1.0], [0.0, 1.0], color=style.MARK, linewidth=0.7)
        axes.set_xlim(0.4, 1.02)
        axes.set_ylim(-0.02, 1.04)
        axes.set_xticks([0.5, 0.9], labels=["0.5", "0.9"])
        axes.set_yticks([0.0, 0.5, 1.0])

    return small_multiples(runs, draw, prepare, "nominal share", "measured share")


def skill_scores(tests: Sequence[LearningTest]) -> Figure:
    """Likelihood and errors of predictions: a dot per seed, a bar at the median."""
    runs = by_policy(tests)
    kinds = sorted({one.held_out for one in tests})
    names = ("nlpd", "rmse_position", "rmse_rotation")
    best_first = sorted(
        runs, key=lambda policy: (_middle(runs[policy], names[1]), policy), reverse=True
    )
    figure = style.new_figure(style.PAGE, 0.24 * len(runs) + 0.75)
    panels = figure.subplots(1, len(names), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, names, strict=True):
        measure = SKILL_MEASURES[name]
        for row, policy in enumerate(best_first):
            for kind, lift in zip(kinds, _lifts(len(kinds)), strict=True):
                _row_of_dots(
                    axes,
                    row + lift,
                    [measure.of(one) for one in runs[policy] if one.held_out == kind],
                    style.DOORS[1] if kind == kinds[0] else style.AXIS_X,
                )
        axes.set_xlabel(measure.title)
        axes.set_yticks(range(len(best_first)), labels=best_first)
        axes.grid(axis="y", color="#e6e9ee", linewidth=0.5)
        if name != "nlpd":
            log_scale(axes, "x")
    for kind, tint in zip(kinds, (style.DOORS[1], style.AXIS_X), strict=False):
        panels[0].plot([], [], "o", ms=3.5, color=tint, label=f"{kind} left out")
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def _row_of_dots(
    axes: Axes, height: float, values: Sequence[float | None], tint: str
) -> None:
    known = [value for value in values if value is not None]
    if not known:
        return
    axes.plot(known, [height] * len(known), "o", ms=2.2, color=tint, alpha=0.35, mew=0)
    axes.plot([float(np.median(known))], [height], "|", ms=8, mew=1.8, color=tint)


def _lifts(count: int) -> list[float]:
    return [0.32 * (place - 0.5 * (count - 1)) for place in range(count)]


def _middle(own: Sequence[Outcome], name: str) -> float:
    value = median(map(SKILL_MEASURES[name].of, own))
    return math.inf if value is None else value


def _by_radius(own: Sequence[Episode]) -> list[tuple[float, list[Episode]]]:
    """Episodes on ordinary doors by their mean radius, a group per door."""
    groups = places([e for e in own if e.ordinary or e.drawn])
    return [
        (sum(e.radius for e in group) / len(group), group) for group in groups.values()
    ]


def _radius_axis(axes: Axes, runs: Mapping[str, Sequence[Episode]]) -> None:
    radii = [one.radius for own in runs.values() for one in own]
    low, high = min(*radii, *DEMONSTRATED_RADII), max(*radii, *DEMONSTRATED_RADII)
    axes.set_xlim(low - 0.02, high + 0.02)
    for radius in DEMONSTRATED_RADII:
        axes.axvspan(radius - 0.008, radius + 0.008, color=style.SEEN, linewidth=0)
    axes.set_xticks(DEMONSTRATED_RADII, labels=[f"{r:g}" for r in DEMONSTRATED_RADII])
