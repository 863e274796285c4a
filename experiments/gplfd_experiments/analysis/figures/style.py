"""Input and style of the figures: sizes, colours on white paper, file output."""

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from string import ascii_lowercase
from typing import Any, Final

import matplotlib.style
from matplotlib.artist import Artist
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_policies.arrays.storage import complete_or_absent
from gplfd_policies.demonstrations.npz import LabelledDemonstrations
from gplfd_policies.movements.movement import GaussianTrajectory

COLUMN: Final = 3.5  # Width of a journal's column [inch].
PAGE: Final = 7.16  # Width of a journal's page of two columns [inch].

POLICY: Final = "gp"
"""Policy whose episodes figures show; other policies get the same observations."""


@dataclass(frozen=True, kw_only=True, slots=True)
class Material:
    """Episodes by door, the demonstrations of their policy, and the common seed."""

    seed: int
    demonstrations: LabelledDemonstrations
    episodes: Mapping[str, EpisodeLog]


_STYLE: Final[Any] = matplotlib.rc_params_from_file(
    Path(__file__).with_name("paper.mplstyle"), use_default_template=False
)
paper_style: Final = partial(matplotlib.style.context, _STYLE, after_reset=True)
"""Makes a context for drawing and writing that ignores the user's matplotlibrc."""

# The hues of `gplfd_experiments.recording.colours`, darker for white paper. Colours in
# the same panel differ in luminance, not only in hue.
DEMONSTRATION: Final = "#9ca0a9"
BEFORE: Final = "#7c8eb5"
ADAPTED: Final = "#794292"
TRUTH: Final = "#2e8955"
AXIS_X: Final = "#c97c33"
AXIS_Z: Final = "#2c6b91"
LIMIT: Final = "#b13d3d"
MARK: Final = "#676c78"
SEEN: Final = "#e3f1fb"
"""Background of the observed part."""
DOORS: Final = ("#3fb3bf", "#1b6fae", "#0b2a66")
"""Doors from the smallest to the largest: darker is wider."""
BAND: Final[Mapping[str, Any]] = {"alpha": 0.22, "linewidth": 0}
"""Look of a shaded interval."""


def write_figure(figure: Figure, folder: Path, name: str) -> None:
    """Write ``name.png`` and ``name.svg``; the same figure gives the same bytes."""
    # The layout is computed once, not for each file.
    figure.draw_without_rendering()
    figure.set_layout_engine(None)
    for suffix, metadata in (
        (".png", {"Software": None}),
        (".svg", {"Date": None, "Creator": None}),
    ):
        with complete_or_absent(folder / f"{name}{suffix}") as path:
            figure.savefig(path, format=suffix[1:], metadata=metadata)


def name_panels(panels: Iterable[Axes], titles: Iterable[str]) -> None:
    """Write a bold letter, from a on, and a title flush left above each panel."""
    for axes, letter, title in zip(panels, ascii_lowercase, titles, strict=False):
        axes.set_title(rf"$\bf{{{letter}}}$  {title}", loc="left")


def note(axes: Axes, x: float, text: str, **look: Any) -> None:
    """Write small text below a panel's upper edge, at a share ``x`` of its width."""
    axes.text(x, 0.98, text, transform=axes.transAxes, va="top", **look)


def mean_and_interval(
    axes: Axes,
    policy: GaussianTrajectory,
    output: int,
    colour: str,
    *,
    band_label: str | None = None,
    **line: Any,
) -> None:
    """Draw an output's mean over phase on its shaded 95 % interval."""
    low, high = (bound[:, output] for bound in policy.interval())
    look: Any = {"color": colour, "label": band_label, **BAND}
    axes.fill_between(policy.times, low, high, **look)
    axes.plot(policy.times, policy.mean[:, output], color=colour, **line)


def legend_line(color: str, linestyle: Any = "-", **line: Any) -> Line2D:
    """A line for the legend only."""
    return Line2D([], [], color=color, linestyle=linestyle, **line)


def legend_above(figure: Figure, entries: Mapping[str, Artist]) -> None:
    """Write a legend of lines and areas above all panels, in one row."""
    figure.legend(
        handles=list(entries.values()),
        labels=list(entries),
        loc="outside upper center",
        ncols=len(entries),
    )
