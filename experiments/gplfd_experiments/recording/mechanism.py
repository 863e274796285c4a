"""Motion of handle, latch, closer and mobile base; nothing for missing parts.

Handle, bolt and base are joints of the model, so their motion is in the log's
generalised positions. The existing parts follow from model and door alone, before the
episode.
"""

from collections.abc import Iterator, Mapping
from typing import Final, NamedTuple

import mujoco
import numpy as np
import rerun as rr
from rerun.chunk import Chunk

from gplfd_env.doors.config import DoorConfig
from gplfd_env.doors.parts import Closer
from gplfd_env.robot.mobile_base import BASE_JOINTS
from gplfd_env.scene.latch import GAP
from gplfd_env.scene.visuals import CLOSER_ARM
from gplfd_experiments.episodes.log import EpisodeLog
from gplfd_experiments.files.arrays import FloatArray
from gplfd_experiments.recording import colours, lanes, panels
from gplfd_experiments.recording.panels import Line
from gplfd_experiments.recording.scene import kinematics
from gplfd_experiments.recording.stream import frames, moving, static

LATCH: Final = f"{lanes.ROOT}/latch"
"""Entity of the lane with the state of the bolt."""

ARM: Final = "/world/scene/closer_arm"
"""Entity of a closer's arm, in the world's axes."""

BOLT_STATES: Final[Mapping[str, colours.Colour]] = {
    "bolt thrown": colours.MARK,
    "bolt held back": colours.HAND,
}


class Panel(NamedTuple):
    """A panel: its title, and by joint the line and the unit's factor of a curve.

    Without joints it shows the closing torque.
    """

    title: str
    joints: Mapping[str, tuple[Line, float]]


_BASE_CURVES: Final = (
    (Line("x, ahead [m]", colours.AXIS_X), 1.0),
    (Line("y, to the left [m]", colours.AXIS_Z), 1.0),
    (Line("turn [rad]", colours.ADAPTED), 1.0),
)
PANELS: Final[Mapping[str, Panel]] = {
    "handle": Panel(
        "Handle [deg]", {"handle": (Line("handle", colours.HAND), 180.0 / np.pi)}
    ),
    "latch": Panel(
        "Bolt, retracted by [mm]",
        {"bolt": (Line("bolt held back", colours.HAND), 1e3)},
    ),
    "closer": Panel("Closing torque [N m]: closer, seal, stiction", {}),
    "base": Panel(
        "Base [m, rad]",
        dict(zip(BASE_JOINTS, _BASE_CURVES, strict=True)),
    ),
}
"""Panels by the entity below `gplfd_experiments.recording.panels.ROOT`."""


def mechanism_of(model: mujoco.MjModel, door: DoorConfig) -> tuple[str, ...]:
    """Return which of `PANELS` have data for a model and its door."""
    joints = {model.joint(index).name for index in range(model.njnt)}
    closing = door.closer != Closer() or door.seal > 0.0 or door.stiction > 0.0
    return tuple(
        name
        for name, panel in PANELS.items()
        if (panel.joints.keys() <= joints if panel.joints else closing)
    )


def mechanism(log: EpisodeLog, model: mujoco.MjModel) -> Iterator[Chunk]:
    """Return curves, the latch's lane and the closer's arm in an episode."""
    parts = mechanism_of(model, log.config)
    for name in parts:
        curves = {
            line: scale * _positions(log, model, joint)
            for joint, (line, scale) in PANELS[name].joints.items()
        } or {Line("closing torque", colours.FORCE): log.forces.closer_torque}
        yield from panels.lines(log, f"{panels.ROOT}/{name}/motion", curves)
    if "latch" in parts:
        yield lanes.lane_style(LATCH, BOLT_STATES)
        yield lanes.state_changes(log, LATCH, bolt_states(log, model))
    # The tendon of a closer's arm, if it has a colour.
    tendons = [model.tendon(index).name for index in range(model.ntendon)]
    if CLOSER_ARM not in tendons:
        return
    arm = model.tendon(CLOSER_ARM).id
    if model.tendon_rgba[arm, 3] == 0.0:
        return
    sites = [model.site(f"closer_{end}").id for end in ("spindle", "foot")]
    strips = np.array([data.site_xpos[sites] for data in kinematics(model, log)])
    tint = (255.0 * model.tendon_rgba[arm]).round().astype(np.uint8)
    radius = model.tendon_width[arm]
    yield static(ARM, rr.LineStrips3D.from_fields(colors=tint, radii=radius))
    columns = rr.LineStrips3D.columns(strips=strips.astype(np.float32))
    one_per_frame = columns.partition(np.ones(len(strips), int))
    yield moving(ARM, log.times[frames(log)], one_per_frame)


def bolt_states(log: EpisodeLog, model: mujoco.MjModel) -> list[tuple[int, str]]:
    """Return rows in which the state of the bolt changes, and the state.

    It is held back if it is retracted so far that the door can open.
    """
    throw = model.jnt_range[model.joint("bolt").id, 1]
    back = _positions(log, model, "bolt") >= throw - GAP
    rows = np.flatnonzero(np.diff(back, prepend=~back[:1]))
    thrown, held = BOLT_STATES
    return [(int(row), held if back[row] else thrown) for row in rows]


def _positions(log: EpisodeLog, model: mujoco.MjModel, joint: str) -> FloatArray:
    """Positions of a joint, (T,) [m or rad]."""
    positions: FloatArray = log.motion.qpos[:, model.joint(joint).qposadr[0]]
    return positions
