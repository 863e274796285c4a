"""Several policies at the same door, side by side in one recording.

Every robot stands at its own door, in a row, and all move on the same clock. Each
policy has a colour for its robot's label, the path of its hand and its curves.
"""

import math
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Final, NamedTuple

import mujoco
import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from rerun.chunk import Chunk

from gplfd_env.conventions.constants import SUCCESS_ANGLE
from gplfd_experiments.episodes.failures import SHORT, failure_name
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, motion
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.disturbances import balls
from gplfd_experiments.recording.episode import check_model, static_chunks
from gplfd_experiments.recording.layout import (
    TEXT,
    Eye,
    Plot,
    only,
    series_view,
    view_3d,
)
from gplfd_experiments.recording.panels import Line, line_style
from gplfd_experiments.recording.scene import moved_scene, task_frame
from gplfd_experiments.recording.stream import (
    EpisodePart,
    moving,
    recording_file,
    static,
)
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

SPACING: Final = 1.5
"""Distance between neighbouring robots [m]."""

_TURN: Final = math.radians(35.0)
"""Angle between the view and the robots' heading, about the world's z axis. From this
direction no robot hides its hand, and the row is across the view."""
ROW: Final = np.array([-math.sin(_TURN), -math.cos(_TURN), 0.0])
"""Direction of the row in the world; each robot stands slightly behind the last."""

_PLOTS: Final = "/plots"
_ANGLE: Final = f"{_PLOTS}/angle"
_OVERLAY: Final = "/overlay"
"""Entity of the common door with the paths of all policies."""
_TRAIL: Final = f"{motion.ROOT}/hand/trail"
_LABEL: Final = (1.15, -0.8, -0.2)
"""Position of a robot's name, behind the robot, in its task frame [m]."""


class Measured(NamedTuple):
    """The curve of a metric by which policies are compared."""

    panel: str
    """Name of the panel's entity."""
    title: str
    values: Callable[[EpisodeLog], FloatArray]
    greatest: tuple[str, str]
    """Name of its greatest value, and its unit."""
    meaning: str
    """Explanation for new users."""


def _beside_path(log: EpisodeLog) -> FloatArray:
    """Distance of the hand from the policy's path, or from its command [mm]."""
    path = np.where(
        np.isfinite(log.decisions.desired), log.decisions.desired, log.decisions.action
    )
    beside: FloatArray = np.linalg.norm((log.motion.ee_pose - path)[:, :3], axis=1)
    return 1e3 * beside


RADIAL: Final = "force_radial_peak"
"""Default measure of comparisons."""

MEASURED: Final[Mapping[str, Measured]] = {
    RADIAL: Measured(
        "radial",
        "Radial force [N]: against the hinge",
        lambda log: np.abs(log.forces.force_radial),
        ("radial peak", "N"),
        "**Radial force** does no work; a large value means that the path does not "
        "fit the door.",
    ),
    "force_handle_peak": Measured(
        "handle",
        "Force at the handle [N]",
        lambda log: np.linalg.norm(
            (
                log.forces.force_tangential,
                log.forces.force_radial,
                log.forces.force_vertical,
            ),
            axis=0,
        ),
        ("peak at the handle", "N"),
        "**Force at the handle** is the load of the grasp.",
    ),
    "person_force_peak": Measured(
        "person",
        "Force on the person [N]",
        lambda log: log.forces.person_force,
        ("on the person", "N"),
        "**Force on the person:** ISO/TS 15066 allows 140 N on a hand, and 280 N for "
        "an instant.",
    ),
    "stop_force_sustained": Measured(
        "stop",
        "Force on the stop [N]",
        lambda log: log.forces.stop_force,
        ("on the stop", "N"),
        "**Force on the stop** is the force of the door, converted to the handle.",
    ),
    "grasp_kept": Measured(
        "slip",
        "Slip of the hand on the handle [mm]",
        lambda log: 1e3 * log.opening.slip,
        ("slip", "mm"),
        "**Slip** is the distance of the hand from where it grasped the handle.",
    ),
    "push_displacement_mm": Measured(
        "beside",
        "Hand off its path [mm]",
        _beside_path,
        ("beside its path", "mm"),
        "**Off its path** is the distance of the hand from the policy's path, or "
        "from the command if the policy has no path.",
    ),
}
"""Measures by the name of the metric of an episode."""


