"""The view a recording opens with: scene, policy and the reasons side by side."""

import functools
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final, Literal, NamedTuple

import rerun.blueprint as rrb
from numpy.typing import ArrayLike
from rerun.chunk import Chunk, RrdReader

from gplfd.experiments.recording import motion, outside, panels, stages
from gplfd.experiments.recording.colours import BACKGROUND
from gplfd.experiments.recording.stream import APPLICATION, TIMELINE

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
_PLAN_EYE: Final = Eye((-0.3, -0.3, 1.0), (-0.3, -0.3, 0.0), (1.0, 0.0, 0.0))

_SHARE: Final = (-40.0, 110.0)
"""Shown range of the share of the stability bound [%]; negative while softening."""


@functools.cache
def layout(causes: tuple[str, ...], *, live: bool = False) -> rrb.Blueprint:
    """Arrange the views, the same for every episode in which the same can happen.

    Both 3-D views look from points fixed in the task frame, so that every door is seen
    alike; the axes of the panels fit themselves to what there is.

    Args:
        causes: Names of what happens from outside.
        live: Whether time follows what comes in, and does not play what is there.
    """
    everything = ["/world/**", f"- {motion.PLAN}/**"]
    scene = view_3d("Scene", motion.VIEW, everything, _SCENE_EYE)
    title = "From above: door at the top, hinge right"
    plan = view_3d(title, motion.VIEW, [f"{motion.ROOT}/**"], _PLAN_EYE)
    about: rrb.Container | rrb.View
    about = rrb.TextDocumentView(origin=TEXT, name="About this run")
    if causes:
        about = rrb.Vertical(_happenings(), about, row_shares=[2, 3])
    lane = rrb.StateTimelineView(origin=stages.ENTITY, name="Stage")
    left = rrb.Vertical(
        scene, lane, rrb.Horizontal(plan, about), row_shares=[5, 1.2, 4]
    )
    middle = rrb.Vertical(*_policy_views(), *_outside_views(causes))
    right = rrb.Vertical(*_reason_views())
    views = rrb.Horizontal(left, middle, right, column_shares=[5.4, 3, 3])
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
def layout_chunks(causes: tuple[str, ...]) -> tuple[Chunk, ...]:
    """Return the layout of a recording, made once per process.

    Args:
        causes: Names of what happens from outside.
    """
    return as_chunks(layout(causes))


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


def _policy_views() -> list[rrb.TimeSeriesView]:
    title = "Door angle [deg], lines at 15, 30, 60"
    return [
        _series("angle", title, limits=(-3.0, 75.0)),
        # The hand is pulled from zero up: this corner stays empty.
        _series("x", "x, along the pull [m], ±1.96 σ", legend="LeftTop"),
        _series("z", "z, across it [m], ±1.96 σ"),
        _series("turn", "θu_y, turn of the hand [deg], ±1.96 σ"),
    ]


def _reason_views() -> list[rrb.TimeSeriesView]:
    # In panels this low a legend would lie on the curves: the titles are the legends.
    # From zero up, so that "half as stiff" looks half as high.
    uncertainty = "σ [mm]: x orange, z blue, held off white"
    stiffness = "Stiffness k [N/m]: soft where σ is large"
    return [
        _series("uncertainty", uncertainty, from_zero=True),
        _series("stiffness", stiffness, from_zero=True),
        _series("uncertainty_rate", "dσ/dt [mm/s]: falling σ stiffens"),
        _series("stability", "dk/dt [% of its stability bound]", limits=_SHARE),
        _series("misfit", "Misfit of the phase: 1 as expected, 3 lost", from_zero=True),
        _series("force", "Force [N]: green opens, red fights, violet carried"),
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
