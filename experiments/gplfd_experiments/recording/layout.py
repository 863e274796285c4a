"""The view a recording opens with: scene, policy and the reasons side by side."""

import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, NamedTuple

import numpy as np
import rerun.blueprint as rrb
from numpy.typing import ArrayLike
from rerun.chunk import Chunk, RrdReader

from gplfd_env.doors.config import HingeSide
from gplfd_experiments.recording import mechanism, motion, outside, panels, stages
from gplfd_experiments.recording.colours import BACKGROUND
from gplfd_experiments.recording.stream import APPLICATION, TIMELINE

Corner = Literal["LeftTop", "LeftBottom", "RightTop", "RightBottom"]

TEXT: Final = "/about"
"""Entity of the page that explains the run and the view."""


class Eye(NamedTuple):
    """Where a 3-D view looks from, at what, and which way is up [m]."""

    position: ArrayLike
    target: ArrayLike
    up: ArrayLike


# From the hinge side the hand stays before the leaf however far the door is open.
_SCENE_EYE: Final = Eye((-0.62, -1.95, 0.85), (-0.46, -0.2, -0.07), (0.0, 0.0, 1.0))
# A robot that drives needs room, and its doors are higher.
_WIDE_EYE: Final = Eye((-0.8, -3.2, 1.3), (-0.7, -0.3, -0.15), (0.0, 0.0, 1.0))
_PLAN_EYE: Final = Eye((-0.3, -0.3, 1.0), (-0.3, -0.3, 0.0), (1.0, 0.0, 0.0))
_WIDE_PLAN_EYE: Final = Eye((-0.45, -0.4, 1.5), (-0.45, -0.4, 0.0), (1.0, 0.0, 0.0))

_BASE_LEGEND: Final[dict[str, Corner]] = {"base": "LeftTop"}
"""Of the mechanism's panels, those with several curves."""

_SHARE: Final = (-40.0, 110.0)
"""Shown range of the share of the stability bound [%]; negative while softening."""


def layout(
    causes: tuple[str, ...],
    there: tuple[str, ...] = (),
    hinge: HingeSide = "right",
    *,
    live: bool = False,
) -> rrb.Blueprint:
    """Arrange the views, the same for every episode in which the same can happen.

    Both 3-D views look from points fixed in the task frame, so that every door is seen
    alike, one with its hinge on the left in the mirror; the axes of the panels fit
    themselves to what there is.

    Args:
        causes: Names of what happens from outside.
        there: Names of what `gplfd_experiments.recording.mechanism` shows.
        hinge: Where the door's hinge is.
        live: Whether time follows what comes in, and does not play what is there.
    """
    return _layout(causes, there, hinge, live)


# A layout has identifiers of its own: the same one for the same arguments.
@functools.cache
def _layout(
    causes: tuple[str, ...],
    there: tuple[str, ...],
    hinge: HingeSide,
    live: bool,
) -> rrb.Blueprint:
    everything = ["/world/**", f"- {motion.PLAN}/**"]
    mirror = 1.0 if hinge == "right" else -1.0
    wide = "base" in there
    eye = _mirrored(_WIDE_EYE if wide else _SCENE_EYE, mirror)
    scene = view_3d("Scene", motion.VIEW, everything, eye)
    title = f"From above: door at the top, hinge {hinge}"
    above = _mirrored(_WIDE_PLAN_EYE if wide else _PLAN_EYE, mirror)
    # From above its number would lie on that of what happens from outside.
    hidden = [f"- {motion.STIFFNESS}"] if causes else []
    plan = view_3d(title, motion.VIEW, [f"{motion.ROOT}/**", *hidden], above)
    about: rrb.Container | rrb.View
    about = rrb.TextDocumentView(origin=TEXT, name="How to read it")
    if causes:
        about = rrb.Vertical(_happenings(), about, row_shares=[2, 3])
    lanes = rrb.StateTimelineView(origin=stages.ENTITY, name="Stage and stiffness")
    left = rrb.Vertical(
        scene,
        lanes,
        rrb.Horizontal(plan, about),
        row_shares=[5, 2.4 if "latch" in there else 1.9, 4],
    )
    tabs = [
        rrb.Vertical(
            *_reason_views(), *_outside_views(causes), name="Why stiff, why soft"
        ),
        rrb.Vertical(*_policy_views(), name="Motion and policy"),
        rrb.Vertical(*_rate_views(), name="Unsmoothed, rates"),
    ]
    if there:
        mechanics = [
            _series(name, mechanism.PANELS[name].title, legend=_BASE_LEGEND.get(name))
            for name in there
        ]
        tabs.append(rrb.Vertical(*mechanics, name="Handle, latch, closer, base"))
    views = rrb.Horizontal(left, rrb.Tabs(*tabs, active_tab=0), column_shares=[6, 5])
    return only(views, "following" if live else "playing")


