"""The view that a comparison opens with: all robots, their curves and their paths."""

import math
from collections.abc import Sequence
from typing import Final

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording import motion
from gplfd_experiments.recording.compared import Measured
from gplfd_experiments.recording.kinematics import task_frame
from gplfd_experiments.recording.layout import Eye, as_chunks, only, view_3d

ABOUT: Final = "/about"
"""Entity of the page that explains the view."""
PLOTS: Final = "/plots"
ANGLE: Final = f"{PLOTS}/angle"
OVERLAY: Final = "/overlay"
"""Entity of the one door on which all paths are laid over each other."""

SPACING: Final = 1.5
"""Distance between neighbouring robots [m]."""

_TURN: Final = math.radians(35.0)
"""How far the view is turned from the robots' heading, about the world's z axis. From
there no robot hides its own hand, and the row stands across it."""
ROW: Final = np.array([-math.sin(_TURN), -math.cos(_TURN), 0.0])
"""Direction of the row in the world; each robot stands a little behind the last."""


def below(entity: str, policy: str) -> str:
    """Return the entity of a policy below another, whatever the policy is called."""
    return f"{entity}/{rr.escape_entity_path_part(policy)}"


def robot_entity(policy: str) -> str:
    """Return the entity of a policy's robot and door."""
    return below("/robots", policy)


def comparison_layout(
    logs: Sequence[EpisodeLog], model: mujoco.MjModel, measured: Measured
) -> tuple[Chunk, ...]:
    """Return the layout of a comparison as Rerun writes it.

    Args:
        logs: An episode per policy.
        model: Model that the episodes ran in.
        measured: What they are compared by, beside the door's angle.
    """
    bottom = [*_series(measured), _paths(logs[0].radius)]
    bottom.append(rrb.TextDocumentView(origin=ABOUT, name="What is seen"))
    panels = rrb.Horizontal(*bottom, column_shares=[3, 3, 2.4, 3])
    return as_chunks(only(rrb.Vertical(_row(logs, model), panels, row_shares=[5, 4])))


def _row(logs: Sequence[EpisodeLog], model: mujoco.MjModel) -> rrb.Spatial3DView:
    """All robots, from behind and above."""
    handle, _ = task_frame(model)
    middle = handle + 0.5 * SPACING * (len(logs) - 1) * ROW + [-0.2, 0.0, -0.2]
    away = max(2.2, 0.35 * SPACING * len(logs))
    back = np.array([-math.cos(_TURN), math.sin(_TURN), 0.45])
    plans = [f"- {robot_entity(log.policy)}{motion.PLAN}/**" for log in logs]
    eye = Eye(middle + away * back, middle, (0.0, 0.0, 1.0))
    name = "One door each, the same door"
    return view_3d(name, "/", ["/robots/**", *plans], eye)


def _paths(radius: float) -> rrb.Spatial3DView:
    """All paths over each other, from above."""
    above, below = np.multiply(radius, [[-0.5, -0.55, 1.45], [-0.5, -0.55, 0.0]])
    eye = Eye(above, below, (1.0, 0.0, 0.0))
    name, origin = "All paths on one door, from above", f"{OVERLAY}{motion.VIEW}"
    return view_3d(name, origin, [f"{OVERLAY}/**"], eye)


def _series(measured: Measured) -> list[rrb.View]:
    return [
        rrb.TimeSeriesView(
            origin=origin,
            name=name,
            plot_legend=rrb.PlotLegend(corner="LeftTop", visible=legend),
        )
        for origin, name, legend in (
            (ANGLE, "Door angle [deg]", True),
            (f"{PLOTS}/{measured.panel}", measured.title, False),
        )
    ]
