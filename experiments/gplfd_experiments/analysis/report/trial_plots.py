"""Plots of trials: a trial's deciding number, and all contrasts together."""

import math
from collections.abc import Mapping, Sequence
from typing import Any, Final

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from gplfd_experiments.analysis.figures import style
from gplfd_experiments.analysis.report.plots import log_scale, short
from gplfd_experiments.analysis.results.grouping import Runs
from gplfd_experiments.analysis.results.statistics import Rate, Shift
from gplfd_experiments.analysis.results.trials import (
    Answer,
    Verdict,
    seed_means,
    summary,
)
from gplfd_experiments.studies.trials.records import MEASURES
from gplfd_policies.registry.catalogue import POLICIES

_KINDS: Final[Mapping[str, tuple[str, dict[str, Any]]]] = {
    "method": ("learns", {"marker": "o", "color": style.DOORS[1]}),
    "ablation": ("lacks an idea", {"marker": "D", "color": style.AXIS_X}),
    "reference": (
        "learns nothing",
        {"marker": "s", "color": style.MARK, "mfc": "white"},
    ),
    "own": ("own policy", {"marker": "^", "color": style.TRUTH}),
}
_VERDICTS: Final[Mapping[Verdict, tuple[str, dict[str, Any]]]] = {
    "shows": ("better with the idea", {"marker": "o", "color": style.TRUTH}),
    "open": (
        "no significant difference",
        {"marker": "o", "color": style.MARK, "mfc": "white"},
    ),
    "harms": ("worse with the idea", {"marker": "X", "color": style.LIMIT}),
}
_POINT: Final[dict[str, Any]] = {"linestyle": "none", "ms": 4.5, "zorder": 4}
_DOT: Final = 2.4
"""Diameter of a seed's dot [pt]; of n at one place, √n times as much."""
_ROW: Final = 0.15
"""Height of a row [inch]."""
_BESIDE_ROWS: Final = 0.45
"""Height of a panel's title or its axis [inch]."""
_WIDE: Final = 20.0
"""Greatest over smallest value from which on a scale is logarithmic."""


def kind_of(policy: str) -> str:
    """Return method, ablation, reference or own."""
    return POLICIES[policy].kind if policy in POLICIES else "own"


def deciding_numbers(
    levels: Mapping[str, Runs], measure: str, reference: str
) -> Figure:
    """Draw a row per policy and level: seeds, typical value and its interval.

    Args:
        levels: Episodes by level and policy, both in the order of the rows.
        measure: What decides the trial, one of `MEASURES`.
        reference: Policy that is highlighted.
    """
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
    panels[-1].set_xlabel(MEASURES[measure][0])
    kinds = {kind_of(policy) for own in levels.values() for policy in own}
    _legend(figure, [look for kind, look in _KINDS.items() if kind in kinds])
    return figure


def ideas(answers: Mapping[str, Sequence[Answer]]) -> Figure:
    """Draw every contrast's difference with its interval, a panel per measure.

    To the right of zero the idea helps, whatever the measure.

    Args:
        answers: By trial; those without a number are left out.
    """
    groups: dict[str, list[tuple[str, Shift, Verdict]]] = {}
    for trial, own in answers.items():
        for answer in own:
            if answer.shift is not None:
                contrast = answer.contrast
                label = f"{trial}: {contrast.idea} ({contrast.lacking})"
                rows = groups.setdefault(contrast.measure, [])
                rows.append((label, answer.shift, answer.verdict))
    held = {measure: groups[measure] for measure in MEASURES if measure in groups}
    figure, panels = _stacked([len(rows) for rows in held.values()], shared=False)
    for axes, (measure, rows) in zip(panels, held.items(), strict=True):
        # The most helpful idea first.
        less = MEASURES[measure][1] == "less"
        sign = -1.0 if less else 1.0
        rows.sort(key=lambda row: sign * row[1].estimate, reverse=True)
        _name_rows(axes, [label for label, _, _ in rows])
        for place, (_, found, verdict) in enumerate(rows):
            _point(axes, place, found, _VERDICTS[verdict][1])
        axes.axvline(0.0, color=style.MARK, linewidth=0.8, zorder=1)
        # Zero in the middle, and what is better to its right, in all panels.
        end = max(map(abs, axes.get_xlim()))
        axes.set_xlim((end, -end) if less else (-end, end))
        axes.set_xlabel(f"{MEASURES[measure][0]}: with − without")
    panels[0].set_title("← worse with the idea", loc="left")
    panels[0].set_title("better with the idea →", loc="right")
    _legend(figure, list(_VERDICTS.values()))
    return figure


def _point(axes: Axes, row: int, found: Rate | Shift, look: dict[str, Any]) -> None:
    """Draw an estimate on its interval."""
    if math.isfinite(found.low):
        ends = [found.low, found.high]
        axes.plot(ends, [row, row], color=look["color"], linewidth=1.4, zorder=3)
    axes.plot([found.estimate], [row], **_POINT, **look)


def _stacked(rows: Sequence[int], *, shared: bool) -> tuple[Figure, list[Axes]]:
    """Panels below each other, as high as their rows are many."""
    height = _ROW * sum(rows) + _BESIDE_ROWS * (len(rows) + 1)
    figure = style.new_figure(style.PAGE, height)
    grid = figure.subplots(
        len(rows), 1, sharex=shared, squeeze=False, height_ratios=rows
    )
    return figure, list(grid[:, 0])


def _name_rows(axes: Axes, names: Sequence[str]) -> None:
    """Name rows from the top down, on fine lines."""
    axes.set_yticks(range(len(names)), labels=names, parse_math=False)
    axes.set_ylim(len(names) - 0.5, -0.5)
    axes.grid(axis="y", color="#e6e9ee", linewidth=0.5)
    axes.set_axisbelow(True)


def _legend(figure: Figure, looks: Sequence[tuple[str, dict[str, Any]]]) -> None:
    handles = {}
    for name, look in looks:
        kept = {key: value for key, value in look.items() if key != "color"}
        handles[name] = style.legend_line(look["color"], "none", **kept)
    style.legend_above(figure, handles)
