"""The view of a recording: scene, policy, and reasons for the stiffness."""

from collections.abc import Sequence
from typing import Final, Literal, NamedTuple

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import ArrayLike

from gplfd_env.doors.config import HingeSide
from gplfd_experiments.recording import lanes, motion, panels
from gplfd_experiments.recording.colours import BACKGROUND
from gplfd_experiments.recording.parts import KINDS, LOG, PANEL, TITLES
from gplfd_experiments.recording.stream import TEXT

Corner = Literal["LeftTop", "LeftBottom", "RightTop", "RightBottom"]
Eye = tuple[ArrayLike, ArrayLike, ArrayLike]
"""Position, target and up direction of a 3-D view [m]."""


class Plot(NamedTuple):
    """A panel of all time series below an entity."""

    entity: str
    title: str
    legend: Corner | None = None
    """Corner of the legend, without curves; None for no legend."""
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

_PLOTS: Final = {
    "Uncertainty and stiffness": (
        Plot("angle", "Door angle [deg], lines at 15, 30, 60", limits=(-3.0, 75.0)),
        Plot("uncertainty", "1. Uncertainty σ of the policy [mm]", "LeftTop", True),
        Plot(
            "stiffness", "2. Stiffness k [N/m]: falls where σ grows", "LeftBottom", True
        ),
        Plot(
            "force",
            "3. Force [N]: green along the path, red radial, violet compensated",
            from_zero=True,
        ),
    ),
    "Motion and policy": (
        # The hand moves from zero upwards, so this corner is empty.
        Plot("x", "x, along the pull [m], ±1.96 σ", "LeftTop"),
        Plot("z", "z, across it [m], ±1.96 σ"),
        Plot("turn", "θu_y, rotation of the hand [deg], ±1.96 σ"),
        Plot("size", "Size [% of demonstrated], ±1.96 σ", "RightTop", limits=(40, 200)),
    ),
    # Values of the control loop in every period: σ drops at every via-point.
    "Unsmoothed, rates": (
        Plot("uncertainty_raw", "σ [mm]", "LeftTop", True),
        Plot("uncertainty_rate", "dσ/dt [mm/s]: falling σ stiffens"),
        Plot("stiffness_raw", "Stiffness k [N/m]", from_zero=True),
        # Negative during softening.
        Plot("stability", "dk/dt [% of its stability bound]", limits=(-40.0, 110.0)),
        Plot("misfit", "Misfit of the phase: 1 expected, 3 lost", from_zero=True),
    ),
}
"""Panels of every recording, by tab."""
_EXPECTED_FORCE: Final = Plot(
    "expected", "4. Force along the path [N]: expected ±1.96 σ, measured", "LeftTop"
)


def layout(
    kinds: Sequence[str] = (),
    parts: Sequence[str] = (),
    hinge: HingeSide = "right",
    *,
    forces: bool = False,
) -> rrb.Container:
    """Return the layout, equal for all episodes with the same kinds of content.

    Both 3-D views are fixed in the task frame, so that every door has the same view,
    mirrored for a hinge on the left. The axes of the panels scale automatically.
    ``kinds`` are names of disturbances, ``parts`` names of panels of
    `gplfd_experiments.recording.parts`, and ``forces`` is whether the policy
    expects forces.
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
                f"From above: door at the top, hinge {hinge}",
                [f"{motion.ROOT}/**", *hidden],
                plan_eye,
            ),
        )
    )
    tabs = dict(_PLOTS)
    first = next(iter(tabs))
    if forces:
        tabs[first] += (_EXPECTED_FORCE,)
    about: rrb.Container | rrb.View
    about = rrb.TextDocumentView(origin=TEXT, name="How to read it")
    if kinds:
        columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
        events = rrb.TextLogView(origin=LOG, name="From outside", columns=columns)
        about = rrb.Vertical(events, about, row_shares=[2, 3])
        units = ", ".join(f"{name} [{KINDS[name].unit}]" for name in kinds)
        title = f"From outside: {units}"
        tabs[first] += (Plot(PANEL, title, from_zero=True),)
    if parts:
        tabs["Handle, latch, closer, base"] = tuple(
            Plot(name, TITLES[name], "LeftTop" if name == "base" else None)
            for name in parts
        )
    left = rrb.Vertical(
        scene,
        rrb.StateTimelineView(origin=lanes.ROOT, name="Stage and stiffness"),
        rrb.Horizontal(plan, about),
        row_shares=[5, 2.4 if "latch" in parts else 1.9, 4],
    )
    right = (
        rrb.Vertical(*(series_view(plot, panels.ROOT) for plot in plots), name=name)
        for name, plots in tabs.items()
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
        plot_legend=rrb.PlotLegend(corner=plot.legend, visible=plot.legend is not None),
    )
