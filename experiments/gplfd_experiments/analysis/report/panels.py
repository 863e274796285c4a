"""A panel per policy on common axes, the reference's curve faintly in all of them."""

from collections.abc import Callable, Iterable, Mapping
from typing import Any, Final, Literal

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FormatStrFormatter, LogLocator, NullLocator

from gplfd_experiments.analysis.figures import style

Draw = Callable[[Axes, str, str], None]
"""Draws a policy into a panel in a colour, `FAINT` for the reference in the others'."""

FAINT: Final = "#c9b3dd"
BAR: Final[Mapping[str, Any]] = {"linewidth": 2.6, "alpha": 0.3, "zorder": 2}
"""How an interval looks."""
DOTS: Final[Mapping[str, Any]] = {
    "marker": "o",
    "linestyle": "none",
    "ms": 1.8,
    "mew": 0,
    "alpha": 0.35,
    "zorder": 2,
}
"""How single episodes look."""

_FEWEST, _MOST = 3, 5
"""Panels in a row."""
_ROW: Final = 1.35
_MARGIN: Final = 0.55
_LONGEST: Final = 26
"""Characters of a name that fit above a panel."""


def small_multiples(
    policies: Iterable[str],
    reference: str,
    draw: Draw,
    prepare: Callable[[Axes], None],
    x: str,
    y: str,
) -> Figure:
    """Draw a panel per policy, the reference's curve faintly behind the others."""
    shown = list(policies)
    n_rows = -(-len(shown) // _MOST)
    columns = max(_FEWEST, -(-len(shown) // n_rows))
    figure = style.new_figure(style.PAGE, _ROW * n_rows + _MARGIN)
    grid = figure.subplots(n_rows, columns, sharex=True, sharey=True, squeeze=False)
    for axes in grid.flat[len(shown) :]:
        axes.set_visible(False)
    for place, (axes, policy) in enumerate(zip(grid.flat, shown, strict=False)):
        prepare(axes)
        if policy != reference and reference in shown:
            draw(axes, reference, FAINT)
        tint = style.ADAPTED if policy == reference else style.DOORS[1]
        draw(axes, policy, tint)
        axes.set_title(short(policy), loc="left", color=tint, parse_math=False)
        if place + columns >= len(shown):
            axes.tick_params(labelbottom=True)
    figure.supxlabel(x, fontsize=7.0)
    figure.supylabel(y, fontsize=7.0)
    return figure


def short(policy: str) -> str:
    """Return a name, or as much of its end as fits above a panel."""
    return policy if len(policy) <= _LONGEST else f"…{policy[1 - _LONGEST :]}"


def log_scale(axes: Axes, which: Literal["x", "y"]) -> None:
    """Set a logarithmic axis with ticks at 1, 3, 10, 30 ... as plain numbers."""
    axes.set(**{f"{which}scale": "log"})
    axis = axes.xaxis if which == "x" else axes.yaxis
    axis.set_major_locator(LogLocator(subs=(1.0, 3.0)))
    axis.set_major_formatter(FormatStrFormatter("%g"))
    axis.set_minor_locator(NullLocator())


def line(tint: str) -> dict[str, Any]:
    """Return how a curve through points looks."""
    if tint == FAINT:
        return {"color": tint, "linewidth": 2.2, "zorder": 1.5}
    return {"color": tint, "marker": "o", "ms": 2.6, "zorder": 3}


def say(axes: Axes, text: str) -> None:
    """Write into the middle of a panel."""
    look: dict[str, Any] = {
        "ha": "center",
        "va": "center",
        "fontsize": 6.5,
        "color": style.MARK,
    }
    axes.text(0.5, 0.5, text, transform=axes.transAxes, **look)