def record_comparison(
    path: str | Path,
    logs: Sequence[EpisodeLog],
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    measure: str = RADIAL,
    heading: str = "",
) -> None:
    """Write an .rrd in which policies open the same door, complete or not at all.

    The first log is leftmost; ``measure`` is one of `MEASURED`. Raises ValueError
    for logs that cannot be compared, and OSError if the file cannot be written.
    """
    if not 1 <= len(logs) <= len(COLOURS):
        raise ValueError(
            f"a comparison shows 1 to {len(COLOURS)} episodes, got {len(logs)}"
        )
    names = [log.policy for log in logs]
    for log in logs:
        if names.count(log.policy) > 1:
            raise ValueError(f"policy {log.policy} is given twice in a comparison")
        if dict(log.door_config) != dict(logs[0].door_config):
            raise ValueError(
                f"{log.policy} opened another door than {logs[0].policy}; a comparison "
                "shows one door"
            )
        check_model(log, model)
    first, measured = logs[0], MEASURED[measure]
    greatest, unit = measured.greatest
    rows = "\n".join(
        f"| {log.policy} | "
        f"{'opened' if log.success else failure_name(log.failure, '')} | "
        f"{_widest(log):.0f}° | "
        f"{float(measured.values(log).max()):.1f} {unit} |"
        for log in logs
    )
    text = f"""\
### {heading or f"{len(logs)} policies at the {first.door} door"}

| policy | outcome | widest | {greatest} |
|---|---|---|---|
{rows}

All policies learned from the same demonstrations and open the same door (handle at \
{first.radius:g} m, seed {first.seed}), on one clock. {measured.meaning} The tube is \
the policy's forecast of the rest of the motion, ±1.96 σ; green is the true arc of \
the handle.
"""
    page = rr.TextDocument(text, media_type="text/markdown")
    with recording_file(path, _layout(logs, model, measured)) as stream:
        stream.send_recording_name(f"{first.door} door, {len(logs)} policies")
        stream.send_chunks(static(TEXT, page))
        door = motion.door_frame(model, first.config, demonstrations)
        stream.send_chunks(_moved_to(_OVERLAY, door))
        # The angle from which a door counts as opened.
        angle = math.degrees(SUCCESS_ANGLE)
        line = Line(f"opened: {angle:.0f}", colours.MARK, 1.0)
        ends = np.array([0.0, max(log.times[-1] for log in logs)])
        stream.send_chunks(_curve(f"{_ANGLE}/opened", line, ends, np.full(2, angle)))
        for number, (log, colour) in enumerate(zip(logs, COLOURS, strict=False)):
            stream.send_chunks(_robot(number, log, colour, model))
            for panel, values in (
                (_ANGLE, np.degrees(log.opening.door_angle)),
                (f"{_PLOTS}/{measured.panel}", measured.values(log)),
            ):
                entity, line = _below(panel, log.policy), Line(log.policy, colour, 1.5)
                stream.send_chunks(_curve(entity, line, log.times, values))


def _curve(
    entity: str, line: Line, times: FloatArray, values: FloatArray
) -> list[Chunk]:
    data = moving(entity, times, rr.Scalars.columns(scalars=values))
    return [line_style(entity, line), data]


def _robot(
    number: int, log: EpisodeLog, colour: Colour, model: mujoco.MjModel
) -> Iterator[Chunk]:
    """A robot at its door, and its path at the common door."""
    root, part = _below("/robots", log.policy), EpisodePart(log=log)
    overlay = _below(f"{_OVERLAY}{motion.ROOT}/paths", log.policy)
    hand = motion.hand_motion(part)
    yield static(f"{root}/world", rr.Transform3D(translation=SPACING * number * ROW))
    scene = [*static_chunks(log, model, []), *moved_scene(model, part)]
    yield from _moved_to(root, [*scene, *motion.policy_motion(part), *hand])
    yield from _moved_to(root, balls(part))
    for chunk in hand:
        if chunk.entity_path == _TRAIL:
            yield chunk.with_entity_path(overlay)
    for entity in (f"{root}{_TRAIL}", overlay):
        yield static(entity, rr.LineStrips3D.from_fields(colors=colour, radii=0.007))
    ended = SHORT.get(log.failure, failure_name(log.failure, ""))
    outcome = "opened" if log.success else f"{ended} at {_widest(log):.0f}°"
    label = rr.Points3D(
        [_LABEL],
        radii=0.012,
        colors=colour,
        labels=[f"{log.policy}: {outcome}"],
        show_labels=True,
    )
    yield static(f"{root}{motion.ROOT}/label", label)


def _moved_to(root: str, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """The same chunks below another entity."""
    for chunk in chunks:
        yield chunk.with_entity_path(f"{root}{chunk.entity_path}")


def _below(entity: str, policy: str) -> str:
    """The entity of a policy below another, valid for any policy name."""
    return f"{entity}/{rr.escape_entity_path_part(policy)}"


def _widest(log: EpisodeLog) -> float:
    """Greatest angle of the door [deg]."""
    return math.degrees(float(log.opening.door_angle.max()))


def _layout(
    logs: Sequence[EpisodeLog], model: mujoco.MjModel, measured: Measured
) -> rrb.Blueprint:
    """All robots, from behind and above; their curves and paths are below."""
    handle, _ = task_frame(model)
    middle = handle + 0.5 * SPACING * (len(logs) - 1) * ROW + [-0.2, 0.0, -0.2]
    away = max(2.2, 0.35 * SPACING * len(logs))
    back = np.array([-math.cos(_TURN), math.sin(_TURN), 0.45])
    plans = [f"- {_below('/robots', log.policy)}{motion.PLAN}/**" for log in logs]
    robots = view_3d(
        "Each policy at a copy of the same door",
        "/",
        ["/robots/**", *plans],
        Eye(middle + away * back, middle, (0.0, 0.0, 1.0)),
    )
    above, target = np.multiply(logs[0].radius, [[-0.5, -0.55, 1.45], [-0.5, -0.55, 0]])
    paths = view_3d(
        "All paths at one door, from above",
        f"{_OVERLAY}{motion.VIEW}",
        [f"{_OVERLAY}/**"],
        Eye(above, target, (1.0, 0.0, 0.0)),
    )
    angle = series_view(Plot("angle", "Door angle [deg]", "LeftTop"), _PLOTS)
    curves = series_view(Plot(measured.panel, measured.title), _PLOTS)
    about = rrb.TextDocumentView(origin=TEXT, name="How to read it")
    panels = rrb.Horizontal(angle, curves, paths, about, column_shares=[3, 3, 2.4, 3])
    return only(rrb.Vertical(robots, panels, row_shares=[5, 4]))
