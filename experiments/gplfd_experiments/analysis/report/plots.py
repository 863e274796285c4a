"""Plots of a report: a panel per policy on common axes, rows of dots, trials."""

import contextlib
import math
import statistics
from collections.abc import Iterable, Iterator, Mapping, Sequence
from operator import attrgetter
from typing import Any, Final, Literal

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.report.document import TOLD, kind_of
from gplfd_experiments.analysis.results.measures import (
    ADA_FORCE,
    EPISODE_MEASURES,
    Runs,
    grouped,
)
from gplfd_experiments.analysis.results.reading import NON_STANDARD, EpisodeResult
from gplfd_experiments.analysis.results.statistics import Estimate, Shift, success_rate
from gplfd_experiments.analysis.results.trials import MEASURES, Answer, Verdict
from gplfd_experiments.data.teacher import DEMONSTRATED_RADII

Look = Mapping[str, Any]  # Keyword arguments of an artist.
Panels = dict[str, tuple[Axes, str, list[tuple[float, float]]]]
"""Axes, colour and points of the curve of each policy."""

_FAINT: Final[Look] = {"color": "#c9b3dd", "linewidth": 2.2, "zorder": 1.5}
"""Style of the reference in the panels of others."""
_GRID: Final = "#e6e9ee"
_BAR: Final[Look] = {"linewidth": 2.6, "alpha": 0.3, "zorder": 2}
_DOTS: Final[Look] = {"linestyle": "none", "mew": 0, "alpha": 0.35, "zorder": 2}
_FEWEST, _MOST = 3, 5  # Number of panels in a row.
_PANEL_ROW, _TRIAL_ROW = 1.35, 0.15
"""Height of a row of panels, and of a row of dots [inch]."""

_DOT: Final[Look] = {"marker": "o"}
_TEXT: Final[Look] = {"color": style.MARK, "va": "center"}
_HOLLOW: Final[Look] = {"color": style.MARK, "mfc": "white"}
_KINDS: Final[Mapping[str, tuple[str, Look]]] = {
    "method": ("learns", {**_DOT, "color": style.DOORS[1]}),
    "ablation": ("another pipeline", {"marker": "D", "color": style.AXIS_X}),
    "reference": ("learns nothing", {"marker": "s", **_HOLLOW}),
    TOLD: ("knows the door", {"marker": "*", **_HOLLOW}),
    "own": ("own policy", {"marker": "^", "color": style.TRUTH}),
}
_VERDICTS: Final[Mapping[Verdict, tuple[str, Look]]] = {
    "shows": ("better with the idea", {**_DOT, "color": style.TRUTH}),
    "open": ("no significant difference", {**_DOT, **_HOLLOW}),
    "harms": ("worse with the idea", {"marker": "X", "color": style.LIMIT}),
}


