"""A panel per policy on common axes, the champion's curve faintly in all of them."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any, Final, Literal

from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from experiments.figures import style
from experiments.report.verdicts import CHAMPION

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Draw = Callable[["Axes", str, bool], None]
"""Draws a policy into a panel; True: faintly, as what the others are compared with."""

COLUMNS: Final = 4
"""Panels in a row."""

_ROW: Final = 1.35
_MARGIN: Final = 0.55
_OWN: Final = style.DOORS[1]
_SOFT: Final = "#c9b3dd"
"""The champion in the panels of the others."""


def small_multiples(
    runs: Mapping[str, object],
    draw: Draw,
    prepare: Callable[[Axes], None],
    x: str,
    y: str,
) -> Figure:
    """Draw a panel per policy, the champion's curve faintly behind the others."""
    columns = min(COLUMNS, len(runs))
    n_rows = -(-len(runs) // columns)
    width = style.PAGE * max(columns, 2) / COLUMNS
    figure = style.new_figure(width, _ROW * n_rows + _MARGIN)
    grid = figure.subplots(n_rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(runs) :]:
        axes.set_visible(False)
    for place, (axes, policy) in enumerate(zip(grid.flat, runs, strict=False)):
        prepare(axes)
        if policy != CHAMPION and CHAMPION in runs:
            draw(axes, CHAMPION, True)
        draw(axes, policy, False)
        axes.set_title(policy, loc="left", color=colour(policy))
        if place + columns >= len(runs):
            axes.tick_params(labelbottom=True)
    figure.supxlabel(x, fontsize=7.0)
    figure.supylabel(y, fontsize=7.0)
    return figure


def log_scale(axes: Axes, which: Literal["x", "y"]) -> None:
    """A logarithmic axis with ticks at 1, 3, 10, 30 ... as plain numbers."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def colour(policy: str) -> str:
    """Return the colour of a policy's curve."""
    return style.ADAPTED if policy == CHAMPION else _OWN


def line(policy: str, faint: bool) -> dict[str, Any]:
    """How a curve through points looks."""
    if faint:
        return {"color": _SOFT, "linewidth": 2.2, "zorder": 1.5}
    return {"color": colour(policy), "marker": "o", "ms": 2.6, "zorder": 3}


def bar(policy: str) -> dict[str, Any]:
    """How an interval looks."""
    return {"color": colour(policy), "linewidth": 2.6, "alpha": 0.3, "zorder": 2}


def dots(policy: str) -> dict[str, Any]:
    """How single episodes look."""
    look = {"marker": "o", "linestyle": "none", "ms": 1.8, "mew": 0}
    return {"color": colour(policy), "alpha": 0.35, "zorder": 2, **look}


def say(axes: Axes, text: str) -> None:
    """Write into the middle of a panel."""
    axes.text(
        0.5,
        0.5,
        text,
        transform=axes.transAxes,
        ha="center",
        va="center",
        fontsize=6.5,
        color=style.MARK,
    )
