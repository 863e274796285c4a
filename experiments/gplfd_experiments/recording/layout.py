"""The view of a recording: scene, policy, and reasons for the stiffness."""

from collections.abc import Collection, Sequence
from itertools import groupby
from typing import Final, NamedTuple

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from gplfd_env.doors.config import HingeSide
from gplfd_experiments.recording import lanes, motion, panels
from gplfd_experiments.recording.colours import BACKGROUND
from gplfd_experiments.recording.parts import KINDS, LOG, PANEL, TITLES
from gplfd_experiments.recording.stream import TEXT

Eye = tuple[ArrayLike, ArrayLike, ArrayLike]
"""Position, target and up direction of a 3-D view [m]."""


class Plot(NamedTuple):
    """A panel of all time series below an entity; a legend would hide curves."""

    entity: str
    title: str
    """Quantity and unit, and the colours of several curves."""
    from_zero: bool = False
    """Whether the axis includes zero, so that heights are proportional."""
    limits: tuple[float, float] | None = None
    """Limits of the axis; None for automatic limits."""


# Seen from the hinge side, the hand is in front of the leaf at any door angle.
_SCENE_EYE: Final = ((-0.62, -1.95, 0.85), (-0.46, -0.2, -0.07), (0.0, 0.0, 1.0))
_PLAN_EYE: Final = ((-0.3, -0.3, 1.0), (-0.3, -0.3, 0.0), (1.0, 0.0, 0.0))
# A mobile robot needs space, and its doors are higher.
_WIDE_EYE: Final = ((-0.8, -3.2, 1.3), (-0.7, -0.3, -0.15), (0.0, 0.0, 1.0))
_WIDE_PLAN_EYE: Final = ((-0.45, -0.4, 1.5), (-0.45, -0.4, 0.0), (1.0, 0.0, 0.0))


def _along_and_across(
    entity: str, title: str, limits: tuple[float, float] | None = None
) -> tuple[Plot, ...]:
    """Panels of both directions side by side, because σ differs tenfold."""
    return tuple(
        Plot(f"{entity}/{axis}", title.format(axis), limits is None, limits)
        for axis in panels.AXES
    )


_PLOTS: Final = {
    "Uncertainty and stiffness": (
        Plot("angle", "Door angle [deg], lines at 15, 30, 60", limits=(-3.0, 75.0)),
        *_along_and_across("uncertainty", "1. Uncertainty σ {} [mm]"),
        *_along_and_across("stiffness", "2. Stiffness k {} [N/m]"),
        Plot(
            "force", "3. Force [N]: along green, compensated violet, radial red", True
        ),
        Plot(
            "expected", "4. Force along [N]: expected violet ±1.96 σ, measured yellow"
        ),
    ),
    "Motion and policy": (
        Plot("x", "x, pull [m]: true green, hand yellow, policy violet, before blue"),
        Plot("z", "z, across it [m], ±1.96 σ"),
        Plot("turn", "θu_y, rotation of the hand [deg], ±1.96 σ"),
        Plot("size", "Size [% of demonstrated], ±1.96 σ", limits=(40, 200)),
    ),
    # Values of the control loop in every period: σ drops at every via-point.
    "Unsmoothed, rates": (
        *_along_and_across("uncertainty_raw", "σ {} [mm]"),
        *_along_and_across("uncertainty_rate", "dσ/dt {} [mm/s]"),
        *_along_and_across("stiffness_raw", "Stiffness k {} [N/m]"),
        # Negative during softening.
        *_along_and_across("stability", "dk/dt {} [% of its bound]", (-40.0, 110.0)),
        Plot("misfit", "Misfit of the phase: 1 expected, 3 lost", True),
    ),
}
"""Panels of every recording, by tab; those of a quantity are side by side."""


def layout(
    kinds: Sequence[str] = (),
    parts: Sequence[str] = (),
    hinge: HingeSide = "right",
    drawn: Collection[str] = (),
) -> rrb.Container:
    """Return the layout, equal for all episodes with the same kinds of content.

    Both 3-D views are fixed in the task frame, so that every door has the same view,
    mirrored for a hinge on the left. The axes of the panels scale automatically.
    ``kinds`` are names of disturbances, ``parts`` names of panels of
    `gplfd_experiments.recording.parts`, and ``drawn`` the entities of the time series
    of the episode; panels without any are left out.
    """
    scene_eye, plan_eye = _SCENE_EYE, _PLAN_EYE
    if "base" in parts:
        scene_eye, plan_eye = _WIDE_EYE, _WIDE_PLAN_EYE
    mirror = np.array([1.0, -1.0 if hinge == "left" else 1.0, 1.0])
    # From above, the number of the stiffness would overlap that of a disturbance.
    hidden = [f"- {motion.STIFFNESS}"] if kinds else []
    scene, plan = (
        view_3d(name, motion.VIEW, contents, (mirror * eye, mirror * target, up))
        for name, contents, (eye, target, up) in (
            ("Scene", ["/world/**", f"- {motion.PLAN}/**"], scene_eye),
            (
                f"From above, hinge {hinge}",
                [f"{motion.ROOT}/**", *hidden],
                plan_eye,
            ),
        )
    )
    tabs = {
        name: [
            plot
            for plot in plots
            if any(path.startswith(f"{panels.ROOT}/{plot.entity}/") for path in drawn)
        ]
        for name, plots in _PLOTS.items()
    }
    first = next(iter(tabs))
    stages: rrb.Container | rrb.View
    stages = rrb.StateTimelineView(origin=lanes.ROOT, name="Stage and stiffness")
    about = rrb.TextDocumentView(origin=TEXT, name="How to read it")
    if kinds:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
        events = rrb.TextLogView(origin=LOG, name="From outside", columns=columns)
        stages = rrb.Horizontal(stages, events, column_shares=[2, 1])
        units = ", ".join(f"{name} [{KINDS[name].unit}]" for name in kinds)
        title = f"From outside: {units}"
        tabs[first].append(Plot(PANEL, title, from_zero=True))
    if parts:
        tabs["Handle, latch, closer, base"] = [
            Plot(name, TITLES[name]) for name in parts
        ]
    left = rrb.Vertical(
        scene,
        stages,
        rrb.Horizontal(plan, about, column_shares=[3, 4]),
        row_shares=[4.5, 2.4 if "latch" in parts else 1.7, 4.5],
    )
    right = (
        rrb.Vertical(
            *(
                rrb.Horizontal(*(series_view(plot, panels.ROOT) for plot in row))
                for _, row in groupby(plots, lambda plot: plot.entity.split("/")[0])
            ),
            name=name,
        )
        for name, plots in tabs.items()
        if plots
    )
    return rrb.Horizontal(left, rrb.Tabs(*right, active_tab=0), column_shares=[6, 5])


def view_3d(
    name: str, origin: str, contents: Sequence[str], eye: Eye
) -> rrb.Spatial3DView:
    """Return a 3-D view of entities, given by queries, in the frame of ``origin``."""
    position, target, up = eye
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=contents,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=position, look_target=target, eye_up=up
        ),
    )


def series_view(plot: Plot, root: str = "") -> rrb.TimeSeriesView:
    """Return the view of a panel, whose entity is below another."""
    return rrb.TimeSeriesView(
        origin=f"{root}/{plot.entity}",
        name=plot.title,
        contents=["$origin/**", panels.ZERO] if plot.from_zero else "$origin/**",
        axis_y=None if plot.limits is None else rrb.ScalarAxis(range=plot.limits),
        plot_legend=rrb.PlotLegend(visible=False),
    )