def only(
    views: rrb.Container, play_state: Literal["playing", "following"] = "playing"
) -> rrb.Blueprint:
    """Arrange some views in a window that shows little beside them."""
    return rrb.Blueprint(
        views,
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state=play_state),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


@functools.cache
def layout_chunks(
    causes: tuple[str, ...],
    there: tuple[str, ...] = (),
    hinge: HingeSide = "right",
) -> tuple[Chunk, ...]:
    """Return the layout of a recording, made once per process.

    Args:
        causes: Names of what happens from outside.
        there: Names of what `gplfd_experiments.recording.mechanism` shows.
        hinge: Where the door's hinge is.
    """
    return as_chunks(layout(causes, there, hinge))


def _mirrored(eye: Eye, mirror: float) -> Eye:
    """Look at what is at the other side of the task frame's x-y plane."""
    sides = np.array([1.0, mirror, 1.0])
    return Eye(sides * eye.position, sides * eye.target, eye.up)


def as_chunks(blueprint: rrb.Blueprint) -> tuple[Chunk, ...]:
    """Return a layout as Rerun writes it."""
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "layout.rbl"
        blueprint.save(APPLICATION, file)
        reader = RrdReader(file)
        return tuple(reader.stream(store=reader.blueprints()[0]))


def view_3d(
    name: str, origin: str, contents: Sequence[str], eye: Eye
) -> rrb.Spatial3DView:
    """Return a 3-D view of some entities.

    Args:
        name: Its title.
        origin: Entity in whose frame it looks.
        contents: Entities, as Rerun's queries name them.
        eye: Where it looks from.
    """
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=contents,
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=eye.position, look_target=eye.target, eye_up=eye.up
        ),
    )


def _series(
    name: str,
    title: str,
    *,
    limits: tuple[float, float] | None = None,
    from_zero: bool = False,
    legend: Corner | None = None,
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"{panels.ROOT}/{name}",
        name=title,
        contents=["$origin/**", panels.ZERO] if from_zero else "$origin/**",
        axis_y=None if limits is None else rrb.ScalarAxis(range=limits),
        plot_legend=rrb.PlotLegend(corner=legend, visible=legend is not None),
    )


def _reason_views() -> list[rrb.TimeSeriesView]:
    """What a reader needs to see why the robot was stiff here and soft there."""
    # From zero up, so that "half as stiff" looks half as high.
    return [
        _series("angle", "Door angle [deg], lines at 15, 30, 60", limits=(-3.0, 75.0)),
        _series(
            "uncertainty",
            "1. Uncertainty σ of the policy [mm]",
            from_zero=True,
            legend="LeftTop",
        ),
        _series(
            "stiffness",
            "2. Stiffness k [N/m]: falls where σ grows",
            from_zero=True,
            legend="LeftBottom",
        ),
        _series(
            "force",
            "3. Force [N]: green opens, red against hinge, violet compensated",
            from_zero=True,
        ),
    ]


def _policy_views() -> list[rrb.TimeSeriesView]:
    return [
        # The hand is pulled from zero up: this corner stays empty.
        _series("x", "x, along the pull [m], ±1.96 σ", legend="LeftTop"),
        _series("z", "z, across it [m], ±1.96 σ"),
        _series("turn", "θu_y, turn of the hand [deg], ±1.96 σ"),
    ]


def _rate_views() -> list[rrb.TimeSeriesView]:
    """What the control loop used in every period: σ falls at every via-point."""
    return [
        _series("uncertainty_raw", "σ [mm]", from_zero=True, legend="LeftTop"),
        _series("uncertainty_rate", "dσ/dt [mm/s]: falling σ stiffens"),
        _series("stiffness_raw", "Stiffness k [N/m]", from_zero=True),
        _series("stability", "dk/dt [% of its stability bound]", limits=_SHARE),
        _series("misfit", "Misfit of the phase: 1 as expected, 3 lost", from_zero=True),
    ]


def _outside_views(causes: tuple[str, ...]) -> list[rrb.TimeSeriesView]:
    if not causes:
        return []
    shown = ", ".join(f"{name} [{outside.CAUSES[name].unit}]" for name in causes)
    return [_series(outside.PANEL, f"From outside: {shown}", from_zero=True)]


def _happenings() -> rrb.TextLogView:
    """What begins and ends from outside, and when."""
    columns = rrb.archetypes.TextLogColumns(text_log_columns=["Body"])
    return rrb.TextLogView(origin=outside.LOG, name="From outside", columns=columns)
