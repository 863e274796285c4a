"""Plots of a report: a panel per policy on common axes, rows of dots, trials."""

import math
import statistics
from collections.abc import Iterable, Mapping, Sequence
from operator import attrgetter
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    LEARNING_HEADLINES,
    LEARNING_MEASURES,
    Runs,
    door_name,
    grouped,
)
from gplfd_experiments.analysis.results.reading import (
    NON_STANDARD,
    EpisodeResult,
    LearningTestResult,
    RecordedResult,
)
from gplfd_experiments.analysis.results.statistics import Rate, Shift, success_rate
from gplfd_experiments.analysis.results.trials import (
    Answer,
    Verdict,
    seed_means,
    summary,
)
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII
from gplfd_policies.registry.catalogue import POLICIES

LeftOut = LearningTestResult | RecordedResult

Panels = dict[str, tuple[Axes, str, list[tuple[float, float]]]]
"""Panel, colour and curve of each policy."""
Look = Mapping[str, Any]
"""Keyword arguments of an artist."""

_FAINT: Final[Look] = {"color": "#c9b3dd", "linewidth": 2.2, "zorder": 1.5}
"""Style of the reference in the panels of others."""
_GRID: Final = "#e6e9ee"
_BAR: Final[Look] = {"linewidth": 2.6, "alpha": 0.3, "zorder": 2}
_DOTS: Final[Look] = {
    "marker": "o",
    "linestyle": "none",
    "ms": 1.8,
    "mew": 0,
    "alpha": 0.35,
    "zorder": 2,
}
"""Style of single episodes."""
_FEWEST, _MOST = 3, 5
"""Number of panels in a row."""
_PANEL_ROW, _MARGIN = 1.35, 0.55
"""Height of a row of panels, and of labels around them [inch]."""
_LONGEST: Final = 26
"""Characters of a name that fit above a panel."""

_KINDS: Final[Mapping[str, tuple[str, Look]]] = {
    "method": ("learns", {"marker": "o", "color": style.DOORS[1]}),
    "ablation": ("lacks an idea", {"marker": "D", "color": style.AXIS_X}),
    "reference": (
        "learns nothing",
        {"marker": "s", "color": style.MARK, "mfc": "white"},
    ),
    "own": ("own policy", {"marker": "^", "color": style.TRUTH}),
}
_VERDICTS: Final[Mapping[Verdict, tuple[str, Look]]] = {
    "shows": ("better with the idea", {"marker": "o", "color": style.TRUTH}),
    "open": (
        "no significant difference",
        {"marker": "o", "color": style.MARK, "mfc": "white"},
    ),
    "harms": ("worse with the idea", {"marker": "X", "color": style.LIMIT}),
}
_POINT: Final[Look] = {"linestyle": "none", "ms": 4.5, "zorder": 4}
_DOT: Final = 2.4
"""Diameter of a seed's dot [pt]; √n times as large for n equal values."""
_TRIAL_ROW, _BESIDE_ROWS = 0.15, 0.45
"""Height of a row, and of a panel's title or its axis [inch]."""
_WIDE: Final = 20.0
"""Ratio of greatest and smallest value from which a scale is logarithmic."""


def success_by_radius(runs: Runs, reference: str) -> Figure:
    """Draw the rate of doors opened to 60 degrees over the handle's radius."""
    figure, panels = _panels(runs, reference, "radius [m]", "opened to 60°")
    for policy, (axes, tint, points) in panels.items():
        _radius_axis(axes, runs)
        axes.set(ylim=(-0.05, 1.05), yticks=[0.0, 0.5, 1.0])
        for radius, here in _doors(runs[policy]):
            rate = success_rate((one.task.seed, one.opened()) for one in here)
            points.append((radius, rate.estimate))
            axes.plot([radius] * 2, [rate.low, rate.high], color=tint, **_BAR)
    _draw_curves(panels, reference)
    return figure


