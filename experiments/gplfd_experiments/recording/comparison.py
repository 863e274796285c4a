"""Several policies at the same door, side by side in one recording.

Every robot stands at a door of its own, in a row, and all move on the same clock. Each
policy has a colour, the same for its robot's label, the path of its hand and its
curves.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from pathlib import Path
from typing import Final

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from gplfd_env.task.opening import SUCCESS_ANGLE
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.recording import colours, motion
from gplfd_experiments.recording.colours import Colour
from gplfd_experiments.recording.compared import MEASURED, RADIAL, Measured
from gplfd_experiments.recording.comparison_layout import (
    ABOUT,
    ANGLE,
    OVERLAY,
    PLOTS,
    ROW,
    SPACING,
    below,
    comparison_layout,
    robot_entity,
)
from gplfd_experiments.recording.episode import check_model, stage_setting
from gplfd_experiments.recording.motion import hand_motion, policy_motion
from gplfd_experiments.recording.outside import balls
from gplfd_experiments.recording.part import Part
from gplfd_experiments.recording.scene import moved_scene
from gplfd_experiments.recording.stream import moving, recording_file, seconds, static
from gplfd_policies.demonstrations.demonstration import Demonstration

COLOURS: Final[tuple[Colour, ...]] = (
    colours.ADAPTED,
    colours.HAND,
    colours.AXIS_Z,
    colours.AXIS_X,
    (120, 230, 90),
    (255, 120, 150),
    (60, 210, 200),
    (235, 235, 240),
    (150, 140, 255),
    (190, 150, 110),
)
"""A colour per policy, in order; no more policies than these."""

_TRAIL: Final = f"{motion.ROOT}/hand/trail"
_ENDED: Final = {
    "stalled": "stuck",
    "latched": "latched",
    "not_grasped": "not grasped",
    "grasp_lost": "let go",
}
"""What a failure is called where there is little room."""
_LABEL: Final = (1.15, -0.8, -0.2)
"""Where a robot's name stands, behind it, in its task frame [m]."""


def record_comparison(
    path: str | Path,
    logs: Sequence[EpisodeLog],
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    measure: str = RADIAL,
    heading: str = "",
) -> None:
    """Write an .rrd in which policies open the same door, complete or not at all.

    Args:
        path: File to write; an existing one is replaced.
        logs: An episode per policy, on the same door; the first stands leftmost.
        model: Model that the episodes ran in.
        demonstrations: What the policies learned from, poses in the task frame.
        measure: What they are compared by, one of `MEASURED`.
        heading: Of the page beside them; their number and door if it is empty.

    Raises:
        ValueError: No log or too many, a policy twice, different doors, or a log that
            does not fit the model.
        OSError: The file cannot be written.
    """
    _check(logs, model)
    measured = MEASURED[measure]
    about = _about(logs, measured, heading)
    with recording_file(path, comparison_layout(logs, model, measured)) as stream:
        stream.send_recording_name(f"{logs[0].door} door, {len(logs)} policies")
        page = rr.TextDocument(about, media_type="text/markdown")
        stream.send_chunks(static(ABOUT, page))
        stream.send_chunks(_everything(logs, model, demonstrations, measured))


def _check(logs: Sequence[EpisodeLog], model: mujoco.MjModel) -> None:
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


def _everything(
    logs: Sequence[EpisodeLog],
    model: mujoco.MjModel,
    demonstrations: Sequence[Demonstration],
    measured: Measured,
) -> Iterator[Chunk]:
    door = motion.door_frame(model, logs[0].config, demonstrations)
    yield from _moved_to(OVERLAY, door)
    yield from _success_line(logs)
    for number, (log, colour) in enumerate(zip(logs, COLOURS, strict=False)):
        yield from _robot(number, log, colour, model)
        yield from _curves(log, colour, measured)


def _robot(
    number: int, log: EpisodeLog, colour: Colour, model: mujoco.MjModel
) -> Iterator[Chunk]:
    """A robot at its door, and its path again on the common door."""
    root, part = robot_entity(log.policy), Part(log=log)
    place = rr.Transform3D(translation=SPACING * number * ROW)
    yield static(f"{root}/world", place)
    overlay, hand = (
        below(f"{OVERLAY}{motion.ROOT}/paths", log.policy),
        hand_motion(part),
    )
    yield from _moved_to(root, stage_setting(log, model, []))
    yield from _moved_to(root, [*moved_scene(model, part), *policy_motion(part), *hand])
    yield from _moved_to(root, balls(part))
    for chunk in hand:
        if chunk.entity_path == _TRAIL:
            yield chunk.with_entity_path(overlay)
    for entity in (f"{root}{_TRAIL}", overlay):
        yield static(entity, rr.LineStrips3D.from_fields(colors=colour, radii=0.007))
    text = [_label(log)]
    label = rr.Points3D(
        [_LABEL], radii=0.012, colors=colour, labels=text, show_labels=True
    )
    yield static(f"{root}{motion.ROOT}/label", label)


def _curves(log: EpisodeLog, colour: Colour, measured: Measured) -> Iterator[Chunk]:
    index = seconds(log.times)
    for panel, values in (
        (ANGLE, np.degrees(log.door_angle)),
        (f"{PLOTS}/{measured.panel}", measured.values(log)),
    ):
        entity = below(panel, log.policy)
        yield static(
            entity, rr.SeriesLines(colors=colour, widths=1.5, names=log.policy)
        )
        yield moving(entity, index, rr.Scalars.columns(scalars=values))


def _success_line(logs: Sequence[EpisodeLog]) -> Iterator[Chunk]:
    """The angle from which on a door counts as opened."""
    entity, angle = f"{ANGLE}/opened", math.degrees(SUCCESS_ANGLE)
    look = rr.SeriesLines(colors=colours.MARK, widths=1.0, names=f"opened: {angle:.0f}")
    yield static(entity, look)
    ends = np.array([0.0, max(log.times[-1] for log in logs)])
    yield moving(entity, seconds(ends), rr.Scalars.columns(scalars=[angle] * 2))


def _moved_to(root: str, chunks: Iterable[Chunk]) -> Iterator[Chunk]:
    """The same chunks below another entity."""
    for chunk in chunks:
        yield chunk.with_entity_path(f"{root}{chunk.entity_path}")


def _label(log: EpisodeLog) -> str:
    angle = math.degrees(float(log.door_angle.max()))
    ended = _ENDED.get(log.failure, log.failure.replace("_", " "))
    return f"{log.policy}: {'opened' if log.success else f'{ended} at {angle:.0f}°'}"


def _about(logs: Sequence[EpisodeLog], measured: Measured, heading: str) -> str:
    first, (greatest, unit) = logs[0], measured.greatest
    rows = "\n".join(
        f"| {log.policy} | "
        f"{'opened' if log.success else log.failure.replace('_', ' ')} | "
        f"{math.degrees(float(log.door_angle.max())):.0f}° | "
        f"{float(measured.values(log).max()):.1f} {unit} |"
        for log in logs
    )
    return f"""\
### {heading or f"{len(logs)} policies at the {first.door} door"}

| policy | outcome | widest | {greatest} |
|---|---|---|---|
{rows}

All learned from the same demonstrations and are at the same door (handle at \
{first.radius:g} m, seed {first.seed}), on one clock. {measured.meaning} The tube is \
what a policy believes the rest of the motion to be, ±1.96 σ; green is the handle's \
true arc.
"""
