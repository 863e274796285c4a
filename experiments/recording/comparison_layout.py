"""The view that a comparison opens with: all robots, their curves and their paths."""

import math
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
import rerun.blueprint as rrb
from rerun.chunk import Chunk, RrdReader

from experiments.episodes.log import EpisodeLog
from experiments.recording import colours, motion
from experiments.recording.kinematics import task_frame
from experiments.recording.stream import APPLICATION, TIMELINE

ABOUT: Final = "/about"
"""Entity of the page that explains the view."""
ANGLE, FORCE = "/plots/angle", "/plots/radial"
OVERLAY: Final = "/overlay"
"""Entity of the one door on which all paths are laid over each other."""

SPACING: Final = 1.5
"""Distance between neighbouring robots [m]."""

_TURN: Final = math.radians(35.0)
"""How far the view is turned from the robots' heading, about the world's z axis. From
there no robot hides its own hand, and the row stands across it."""
ROW: Final = np.array([-math.sin(_TURN), -math.cos(_TURN), 0.0])
"""Direction of the row in the world; each robot stands a little behind the last."""


def robot_entity(policy: str) -> str:
    """Return the entity of a policy's robot and door."""
    return f"/robots/{policy}"


def comparison_layout(
    logs: Sequence[EpisodeLog], model: mujoco.MjModel
) -> tuple[Chunk, ...]:
    """Return the layout of a comparison as Rerun writes it.

    Args:
        logs: An episode per policy.
        model: Model that the episodes ran in.
    """
    blueprint = _layout(logs, model)
    with tempfile.TemporaryDirectory() as folder:
        file = Path(folder) / "layout.rbl"
        blueprint.save(APPLICATION, file)
        reader = RrdReader(file)
        return tuple(reader.stream(store=reader.blueprints()[0]))


def _layout(logs: Sequence[EpisodeLog], model: mujoco.MjModel) -> rrb.Blueprint:
    handle, _ = task_frame(model)
    middle = handle + 0.5 * SPACING * (len(logs) - 1) * ROW + [-0.2, 0.0, -0.2]
    away = max(2.2, 0.35 * SPACING * len(logs))
    back = np.array([-math.cos(_TURN), math.sin(_TURN), 0.45])
    radius = logs[0].radius
    robots = rrb.Spatial3DView(
        origin="/",
        name="One door each, the same door",
        contents=[
            "/robots/**",
            *(f"- {robot_entity(log.policy)}{motion.PLAN}/**" for log in logs),
        ],
        background=colours.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=middle + away * back,
            look_target=middle,
            eye_up=(0.0, 0.0, 1.0),
        ),
    )
    plan = rrb.Spatial3DView(
        origin=f"{OVERLAY}{motion.VIEW}",
        name="All paths on one door, from above",
        contents=[f"{OVERLAY}/**"],
        background=colours.BACKGROUND,
        line_grid=False,
        eye_controls=rrb.EyeControls3D(
            position=(-0.5 * radius, -0.55 * radius, 1.45 * radius),
            look_target=(-0.5 * radius, -0.55 * radius, 0.0),
            eye_up=(1.0, 0.0, 0.0),
        ),
    )
    series = [
        rrb.TimeSeriesView(
            origin=origin,
            name=name,
            plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend),
        )
        for origin, name, legend in (
            (ANGLE, "Door angle [deg]", True),
            (FORCE, "Radial force [N]: fights the hinge", False),
        )
    ]
    about = rrb.TextDocumentView(origin=ABOUT, name="What is seen")
    return rrb.Blueprint(
        rrb.Vertical(
            robots,
            rrb.Horizontal(*series, plan, about, column_shares=[3, 3, 2.4, 3]),
            row_shares=[5, 4],
        ),
        rrb.TimePanel(timeline=TIMELINE, state="collapsed", play_state="playing"),
        rrb.BlueprintPanel(state="hidden"),
        rrb.SelectionPanel(state="hidden"),
        rrb.TopPanel(state="hidden"),
        auto_views=False,
        auto_layout=False,
    )