def force_by_radius(runs: Runs, reference: str) -> Figure:
    """Draw the peak radial force of opened doors over the radius: dots and median."""
    measure = EPISODE_MEASURES["force_radial_peak"]
    figure, panels = _panels(runs, reference, "radius [m]", "peak radial force [N]")
    for policy, (axes, tint, points) in panels.items():
        _radius_axis(axes, runs)
        axes.axhline(ADA_FORCE, color=style.LIMIT, linewidth=0.8, linestyle="--")
        log_scale(axes, "y")
        dots = []
        for radius, here in _doors(runs[policy]):
            forces = measure.values(here)
            dots += [(radius, force) for force in forces]
            if forces:
                points.append((radius, statistics.median(forces)))
        if dots:
            axes.plot(*zip(*dots, strict=True), color=tint, **_DOTS)
    _draw_curves(panels, reference, "none opened")
    return figure


def forecast_by_progress(runs: Runs, reference: str) -> Figure:
    """Draw the forecast error of the rest over progress: median and middle half."""
    figure, panels = _panels(runs, reference, "door angle / final angle", "error [mm]")
    for policy, (axes, tint, points) in panels.items():
        axes.set_xlim(0.0, 1.0)
        axes.set_xticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])
        log_scale(axes, "y")
        errors: dict[float, list[float]] = {}
        for one in runs[policy]:
            angles = one.metrics["forecast_progress"]
            for at, error in zip(angles, one.metrics["forecast_error_mm"], strict=True):
                if error is not None:
                    errors.setdefault(at, []).append(error)
        if errors:
            steps = sorted(errors)
            quartiles = [np.percentile(errors[at], (25, 50, 75)) for at in steps]
            low, middle, high = np.transpose(quartiles)
            style.band(axes, np.array(steps), low, high, tint)
            points.extend(zip(steps, middle, strict=True))
    _draw_curves(panels, reference, "no forecast")
    return figure


def coverage(runs: Mapping[str, Sequence[LeftOut]], reference: str) -> Figure:
    """Draw the measured coverage of intervals over the nominal coverage."""
    figure, panels = _panels(runs, reference, "nominal share", "measured share")
    for policy, (axes, _, points) in panels.items():
        axes.plot([0.0, 1.0], [0.0, 1.0], color=style.MARK, linewidth=0.7)
        axes.set(xlim=(0.4, 1.02), ylim=(-0.02, 1.04), yticks=[0.0, 0.5, 1.0])
        axes.set_xticks([0.5, 0.9], labels=["0.5", "0.9"])
        for level in (50, 90, 95):
            share = LEARNING_MEASURES[f"coverage_{level}"].median(runs[policy])
            if share is not None:
                points.append((level / 100.0, share))
    _draw_curves(panels, reference, "no uncertainty")
    return figure


def prediction_scores(runs: Mapping[str, Sequence[LeftOut]]) -> Figure:
    """Draw likelihood and errors of predictions: dots are tests, bars medians."""
    kinds = sorted({_left_out(one) for own in runs.values() for one in own})
    tints = dict(zip(kinds, (style.DOORS[1], style.AXIS_X), strict=False))
    lifts = {kind: 0.32 * (n - 0.5 * (len(kinds) - 1)) for n, kind in enumerate(kinds)}
    position = LEARNING_MEASURES["rmse_position_m"]

    def error(policy: str) -> tuple[float, str]:
        middle = position.median(runs[policy])
        return math.inf if middle is None else middle, policy

    order = sorted(runs, key=error, reverse=True)
    figure = style.new_figure(style.PAGE, 0.24 * len(runs) + 0.75)
    panels = figure.subplots(1, len(LEARNING_HEADLINES), sharey=True, squeeze=False)[0]
    for axes, name in zip(panels, LEARNING_HEADLINES, strict=True):
        measure = LEARNING_MEASURES[name]
        for row, policy in enumerate(order):
            for kind in kinds:
                own = (one for one in runs[policy] if _left_out(one) == kind)
                if values := measure.values(own):
                    height, tint = row + lifts[kind], tints[kind]
                    look = {"ms": 2.2, "color": tint, "alpha": 0.35, "mew": 0}
                    axes.plot(values, [height] * len(values), "o", **look)
                    middle = [float(np.median(values))]
                    axes.plot(middle, [height], "|", ms=8, mew=1.8, color=tint)
        axes.set_xlabel(measure.column)
        axes.set_yticks(range(len(order)), labels=map(short, order), parse_math=False)
        axes.grid(axis="y", color=_GRID, linewidth=0.5)
        if name != "nlpd":
            log_scale(axes, "x")
    for kind, tint in tints.items():
        panels[0].plot([], [], "o", ms=3.5, color=tint, label=f"{kind} left out")
    figure.legend(loc="outside upper left", ncols=2)
    return figure