@contextlib.contextmanager
def policy_panels(
    runs: Runs, reference: str, labels: tuple[str, str], without: str = ""
) -> Iterator[tuple[Figure, Panels]]:
    """Make a figure with a panel per policy on common axes, labelled x and y.

    In the end each curve is drawn, with that of the reference pale behind it, or the
    text ``without`` in a panel without a curve.
    """
    n_rows = -(-len(runs) // _MOST)
    columns = max(_FEWEST, -(-len(runs) // n_rows))
    size = style.PAGE, _PANEL_ROW * n_rows + 0.55
    figure = Figure(figsize=size, layout="constrained")
    grid = figure.subplots(n_rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(runs) :]:
        axes.set_visible(False)
    panels: Panels = {}
    for place, (axes, policy) in enumerate(zip(grid.flat, runs, strict=False)):
        tint = style.ADAPTED if policy == reference else style.DOORS[1]
        axes.set_title(short(policy), loc="left", color=tint, parse_math=False)
        if place + columns >= len(runs):
            axes.tick_params(labelbottom=True)
        panels[policy] = axes, tint, []
    figure.supxlabel(labels[0], fontsize=7.0)
    figure.supylabel(labels[1], fontsize=7.0)
    yield figure, panels
    faint = panels[reference][2] if reference in panels else []
    for policy, (axes, tint, points) in panels.items():
        if faint and policy != reference:
            axes.plot(*zip(*faint, strict=True), **_FAINT)
        if points:
            line: Look = {"color": tint, "marker": "o", "ms": 2.6, "zorder": 3}
            axes.plot(*zip(*points, strict=True), **line)
        else:
            look: Look = {"ha": "center", "transform": axes.transAxes, **_TEXT}
            axes.text(0.5, 0.5, without, fontsize=6.5, **look)


def success_by_radius(runs: Runs, reference: str) -> Figure:
    """Draw the rate of doors opened to 60 degrees over the handle's radius."""
    labels = "radius [m]", "opened to 60°"
    with policy_panels(runs, reference, labels) as (figure, panels):
        for policy, (axes, tint, points) in panels.items():
            doors = _doors(axes, runs, policy)
            axes.set(ylim=(-0.05, 1.05), yticks=[0.0, 0.5, 1.0])
            for radius, here in doors:
                rate = success_rate((e.task.seed, e.opened()) for e in here)
                points.append((radius, rate.estimate))
                axes.plot([radius] * 2, [rate.low, rate.high], color=tint, **_BAR)
    return figure


def force_by_radius(runs: Runs, reference: str) -> Figure:
    """Draw the peak radial force of opened doors over the radius: dots and median."""
    labels = "radius [m]", "peak radial force [N]"
    with policy_panels(runs, reference, labels, "none opened") as (figure, panels):
        for policy, (axes, tint, points) in panels.items():
            doors = _doors(axes, runs, policy)
            axes.axhline(ADA_FORCE, color=style.LIMIT, linewidth=0.8, linestyle="--")
            log_scale(axes, "y")
            for radius, here in doors:
                if forces := EPISODE_MEASURES["force_radial_peak"].values(here):
                    radii = [radius] * len(forces)
                    axes.plot(radii, forces, marker="o", ms=1.8, color=tint, **_DOTS)
                    points.append((radius, statistics.median(forces)))
    return figure


def forecast_by_progress(runs: Runs, reference: str) -> Figure:
    """Draw the forecast error of the rest over progress: median and middle half."""
    labels = "door angle / final angle", "error [mm]"
    with policy_panels(runs, reference, labels, "no forecast") as (figure, panels):
        for policy, (axes, tint, points) in panels.items():
            axes.set_xlim(0.0, 1.0)
            axes.set_xticks([0.0, 0.5, 1.0], labels=["0", "0.5", "1"])
            log_scale(axes, "y")
            errors: dict[float, list[float]] = {}
            for metrics in (episode.metrics for episode in runs[policy]):
                series = metrics["forecast_progress"], metrics["forecast_error_mm"]
                for progress, error in zip(*series, strict=True):
                    if error is not None:
                        errors.setdefault(progress, []).append(error)
            if errors:
                steps = sorted(errors)
                bands = [np.percentile(errors[step], (25, 50, 75)) for step in steps]
                low, middle, high = np.transpose(bands)
                axes.fill_between(steps, low, high, color=tint, **style.BAND)
                points.extend(zip(steps, middle, strict=True))
    return figure


def _doors(
    axes: Axes, runs: Runs, policy: str
) -> list[tuple[float, list[EpisodeResult]]]:
    """Return episodes at standard doors by mean radius, and scale the axis of radii."""
    radii = [episode.radius for group in runs.values() for episode in group]
    low, high = min(*radii, *DEMONSTRATED_RADII), max(*radii, *DEMONSTRATED_RADII)
    axes.set_xlim(low - 0.02, high + 0.02)
    for radius in DEMONSTRATED_RADII:
        axes.axvspan(radius - 0.008, radius + 0.008, color=style.SEEN, linewidth=0)
    axes.set_xticks(DEMONSTRATED_RADII, labels=[f"{r:g}" for r in DEMONSTRATED_RADII])
    standard = [e for e in runs[policy] if e.split != NON_STANDARD or e.drawn]
    doors = grouped(sorted(standard, key=attrgetter("radius")), "door")
    return [(sum(e.radius for e in here) / len(here), here) for here in doors.values()]


def short(policy: str) -> str:
    """Return a name, shortened from the left to the 26 characters above a panel."""
    return policy if len(policy) <= 26 else f"…{policy[-25:]}"


def log_scale(axes: Axes, which: Literal["x", "y"]) -> None:
    """Set a logarithmic axis with ticks at 1, 3, 10, 30 ... as plain numbers."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def deciding_numbers(
    levels: Mapping[str, Runs], measure: str, reference: str
) -> Figure:
    """Draw a row per policy and level: seeds, typical value and its interval."""
    names = [[short(policy) for policy in runs] for runs in levels.values()]
    figure, panels = _stacked(names, shared=True)
    values: list[float] = []
    for axes, (level, runs) in zip(panels, levels.items(), strict=True):
        if len(levels) > 1:
            axes.set_title(level, loc="left", parse_math=False)
        for row, (policy, episodes) in enumerate(runs.items()):
            estimate = MEASURES[measure].typical(episodes)
            if estimate is None:
                look: Look = {"transform": axes.get_yaxis_transform(), **_TEXT}
                axes.text(0.01, row, "no number", fontsize=6.0, **look)
            else:
                _, mark = _KINDS[kind_of(policy)]
                means = [*MEASURES[measure].seed_means(episodes).values()]
                values += means
                dots: Look = {"marker": "o", "ms": 2.4, "color": mark["color"]}
                axes.plot(means, [row] * len(means), **dots, **_DOTS)
                _point(axes, row, estimate, mark)
            if policy == reference:
                axes.get_yticklabels()[row].set(color=style.ADAPTED, weight="bold")
                axes.axhspan(row - 0.5, row + 0.5, color=style.SEEN, zorder=0)
    if values and min(values) > 0.0 and max(values) > 20.0 * min(values):
        log_scale(panels[0], "x")
    panels[-1].set_xlabel(MEASURES[measure].title)
    kinds = {kind_of(policy) for runs in levels.values() for policy in runs}
    _legend(figure, (look for kind, look in _KINDS.items() if kind in kinds))
    return figure


def ideas(answers: Mapping[str, Sequence[Answer]]) -> Figure:
    """Draw contrasts' differences with their intervals, a panel per measure."""
    groups: dict[str, list[tuple[str, Shift, Verdict]]] = {}
    for trial, of_trial in answers.items():
        for answer in of_trial:
            if answer.shift is not None:
                contrast = answer.contrast
                label = f"{trial}: {contrast.idea} ({contrast.lacking})"
                rows = groups.setdefault(contrast.measure, [])
                rows.append((label, answer.shift, answer.verdict))
    measures = [MEASURES[name] for name in MEASURES if name in groups]
    for measure in measures:
        # The most helpful idea first.
        rows = sorted(groups[measure.metric], key=lambda row: row[1].estimate)
        groups[measure.metric] = rows[:: -1 if measure.better == "more" else 1]
    labels = [[row[0] for row in groups[measure.metric]] for measure in measures]
    figure, panels = _stacked(labels, shared=False)
    for axes, measure in zip(panels, measures, strict=True):
        for place, (_, shift, verdict) in enumerate(groups[measure.metric]):
            _point(axes, place, shift, _VERDICTS[verdict][1])
        axes.axvline(0.0, color=style.MARK, linewidth=0.8, zorder=1)
        # Zero in the middle, and better values on the right, in all panels.
        end = max(map(abs, axes.get_xlim()))
        axes.set_xlim(-measure.sign * end, measure.sign * end)
        axes.set_xlabel(f"{measure.title}: with − without")
    panels[0].set_title("← worse with the idea", loc="left")
    panels[0].set_title("better with the idea →", loc="right")
    _legend(figure, _VERDICTS.values())
    return figure


def _point(axes: Axes, row: int, estimate: Estimate, look: Look) -> None:
    """Draw an estimate on its interval."""
    if math.isfinite(estimate.low):
        ends = [estimate.low, estimate.high]
        axes.plot(ends, [row, row], color=look["color"], linewidth=1.4, zorder=3)
    mark: Look = {"linestyle": "none", "ms": 4.5, "zorder": 4, **look}
    axes.plot([estimate.estimate], [row], **mark)


def _stacked(
    names: Sequence[Sequence[str]], *, shared: bool
) -> tuple[Figure, list[Axes]]:
    """Return panels below each other, with a named row on a fine line for each name."""
    rows = [*map(len, names)]
    height = _TRIAL_ROW * sum(rows) + 0.45 * (len(rows) + 1)
    figure = Figure(figsize=(style.PAGE, height), layout="constrained")
    options: dict[str, Any] = {"squeeze": False, "height_ratios": rows}
    panels = figure.subplots(len(rows), 1, sharex=shared, **options)[:, 0]
    for axes, labels in zip(panels, names, strict=True):
        axes.set_yticks(range(len(labels)), labels=labels, parse_math=False)
        axes.set_ylim(len(labels) - 0.5, -0.5)
        axes.grid(axis="y", color=_GRID, linewidth=0.5)
        axes.set_axisbelow(True)
    return figure, list(panels)


def _legend(figure: Figure, looks: Iterable[tuple[str, Look]]) -> None:
    marks = {name: style.legend_line(linestyle="none", **look) for name, look in looks}
    style.legend_above(figure, marks)
