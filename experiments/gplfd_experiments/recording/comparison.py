"""Several policies at the same door, side by side in one recording, on one clock."""

import copy
import itertools
import math
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any, Final

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.episodes.metrics import SHORT
from gplfd_experiments.recording import colours, episode, motion, panels, parts, scene
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.stream import TEXT, page, static, write_recording
from gplfd_policies.demonstrations.demonstration import Demonstration

COLOURS: Final[tuple[Colour, ...]] = (
    colours.ADAPTED,
    colours.HAND,
    colours.AXIS_Z,
    colours.AXIS_X,
    (120, 230, 90),
    (255, 120, 150),
)
"""Colours of policies, in order; their number limits the number of policies."""
SPACING: Final = 1.5  # Distance between neighbouring robots [m].

# Angle between the view and the robots' heading, about the world's z axis. From this
# direction no robot hides its hand, and the row is across the view.
_TURN: Final = math.radians(35.0)
ROW: Final = np.array([-math.sin(_TURN), -math.cos(_TURN), 0.0])
"""Direction of the row in the world; each robot stands slightly behind the last."""

_OVERLAY: Final = "/overlay"  # A common door with the paths of all policies.
_LABEL: Final = (1.15, -0.8, -0.2)
"""Position of a robot's name, behind the robot, in its task frame [m]."""


def record_comparison(
    path: str | Path,
    logs: Sequence[EpisodeLog],
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> None:
    """Write an .rrd of policies at one door, the first leftmost, complete or absent.

    Raises ValueError for logs that cannot be compared.
    """
    if not 1 <= len(logs) <= len(COLOURS):
        raise ValueError(f"{len(logs)} episodes; a comparison has 1 to {len(COLOURS)}")
    names = [log.policy for log in logs]
    for log in logs:
        episode.check_model(log, model)
        if names.count(log.policy) > 1:
            raise ValueError(f"policy {log.policy} is given twice in a comparison")
        if dict(log.door_config) != dict(logs[0].door_config):
            raise ValueError(
                f"{log.policy} opened another door than {logs[0].policy}; a comparison "
                "shows one door"
            )
    model = copy.copy(model)
    for geom in range(model.ngeom):
        if model.geom(geom).name.startswith("wall_"):  # would hide the next robot
            model.geom_rgba[geom, 3] = 0.0
    # All robots, from behind and above; their curves and paths are below.
    handle, _ = scene.task_frame(model)
    middle = handle + 0.5 * SPACING * (len(logs) - 1) * ROW + [-0.2, 0.0, -0.2]
    away = max(2.2, 0.35 * SPACING * len(logs))
    back = np.array([-math.cos(_TURN), math.sin(_TURN), 0.45])
    plans = [f"- /robots{_part(log)}{motion.PLAN}/**" for log in logs]
    robots = scene.view_3d(
        "Each policy at a copy of the same door",
        "/",
        ["/robots/**", *plans],
        (middle + away * back, middle, (0.0, 0.0, 1.0)),
    )
    above, target = np.multiply(logs[0].radius, [[-0.5, -0.55, 1.45], [-0.5, -0.55, 0]])
    paths = scene.view_3d(
        "All paths at one door, from above",
        f"{_OVERLAY}{motion.VIEW}",
        [f"{_OVERLAY}/**"],
        (above, target, (1.0, 0.0, 0.0)),
    )
    angle = rrb.TimeSeriesView(
        origin=f"{panels.ROOT}/angle",
        name="Door angle [deg]",
        plot_legend=rrb.Corner2D.LeftTop,
    )
    curves = panels.Panel("radial", "Radial force [N]: against the hinge").view()
    about = rrb.TextDocumentView(origin=TEXT, name="How to read it")
    below = rrb.Horizontal(angle, curves, paths, about, column_shares=[3, 3, 2.4, 3])
    views = rrb.Vertical(robots, below, row_shares=[5, 4])
    name = f"{logs[0].door} door, {len(logs)} policies"
    write_recording(path, name, views, _chunks(logs, model, demonstrations))


def _chunks(
    logs: Sequence[EpisodeLog],
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
) -> Iterator[Chunk]:
    """Return the page, the common door, and each policy's robot and curves."""
    first, table = logs[0], ""
    widest = [math.degrees(float(log.opening.door_angle.max())) for log in logs]
    for log, angle in zip(logs, widest, strict=True):
        outcome = "opened" if log.success else log.failure.replace("_", " ")
        peak = float(np.abs(log.forces.force_radial).max())
        numbers = f"{angle:.0f}° | {peak:.1f} N"
        table += f"| {log.policy} | {outcome} | {numbers} |\n"
    yield page(f"""\
### {len(logs)} policies at the {first.door} door

| policy | outcome | widest | radial peak |
|---|---|---|---|
{table}
All policies learned from the same demonstrations and open the same door (handle at \
{first.radius:g} m, seed {first.seed}), on one clock. **Radial force** does no work; a \
large value means that the path does not fit the door. The tube is the policy's \
forecast of the rest of the motion, ±1.96 σ; green is the true arc of the handle.
""")
    for chunk in motion.door_frame(model, first.config, demonstrations):
        yield chunk.with_entity_path(f"{_OVERLAY}{chunk.entity_path}")
    # The angle from which a door counts as opened.
    angle = math.degrees(SUCCESS_ANGLE)
    mark = {panels.Line(f"opened: {angle:.0f}", colours.MARK, 1.0): np.full(2, angle)}
    ends = np.array([0.0, max(log.times[-1] for log in logs)])
    yield from panels.series(f"{panels.ROOT}/angle/opened", ends, mark)
    for number, (log, colour) in enumerate(zip(logs, COLOURS, strict=False)):
        # A robot at its door, and its path at the common door.
        part = _part(log)
        root, overlay = f"/robots{part}", f"{_OVERLAY}{motion.ROOT}/paths{part}"
        shift = rr.Transform3D(translation=SPACING * number * ROW)
        yield static(f"{root}/world", shift)
        hand = list(motion.hand_motion(log))
        for chunk in itertools.chain(
            scene.drawn_scene(model),
            motion.door_frame(model, log.config, []),
            scene.moved_scene(model, log),
            motion.policy_motion(log),
            hand,
            parts.balls(log),
        ):
            yield chunk.with_entity_path(f"{root}{chunk.entity_path}")
        for chunk in hand:
            if chunk.entity_path == motion.TRAIL:
                yield chunk.with_entity_path(overlay)
        tube = rr.LineStrips3D.from_fields(colors=colour, radii=0.007)
        for entity in (f"{root}{motion.TRAIL}", overlay):
            yield static(entity, tube)
        ended = SHORT.get(log.failure, log.failure.replace("_", " "))
        outcome = "opened" if log.success else f"{ended} at {widest[number]:.0f}°"
        look: dict[str, Any] = {"radii": 0.012, "colors": colour, "show_labels": True}
        label = rr.Points3D([_LABEL], labels=[f"{log.policy}: {outcome}"], **look)
        yield static(f"{root}{motion.ROOT}/label", label)
        line = panels.Line(log.policy, colour, 1.5)
        angles, radial = log.opening.door_angle, np.abs(log.forces.force_radial)
        for plot, values in (("angle", np.degrees(angles)), ("radial", radial)):
            path = f"{panels.ROOT}/{plot}{part}"
            yield from panels.series(path, log.times, {line: values})


def _part(log: EpisodeLog) -> str:
    """The last part of an entity of a policy, valid for any policy name."""
    return f"/{rr.escape_entity_path_part(log.policy)}"