def _left_out(one: LeftOut) -> str:
    return one.task.held_out if isinstance(one, LearningTestResult) else "recording"


def _doors(own: Iterable[EpisodeResult]) -> list[tuple[float, list[EpisodeResult]]]:
    """Return episodes of standard doors by mean radius, a group per door."""
    standard = (one for one in own if one.split != NON_STANDARD or one.drawn)
    doors = grouped(sorted(standard, key=attrgetter("radius")), door_name)
    return [
        (sum(one.radius for one in here) / len(here), here) for here in doors.values()
    ]


def _radius_axis(axes: Axes, runs: Runs) -> None:
    radii = [one.radius for own in runs.values() for one in own]
    low, high = min(*radii, *DEMONSTRATED_RADII), max(*radii, *DEMONSTRATED_RADII)
    axes.set_xlim(low - 0.02, high + 0.02)
    for radius in DEMONSTRATED_RADII:
        axes.axvspan(radius - 0.008, radius + 0.008, color=style.SEEN, linewidth=0)
    axes.set_xticks(DEMONSTRATED_RADII, labels=[f"{r:g}" for r in DEMONSTRATED_RADII])


def _panels(
    policies: Iterable[str], reference: str, xlabel: str, ylabel: str
) -> tuple[Figure, Panels]:
    """Return a figure with a panel per policy, on common axes."""
    names = list(policies)
    n_rows = -(-len(names) // _MOST)
    columns = max(_FEWEST, -(-len(names) // n_rows))
    figure = style.new_figure(style.PAGE, _PANEL_ROW * n_rows + _MARGIN)
    grid = figure.subplots(n_rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(names) :]:
        axes.set_visible(False)
    panels: Panels = {}
    for place, (axes, policy) in enumerate(zip(grid.flat, names, strict=False)):
        tint = style.ADAPTED if policy == reference else style.DOORS[1]
        axes.set_title(short(policy), loc="left", color=tint, parse_math=False)
        if place + columns >= len(names):
            axes.tick_params(labelbottom=True)
        panels[policy] = axes, tint, []
    figure.supxlabel(xlabel, fontsize=7.0)
    figure.supylabel(ylabel, fontsize=7.0)
    return figure, panels


def _draw_curves(
    panels: Panels, reference: str, without: str = "", marker: str = "o"
) -> None:
    """Draw the curve of each panel, and the reference's curve pale behind it."""
    faint = panels[reference][2] if reference in panels else []
    for policy, (axes, tint, points) in panels.items():
        if faint and policy != reference:
            axes.plot(*zip(*faint, strict=True), **_FAINT)
        if points:
            line: Look = {"color": tint, "marker": marker, "ms": 2.6, "zorder": 3}
            axes.plot(*zip(*points, strict=True), **line)
        else:
            look: Look = {"ha": "center", "va": "center", "color": style.MARK}
            where = axes.transAxes
            axes.text(0.5, 0.5, without, transform=where, fontsize=6.5, **look)


def short(policy: str) -> str:
    """Return a name, shortened from the left to fit above a panel."""
    return policy if len(policy) <= _LONGEST else f"…{policy[1 - _LONGEST :]}"


def log_scale(axes: Axes, which: Literal["x", "y"]) -> None:
    """Set a logarithmic axis with ticks at 1, 3, 10, 30 ... as plain numbers."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def kind_of(policy: str) -> str:
    """Return the kind of a policy: method, ablation, reference or own."""
    return POLICIES[policy].kind if policy in POLICIES else "own"


def deciding_numbers(
    levels: Mapping[str, Runs], measure: str, reference: str
) -> Figure:
    """Draw a row per policy and level: seeds, typical value and its interval."""
    figure, panels = _stacked([len(own) for own in levels.values()], shared=True)
    values: list[float] = []
    for axes, (level, own) in zip(panels, levels.items(), strict=True):
        if len(levels) > 1:
            axes.set_title(level, loc="left", parse_math=False)
        _name_rows(axes, [short(policy) for policy in own])
        for row, (policy, episodes) in enumerate(own.items()):
            found = summary(episodes, measure)
            if found is None:
                where = axes.get_yaxis_transform()
                look: dict[str, Any] = {"color": style.MARK, "fontsize": 6.0}
                axes.text(0.01, row, "no number", transform=where, va="center", **look)
            else:
                _, mark = _KINDS[kind_of(policy)]
                means = seed_means(episodes, measure)
                values += means
                places, counts = np.unique(means, return_counts=True)
                for count in np.unique(counts):
                    here = places[counts == count]
                    dot = {"ms": _DOT * math.sqrt(count), "color": mark["color"]}
                    dot |= {"mew": 0, "alpha": 0.3, "zorder": 2}
                    axes.plot(here, np.full(here.size, row), "o", **dot)
                _point(axes, row, found, mark)
            if policy == reference:
                axes.get_yticklabels()[row].set(color=style.ADAPTED, weight="bold")
                axes.axhspan(row - 0.5, row + 0.5, color=style.SEEN, zorder=0)
    if values and min(values) > 0.0 and max(values) > _WIDE * min(values):
        log_scale(panels[0], "x")
    panels[-1].set_xlabel(EPISODE_MEASURES[measure].title)
    kinds = {kind_of(policy) for own in levels.values() for policy in own}
    _legend(figure, (look for kind, look in _KINDS.items() if kind in kinds))
    return figure


def ideas(answers: Mapping[str, Sequence[Answer]]) -> Figure:
    """Draw contrasts' differences with their intervals, a panel per measure."""
    groups: dict[str, list[tuple[str, Shift, Verdict]]] = {}
    for trial, own in answers.items():
        for answer in own:
            if answer.shift is not None:
                contrast = answer.contrast
                label = f"{trial}: {contrast.idea} ({contrast.lacking})"
                rows = groups.setdefault(contrast.measure, [])
                rows.append((label, answer.shift, answer.verdict))
    held = {
        measure: groups[measure] for measure in EPISODE_MEASURES if measure in groups
    }
    figure, panels = _stacked([len(rows) for rows in held.values()], shared=False)
    for axes, (measure, rows) in zip(panels, held.items(), strict=True):
        # The most helpful idea first.
        sign = EPISODE_MEASURES[measure].sign
        rows.sort(key=lambda row: sign * row[1].estimate, reverse=True)
        _name_rows(axes, [label for label, _, _ in rows])
        for place, (_, found, verdict) in enumerate(rows):
            _point(axes, place, found, _VERDICTS[verdict][1])
        axes.axvline(0.0, color=style.MARK, linewidth=0.8, zorder=1)
        # Zero in the middle, and better values on the right, in all panels.
        end = max(map(abs, axes.get_xlim()))
        axes.set_xlim(-sign * end, sign * end)
        axes.set_xlabel(f"{EPISODE_MEASURES[measure].title}: with − without")
    panels[0].set_title("← worse with the idea", loc="left")
    panels[0].set_title("better with the idea →", loc="right")
    _legend(figure, _VERDICTS.values())
    return figure


def _point(axes: Axes, row: int, found: Rate | Shift, look: Look) -> None:
    """Draw an estimate on its interval."""
    if math.isfinite(found.low):
        ends = [found.low, found.high]
        axes.plot(ends, [row, row], color=look["color"], linewidth=1.4, zorder=3)
    axes.plot([found.estimate], [row], **_POINT, **look)


def _stacked(rows: Sequence[int], *, shared: bool) -> tuple[Figure, list[Axes]]:
    """Return panels below each other, with heights proportional to their rows."""
    height = _TRIAL_ROW * sum(rows) + _BESIDE_ROWS * (len(rows) + 1)
    figure = style.new_figure(style.PAGE, height)
    grid = figure.subplots(
        len(rows), 1, sharex=shared, squeeze=False, height_ratios=rows
    )
    return figure, list(grid[:, 0])


def _name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Label rows from the top down, on fine lines."""
    axes.set_yticks(range(len(names)), labels=names, parse_math=False)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="y", color=_GRID, linewidth=0.5)
    axes.set_axisbelow(True)


def _legend(figure: Figure, looks: Iterable[tuple[str, Look]]) -> None:
    marks = {name: style.legend_line(linestyle="none", **look) for name, look in looks}
    style.legend_above(figure, marks)
