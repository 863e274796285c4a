"""The view a recording opens with: scene, policy and the reasons side by side."""

from __future__ import annotations

from typing import Final, Literal, NamedTuple

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray
from scipy.spatial.transform import Rotation

from experiments.episode_log import EpisodeLog
from experiments.recording import motion, panels, stages
from experiments.recording.colours import BACKGROUND
from experiments.recording.stream import TIMELINE

FloatArray = NDArray[np.float64]
Corner = Literal["LeftTop", "LeftBottom", "RightTop", "RightBottom"]

TEXT: Final = "/about"
"""Entity of the page that explains the run and the view."""


class Eye(NamedTuple):
    """Where a 3-D view looks from, at what, and which way is up."""

    position: FloatArray
    target: FloatArray
    up: FloatArray


# Task frame: x pull (towards the robot), y up, z to the left of the door. From the
# hinge side the hand stays before the leaf however far the door is open.
_SCENE_EYE_D: Final = Eye(
    np.array([0.62, 0.85, -1.95]), np.array([0.46, -0.07, -0.2]), np.array([0, 1.0, 0])
)
_PLAN_EYE_D: Final = Eye(
    np.array([0.3, 1.0, -0.3]), np.array([0.3, 0.0, -0.3]), np.array([-1.0, 0, 0])
)


_SHARE: Final = (-40.0, 110.0)
"""Shown range of the share of the stability bound [%]; negative while softening."""


def layout(
    log: EpisodeLog, task_origin_w: FloatArray, task_rotation_w: Rotation
) -> rrb.Blueprint:
    """Arrange the views.

    Args:
        log: Episode; sets the ranges of the axes.
        task_origin_w: Closed handle in the scene's world frame (3,) [m].
        task_rotation_w: Task frame's axes in the world frame.
    """
    # A little more than the episode, so that its last stage shows.
    duration = 1.02 * float(log.times[-1])
    eye = Eye(
        task_origin_w + task_rotation_w.apply(_SCENE_EYE_D.position),
        task_origin_w + task_rotation_w.apply(_SCENE_EYE_D.target),
        task_rotation_w.apply(_SCENE_EYE_D.up),
    )
    scene = _view_3d("/world", "Scene", eye, f"- {motion.PLAN}/**")
    title = "From above: door at the top, hinge right"
    plan = _view_3d(motion.ROOT, title, _PLAN_EYE_D)
    about = rrb.TextDocumentView(origin=TEXT, name="About this run")
    return rrb.Blueprint(
        rrb.Horizontal(
            rrb.Vertical(
                scene,
                _stage_view(duration),
                rrb.Horizontal(plan, about),
                row_shares=[5, 1.2, 4],
            ),
            rrb.Vertical(*_policy_views(duration)),
            rrb.Vertical(*_reason_views(log, duration)),
            column_shares=[5.4, 3, 3],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )


def _view_3d(origin: str, name: str, eye: Eye, *filters: str) -> rrb.Spatial3DView:
    return rrb.Spatial3DView(
        origin=origin,
        name=name,
        contents=["$origin/**", *filters],
        background=BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=eye.position, look_target=eye.target, eye_up=eye.up
        ),
    )


def _time_axis(duration: float) -> rrb.TimeAxis:
    return rrb.TimeAxis(
        view_range=rr.TimeRange(
            start=rrb.TimeRangeBoundary.absolute(seconds=0.0),
            end=rrb.TimeRangeBoundary.absolute(seconds=duration),
        )
    )


def _stage_view(duration: float) -> rrb.StateTimelineView:
    return rrb.StateTimelineView(
        origin=stages.ENTITY, name="Stage", time_view=_time_axis(duration)
    )


def _series(
    name: str,
    title: str,
    duration: float,
    *,
    limits: tuple[float, float] | None = None,
    legend: Corner | None = None,
) -> rrb.TimeSeriesView:
    return rrb.TimeSeriesView(
        origin=f"{panels.ROOT}/{name}",
        name=title,
        axis_x=_time_axis(duration),
        axis_y=None if limits is None else rrb.ScalarAxis(range=limits),
        plot_legend=rrb.PlotLegend(corner=legend, visible=legend is not None),
    )


def _policy_views(duration: float) -> list[rrb.TimeSeriesView]:
    title = "Door angle [deg], lines at 15, 30, 60"
    angle = _series("angle", title, duration, limits=(-3.0, 75.0))
    return [
        angle,
        _series("x", "x, along the pull [m], ±1.96 σ", duration, legend="RightBottom"),
        _series("z", "z, across it [m], ±1.96 σ", duration),
        _series("turn", "θu_y, turn of the hand [deg], ±1.96 σ", duration),
    ]


def _reason_views(log: EpisodeLog, duration: float) -> list[rrb.TimeSeriesView]:
    sigma = _from_zero(1e3 * log.std[:, panels.SHOWN_AXES])
    stiffness = _from_zero(log.stiffness[:, panels.SHOWN_AXES])
    views: tuple[tuple[str, str, tuple[float, float] | None, Corner | None], ...] = (
        ("uncertainty", "Uncertainty σ [mm]", sigma, "RightTop"),
        ("stiffness", "Stiffness k [N/m]: soft where σ is large", stiffness, None),
        ("uncertainty_rate", "dσ/dt [mm/s]: falling σ stiffens", None, None),
        ("stability", "dk/dt [% of its stability bound]", _SHARE, None),
        ("force", "Force on the handle [N]", None, "LeftBottom"),
    )
    return [
        _series(name, title, duration, limits=limits, legend=corner)
        for name, title, limits, corner in views
    ]


def _from_zero(values: FloatArray) -> tuple[float, float] | None:
    """Limits from zero up, so that "half as stiff" looks half as high."""
    largest = float(values.max())
    return (0.0, 1.05 * largest) if largest > 0.0 else None
